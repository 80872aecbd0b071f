"""All laws through all experiments, and the paper's statements (section 3.3) beside what was measured."""

import dataclasses

from microstage_ros.model.friction.properties import loaded, presliding, sliding
from microstage_ros.model.friction.registry import NAMES

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


STATEMENTS = tuple(
    Statement(law, row, shown)
    for law, rows in {
        "coulomb_viscous_stribeck": {"Stribeck curve": True, "pre-sliding hysteresis": False},
        "dahl": {
            "pre-sliding hysteresis": True,
            "frictional lag": False,
            "memory: return point": False,
            "memory: wipe-out": False,
            "Stribeck curve": False,
            "stick-slip": False,
        },
        "lugre": {
            "Stribeck curve": True,
            "frictional lag": True,
            "rising static friction": True,
            "stick-slip": True,
            "memory: return point": False,
            "memory: wipe-out": False,
        },
        "leuven": {
            "Stribeck curve": True,
            "frictional lag": True,
            "rising static friction": True,
            "stick-slip": True,
            "memory: return point": True,
            "memory: wipe-out": True,
        },
        "hsieh_pan": {
            "creep under constant load": True,
            "memory: return point": True,
            "memory: wipe-out": True,
        },
        "generalised_maxwell_slip": {
            "Stribeck curve": True,
            "pre-sliding hysteresis": True,
            "memory: return point": True,
            "memory: wipe-out": True,
            "frictional lag": True,
            "stick-slip": True,
        },
    }.items()
    for row, shown in rows.items()
)


def measure(progress=iter):
    """{row: {law's name: Finding}} of all laws; ``progress`` may wrap the iteration over the rows."""
    return {row: {name: EXPERIMENTS[row](name) for name in NAMES} for row in progress(tuple(EXPERIMENTS))}


def compare(table):
    """[(Statement, Finding, agrees)] for every statement of the paper."""
    return [(said, found, found.shown == said.shown) for said in STATEMENTS for found in [table[said.row][said.law]]]
