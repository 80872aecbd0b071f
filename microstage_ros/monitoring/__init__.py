"""Watching an axis: is it still the machine that it was, judged against its own healthy spread.

Sizes per window of motion (`traits`), scores and alarms (`health`), a history (`store`).
"""
