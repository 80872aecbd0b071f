"""Friction along a measured displacement: what identification and diagnosis run thousands of times.

Between two samples the motion is taken as monotone, which is all that Maxwell-slip asks; a law that
depends on velocity sees it constant between two samples.

Sources: W. D. Iwan, Journal of Applied Mechanics 33 (1966); paper, Eqs. 3–6.
"""

import numpy

from microstage_ros.model.friction.curve import viscous_force
from microstage_ros.model.friction.registry import stretch_law
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.errors import InputError


def maxwell_slip_force(displacement, stiffness, limits, limit_factor=1.0, limits_negative=None, initial=0.0):
    """Summed force of Maxwell-slip blocks along one or many records.

    F_i[n] = clip(F_i[n−1] + k_i (x[n] − x[n−1]), ± λ[n] limit_i), the limit of the side moved towards.

    Parameters
    ----------
    displacement : (..., n) [q].
    stiffness, limits : (m,) [F/q], [F]; ``limits_negative`` (m,) where the negative direction differs.
    limit_factor : λ, scalar or (..., n) [1].
    initial : force of each block at the first sample [F], scalar, (m,) or (..., m).

    Returns
    -------
    force (..., n) [F].

    Raises
    ------
    InputError : for shapes that do not fit or values not finite.
    """
    rows, lead = _records(displacement)
    stiffness, limits = _finite("stiffness", stiffness), _finite("limits", limits)
    below = limits if limits_negative is None else _finite("limits_negative", limits_negative)
    if stiffness.ndim != 1 or not stiffness.shape == limits.shape == below.shape:
        raise InputError("limits", (stiffness.shape, limits.shape, below.shape), "one limit per stiffness")
    blocks = _spread("initial", initial, (*lead, stiffness.size)).reshape(rows.shape[0], -1).copy()
    force = numpy.empty_like(rows)
    drag_records(rows, stiffness, limits, below, _factors(limit_factor, rows, lead), blocks, force)
    return force.reshape(*lead, -1)


def stop_operators(displacement, thresholds, initial=0.0):
    """Stop operators: Maxwell-slip blocks of unit stiffness that slip at the given displacements.

    A Maxwell-slip force is linear in the stiffnesses on these: F = Σ k_i stop_i (regressors of a fit).

    Parameters
    ----------
    displacement : (n,) [q].
    thresholds : (m,) [q], > 0.
    initial : their values at the first sample [q], scalar or (m,).

    Returns
    -------
    (m, n) [q].

    Raises
    ------
    InputError : more than one record, or a threshold that is not positive.
    """
    rows, lead = _records(displacement)
    thresholds = _finite("thresholds", thresholds)
    if lead or thresholds.ndim != 1 or not (thresholds > 0.0).all():
        raise InputError("thresholds", thresholds.tolist(), "one record, and a one-dimensional array of thresholds > 0")
    stops = numpy.empty((thresholds.size, rows.shape[1]))
    drag_stops(rows[0], thresholds, _spread("initial", initial, thresholds.shape), stops)
    return stops


def force_along(law, packed, displacement, duration, limit_factor=1.0, state=None):
    """Friction of any law along a measured displacement, one sample every ``duration`` [s].

    ``law``, ``packed`` (p,), ``limit_factor`` [1] and ``state`` (state size,) as
    :func:`~microstage_ros.model.friction.registry.run_law`, ``displacement`` (n,) [q] in place of the velocity.
    Returns force (n,) [F]; the first entry is that of the state as given, at rest.

    Raises InputError: more than one record, or a sampling period that is not positive.
    """
    rows, lead = _records(displacement)
    if lead:
        raise InputError("displacement", rows.shape, "one record, shape (n,)")
    if not duration > 0.0:
        raise InputError("duration", duration, "a sampling period > 0 [s]")
    force = numpy.empty_like(rows[0])
    state = law.initial_state(packed) if state is None else state
    follow_positions(law.number, packed, state, rows[0], float(duration), _factors(limit_factor, rows, lead)[0], force)
    return force


def _finite(name, value):
    """``value`` as a float array; InputError if any entry is not finite."""
    array = numpy.asarray(value, float)
    if not numpy.isfinite(array).all():
        raise InputError(name, f"{numpy.count_nonzero(~numpy.isfinite(array))} values not finite", "finite numbers")
    return array


def _records(displacement):
    """(records (r, n), the shape they had before the last axis)."""
    displacement = _finite("displacement", displacement)
    if displacement.ndim == 0 or displacement.size == 0:
        raise InputError("displacement", displacement.shape, "at least one sample along the last axis")
    return numpy.ascontiguousarray(displacement).reshape(-1, displacement.shape[-1]), displacement.shape[:-1]


def _spread(name, value, shape):
    """``value`` broadcast to ``shape``; InputError if it does not fit."""
    try:
        return numpy.broadcast_to(_finite(name, value), shape)
    except ValueError:
        raise InputError(name, numpy.shape(value), f"a scalar or an array that broadcasts to {shape}") from None


def _factors(limit_factor, rows, lead):
    """Limit factors (r, n), or (r, 1) when one number holds throughout."""
    last = 1 if numpy.ndim(limit_factor) == 0 else rows.shape[1]
    factors = _spread("limit_factor", limit_factor, (*lead, last))
    return numpy.ascontiguousarray(factors).reshape(rows.shape[0], last)


@compiled
def drag_records(displacement, stiffness, limits, limits_negative, factors, blocks, force):
    """Compiled core of :func:`maxwell_slip_force`; ``blocks`` (r, m) is carried to the last sample.

    All arrays C-contiguous float64: displacement, force (r, n), factors (r, n) or (r, 1).
    """
    count = stiffness.size
    for r in range(displacement.shape[0]):
        total = 0.0
        for i in range(count):
            total += blocks[r, i]
        force[r, 0] = total
        last = factors.shape[1] - 1
        for n in range(1, displacement.shape[1]):
            step = displacement[r, n] - displacement[r, n - 1]
            factor = factors[r, min(n, last)]
            total = 0.0
            if step > 0.0:
                for i in range(count):
                    moved, bound = blocks[r, i] + stiffness[i] * step, factor * limits[i]
                    blocks[r, i] = min(moved, bound)
                    total += blocks[r, i]
            else:
                for i in range(count):
                    moved, bound = blocks[r, i] + stiffness[i] * step, -factor * limits_negative[i]
                    blocks[r, i] = moved if moved > bound or step == 0.0 else bound
                    total += blocks[r, i]
            force[r, n] = total


@compiled
def drag_stops(displacement, thresholds, initial, stops):
    """Compiled core of :func:`stop_operators`."""
    for i in range(thresholds.size):
        value, threshold = initial[i], thresholds[i]
        stops[i, 0] = value
        for n in range(1, displacement.size):
            value += displacement[n] - displacement[n - 1]
            value = min(max(value, -threshold), threshold)
            stops[i, n] = value


@compiled
def follow_positions(law, parameters, state, displacement, duration, factors, force):
    """Compiled core of :func:`force_along`; ``factors`` (n,) or (1,)."""
    last = factors.size - 1
    force[0] = stretch_law(law, parameters, state, 0.0, 0.0, 0.0, 0.0, factors[0])
    for n in range(1, displacement.size):
        velocity = (displacement[n] - displacement[n - 1]) / duration
        direction, speed = float(numpy.sign(velocity)), abs(velocity)
        rest = stretch_law(law, parameters, state, direction, speed, speed, duration, factors[min(n, last)])
        force[n] = rest + viscous_force(parameters, velocity)
