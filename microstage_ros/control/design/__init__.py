"""Gains by rule from the numbers of an axis, and its linear loop: what a law starts from, and whether that start is
stable."""
