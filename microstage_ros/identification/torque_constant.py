"""What a torque is measured in: the torque constant, which no record of a motor alone tells.

A motor's records have its current, and K_T makes a torque of it: friction and inertia are in proportion to K_T. Of an
ideal DC machine K_T = K_E, by the balance of the powers K_E ω i and K_T i ω. Where the axis file has one number for
both, K_T goes with the K_E that was found; where it has two, K_T was measured otherwise, and stays.
"""

import math

from microstage_ros.identification.estimators.estimate import Estimate

CONSTANT, EMF = "drive.torque_constant", "drive.back_emf"
ONE = 1e-3                     # relative difference up to which the file's two constants are one
# how far a DC motor's torque constant may be from its back-EMF constant (iron losses, temperature between the two)
TIED = 0.01
EXPERIMENT = "a known torque at the shaft (a weight on a lever) would"
REMARK = ("Torques and inertias, and their intervals, are for a torque constant of {:.4g} N m/A, {}: with another one "
          "all change by the same factor.")


def are_one(axis):
    """Whether the axis file's torque constant is its back-EMF constant, within `ONE` [1]: True or False."""
    return math.isclose(axis.value(CONSTANT), axis.value(EMF), rel_tol=ONE)


def with_found_constant(axis, estimates):
    """The axis with the torque constant of the found back-EMF constant, where the file has one number for both.

    ``estimates``: {key: `Estimate`} of the motor.
    """
    found = estimates.get(EMF)
    if found is None or not found.determined or not are_one(axis):
        return axis
    return axis.with_values({CONSTANT: _goes_with(found.value, axis)})


def _goes_with(emf, axis):
    return emf * axis.value(CONSTANT) / axis.value(EMF)


def add_constant(result, axis):
    """Add the torque constant to a finished `Identification`.

    ``axis``: the axis file as given. A constant that has its own number there keeps it.
    """
    emf, given = result.estimates.get(EMF), axis.quantity(CONSTANT)
    if not are_one(axis) or emf is None or not emf.determined:
        result.add(Estimate(CONSTANT, given.value, given.unit, determined=False,
                            remark=f"not determined by these records; {EXPERIMENT}"))
        result.remarks.append(REMARK.format(given.value, "the axis file's"))
        return
    value = _goes_with(emf.value, axis)
    spread = math.hypot(TIED * value, emf.stderr)
    result.add(Estimate(CONSTANT, value, given.unit, spread, value - 1.96 * spread, value + 1.96 * spread,
                        method="equal to the back-EMF constant"))
    result.remarks.append(REMARK.format(value, "which goes with the back-EMF constant that was found"))
