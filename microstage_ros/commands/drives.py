"""Which drives a command serves. The table of docs/actuators_and_sensors.md is `table`, held by a test."""

from typing import NamedTuple

from microstage_ros.commissioning.sketch import DRIVES as COMMISSIONED
from microstage_ros.model.actuators import ACTUATORS
from microstage_ros.quantities.errors import InputError

FORCES = tuple(actuator.name for actuator in ACTUATORS if not actuator.holds_position)
"""Drives whose command makes a force or a torque; the others are commanded with a position."""


class Service(NamedTuple):
    """Drives that a command serves, and why not the others."""

    drives: tuple
    otherwise: str = ""


EVERY = Service(tuple(actuator.name for actuator in ACTUATORS))
SERVICES = {
    "simulate": EVERY,
    "cell": EVERY,
    "move": EVERY,
    "diagnose": EVERY,
    "identify": Service(tuple(a.name for a in ACTUATORS if a.estimation != "position" or a.identified),
                        "its motion says nothing of forces"),
    "tune": Service(tuple(a.name for a in ACTUATORS if not a.holds_position and a.command.unit == "V"),
                    "a limit cycle needs a force in proportion to volts"),
    "robustness": Service(FORCES, "its conditions vary masses and friction that a force has to move"),
    "compare": Service(("voltage_motor",), "the paper's controllers and figures are of a motor fed with a voltage"),
    "commission": Service(COMMISSIONED, "its steps feel their way with small forces"),
}
"""Command to what it serves; commands that take no axis file are not here."""


def check_drive(command, axis):
    """Nothing, where ``command`` serves the drive of an `Axis`.

    Raises InputError: another drive; the drives that are served, and why it is not.
    """
    service, drive = SERVICES[command], axis.choices["drive.type"]
    if drive not in service.drives:
        raise InputError(f"{axis.place}: drive.type", drive,
                         f"{' or '.join(service.drives)} for {command}: {service.otherwise}")


def table():
    """Lines of a Markdown table: commands by drives, with the reason of each refusal."""
    names = EVERY.drives
    lines = [f"| command | {' | '.join(f'`{name}`' for name in names)} | refused because |",
             "|---" * (len(names) + 2) + "|"]
    for command, service in SERVICES.items():
        marks = ("yes" if name in service.drives else "refused" for name in names)
        lines.append(f"| `{command}` | {' | '.join(marks)} | {service.otherwise or '–'} |")
    return lines
