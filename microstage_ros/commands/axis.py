"""An axis file as a command reads it: checked, and what is unlikely in it said on standard error."""

import sys

from microstage_ros.commands import answer
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.plausibility import implausible


def read_axis(path):
    """The `Axis` of a file, with `warn`. Raises `InputError` as `load_axis` does."""
    axis = load_axis(path)
    warn(axis)
    return axis


def warn(axis):
    """Say every unlikely number of an `Axis` on standard error, one line each, and in the answer as JSON."""
    warnings = implausible(axis)
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if warnings:
        answer.state(warnings=warnings)
