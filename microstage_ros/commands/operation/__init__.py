"""Commands beside a running axis: start it, move it, record and replay it."""
