"""An axis file as a command reads it: checked, and what is unlikely in it said on standard error."""

import sys

from microstage_ros.commands import answer
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.plausibility import implausible
from microstage_ros.places import config_file
from microstage_ros.quantities.yaml_text import yaml_tree


def read_axis(path):
    """The `Axis` of a file, with `warn`. Raises `InputError` as `load_axis` does, and for an effect that the axis
    cannot have."""
    axis = load_axis(path)
    warn(axis)
    check_effects_fit(axis)
    return axis


def check_effects_fit(machine, run=None):
    """Raise `InputError`, with the file's name, where the machine (`Axis`) cannot have an effect that its own file or
    the `Run` gives it."""
    if run is not None and run.period_s is not None:
        machine = machine.with_values({"period": run.period_s}, source="derived")
    effects = run.effects if run is not None else {}
    if machine.effects or effects:
        from microstage_ros.hardware.simulated import made_plant  # loads the compiled model: not for every command

        made_plant(machine, effects=effects, place=run.place if run is not None else "")


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
