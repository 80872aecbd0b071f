"""All laws through all experiments, and the paper's statements (section 3.3) beside what was measured."""

import dataclasses

from microstage_ros.model.friction.properties import loaded, presliding, sliding
from microstage_ros.model.friction.registry import LAWS, NAMES

EXPERIMENTS = {  # title of the row: experiment
    "Stribeck curve": sliding.stribeck,
    "pre-sliding hysteresis": presliding.hysteresis,
    "memory: Masing": presliding.masing,
    "memory: return point": presliding.return_point,
    "memory: congruency": presliding.congruency,
    "memory: wipe-out": presliding.wipe_out,
    "drift under small oscillation": loaded.drift,
    "creep under constant load": loaded.creep,
    "frictional lag": sliding.frictional_lag,
    "rising static friction": sliding.rising_static_friction,
    "stick-slip": loaded.stick_slip,
    "breakaway spread": loaded.breakaway_spread,
    "passive": sliding.passivity,
}


@dataclasses.dataclass(frozen=True)
class Statement:
    """What the paper says of a law: that it shows a property, or that it does not."""

    law: str
    row: str
    shown: bool


STATEMENTS = tuple(Statement(law.name, row, shown) for law in LAWS
                   for row, shown in getattr(law.file, "SAYS", {}).items())


def measure(progress=iter):
    """{row: {law's name: Finding}} of all laws; ``progress`` may wrap the iteration over the rows."""
    return {row: {name: EXPERIMENTS[row](name) for name in NAMES} for row in progress(tuple(EXPERIMENTS))}


def compare(table):
    """[(Statement, Finding, agrees)] for every statement of the paper."""
    return [(said, found, found.shown == said.shown) for said in STATEMENTS for found in [table[said.row][said.law]]]
