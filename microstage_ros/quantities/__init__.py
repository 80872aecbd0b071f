"""Quantities: what every input is checked with, and the one error of bad input."""
