"""Commands for topics and bags: list, show, measure, play back, make whole again."""
