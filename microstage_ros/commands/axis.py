"""An axis file as a command reads it: checked, and what is unlikely in it said on standard error."""

import sys

from microstage_ros.commands import answer
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.plausibility import implausible
from microstage_ros.places import config_file
from microstage_ros.quantities.yaml_text import yaml_tree


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


def add_controller(parser):
    """Add ``--controller`` to a parser: one of the laws that the node knows (its parameter file lists them)."""
    place = config_file("str_controller.yaml")
    laws = [law for law in yaml_tree(place.read_text(encoding="utf-8"), str(place))["controller"]["one_of"] if law]
    parser.add_argument("--controller", choices=laws, metavar="NAME",
                        help=f"control law, one of {', '.join(laws)} (default: that of the axis file)")
