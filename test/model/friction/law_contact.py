"""One contact of handy numbers for all law tests: limits near 1, blocks that slip within 0.1."""

from microstage_ros.model.friction.registry import law_named

CURVE = {
    "static": 1.0,
    "coulomb": 0.6,
    "stribeck_velocity": 0.5,
    "stribeck_exponent": 1.3,
    "viscous": 0.05,
    "static_negative": 0.9,
    "coulomb_negative": 0.7,
    "viscous_negative": 0.08,
}
BLOCKS = {"stiffness": (40.0, 12.0, 4.0), "weight": (0.5, 0.3, 0.2)}
OWN = {
    "coulomb_viscous_stribeck": {},
    "dahl": {"stiffness": 50.0, "exponent": 1.4},
    "lugre": {"stiffness": 50.0, "damping": 0.3},
    "elasto_plastic": {"stiffness": 50.0, "damping": 0.3, "breakaway_share": 0.6},
    "leuven": {**BLOCKS, "damping": 0.3, "exponent": 2.5},
    "hsieh_pan": {**BLOCKS, "creep_velocity": 0.01, "sharpness": 6.0, "hardening": 5.0},
    "maxwell_slip": BLOCKS,
    "generalised_maxwell_slip": {**BLOCKS, "attraction": 20.0},
}


def pack(name, **changes):
    """(law, packed parameters) of the tests' contact by the law's name; keyword arguments replace parameters."""
    law = law_named(name)
    return law, law.pack({**CURVE, **OWN[name], **changes})
