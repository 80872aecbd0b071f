"""Friction along a measured displacement: what identification and diagnosis run thousands of times.

Between two samples the displacement is taken as monotone, which for Maxwell-slip is all that matters;
laws that depend on velocity see it constant between two samples.
"""

import numpy

from microstage_ros.axis.compiled import compiled
from microstage_ros.axis.errors import InputError
from microstage_ros.axis.laws.registry import stretch_law, viscous_force


def maxwell_slip_force(displacement, stiffness, limits, limit_factor=1.0, limits_negative=None, initial=0.0):
    """Force of Maxwell-slip blocks along one or many records.

    F_i[n] = clip(F_i[n−1] + k_i (x[n] − x[n−1]), ± λ[n] limit_i) on the side the motion goes to.

    Parameters
    ----------
    displacement : (..., n) [q].
    stiffness, limits : (m,) [F/q], [F]; ``limits_negative`` (m,) where the negative direction differs.
    limit_factor : λ, scalar or (..., n) [1].
    initial : force of each block at the first sample [F], scalar, (m,) or (..., m).

    Returns the summed force (..., n) [F]. Raises InputError for shapes that do not fit or values that
    are not finite.
    """
    displacement = _finite("displacement", displacement)
    if displacement.ndim == 0 or displacement.shape[-1] == 0:
        raise InputError("displacement", displacement.shape, "at least one sample along the last axis")
    stiffness, limits = _finite("stiffness", stiffness), _finite("limits", limits)
    limits_negative = limits if limits_negative is None else _finite("limits_negative", limits_negative)
    if stiffness.ndim != 1 or not stiffness.shape == limits.shape == limits_negative.shape:
        raise InputError("limits", (stiffness.shape, limits.shape, limits_negative.shape), "one limit per stiffness")
    rows, samples = displacement.reshape(-1, displacement.shape[-1]), displacement.shape[-1]
    lead = displacement.shape[:-1]
    factor = _finite("limit_factor", limit_factor)
    factor = numpy.broadcast_to(factor[..., None] if factor.ndim == 0 else factor, (*lead, min(samples, factor.size) if factor.ndim == 0 else samples))
    blocks = numpy.array(numpy.broadcast_to(_finite("initial", initial), (*lead, stiffness.size)))
    force = numpy.empty_like(rows)
    drag_records(
        rows,
        stiffness,
        limits,
        limits_negative,
        numpy.ascontiguousarray(factor).reshape(rows.shape[0], -1),
        blocks.reshape(rows.shape[0], -1),
        force,
    )
    return force.reshape(displacement.shape)
