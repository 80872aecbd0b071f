"""Watching an axis: is it still the machine that it was? Sizes per window of motion, judged against its own healthy spread."""
