"""Elasto-slip blocks shared by the Maxwell-slip family: parameters, both readings of the paper's tables.

Packed after the head of :mod:`curve`: ``[count, k_1 … k_n, α_1 … α_n, …]``.
"""

import numpy

from microstage_ros.model.friction.curve import OWN, sliding_limit
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import positive

COUNT = OWN
STIFFNESS = OWN + 1  # first of the stiffnesses; the weights follow them
ROUNDING = 1e-14     # of a sum of a few weights


def block_parameters(what="blocks"):
    """Specs of the stiffnesses and weights of a law that has ``what``, at the screw angle."""
    return {
        "stiffness": positive("N m/rad", f"k_i of the {what}, shape (n,)", is_list=True),
        "weight": positive("1", "α_i, shares of the limit, shape (n,); normalised to Σα = 1", is_list=True),
    }


def pack_blocks(stiffness, weight):
    """``[n, k…, α…]`` with Σα normalised to one (the paper's tables add up to 0.999).

    ``stiffness`` k (n,) [F/q], ``weight`` α (n,) [1]. Raises InputError for unequal lengths or no block.
    """
    stiffness, weight = numpy.atleast_1d(stiffness).astype(float), numpy.atleast_1d(weight).astype(float)
    if stiffness.ndim != 1 or stiffness.size != weight.size or stiffness.size == 0:
        raise InputError("weight", weight.tolist(), f"as many weights as stiffnesses ({stiffness.size}), at least one")
    total = weight.sum()
    if abs(total - 1.0) > ROUNDING:      # what is normalised already keeps its last digits
        weight = weight / total
    return [float(stiffness.size), *stiffness, *weight]


def blocks_from_segment_slopes(slopes, shares, static):
    """Blocks of a virgin curve whose segments have ``slopes`` K_i and cover ``shares`` of ``static``.

    ``slopes`` (n,) [F/q], ``shares`` (n,) [1], ``static`` F_s [F].

    Segment i is Δx_i = share_i · static / K_i long; then k_i = K_i − K_(i+1) and α_i = k_i x_i / static
    (derived: k_i is what the slope loses where block i slips; the paper's Table 3, read so, reaches the 40 µm of its
    Fig. 7).

    Returns (stiffness [F/q], weight [1]), both of shape (n,). Raises InputError unless the slopes fall.
    """
    slopes, shares = numpy.asarray(slopes, float), numpy.asarray(shares, float)
    if (numpy.diff(slopes) >= 0.0).any() or (slopes <= 0.0).any():
        raise InputError("stiffness", slopes.tolist(), "slopes of segments that fall from one to the next, all > 0")
    shares = shares / shares.sum()
    breaks = numpy.cumsum(shares * static / slopes)
    stiffness = slopes - numpy.append(slopes[1:], 0.0)
    return stiffness, stiffness * breaks / static


def virgin_curve(stiffness, limits, displacement):
    """Σ min(k_i x, limit_i) for x >= 0: first loading from rest [F], same shape as ``displacement`` x [q].

    ``stiffness`` k_i [F/q] and ``limits`` [F], both (m,).
    """
    x = numpy.asarray(displacement, float)[..., None]
    return numpy.minimum(numpy.asarray(stiffness) * x, numpy.asarray(limits)).sum(axis=-1)


def blocks_energy(parameters, state):
    """Elastic energy Σ F_i² / 2 k_i [F q] of the blocks; ``state``: (n, …), opened by their forces [F].

    ``parameters``: the packed law, (10 + own,).
    """
    n = int(parameters[COUNT])
    return float(numpy.sum(state[:n] ** 2 / (2.0 * parameters[STIFFNESS : STIFFNESS + n])))


@compiled
def _moved_blocks(parameters, state, displacement, limit_factor, keep):
    n = int(parameters[COUNT])
    sign = 1.0 if displacement >= 0.0 else -1.0
    limit = sign * sliding_limit(parameters, sign, 0.0, limit_factor)
    total = 0.0
    for i in range(n):
        force = state[i] + parameters[STIFFNESS + i] * displacement
        bound = parameters[STIFFNESS + n + i] * limit
        if displacement != 0.0 and (force - bound) * sign > 0.0:
            force = bound
        if keep:
            state[i] = force
        total += force
    return total


@compiled
def try_blocks(parameters, state, displacement, limit_factor):
    """Sum of the blocks' forces after a monotone ``displacement``, which is not carried out [F]."""
    return _moved_blocks(parameters, state, displacement, limit_factor, False)


@compiled
def drag_blocks(parameters, state, displacement, limit_factor):
    """Move all blocks by a monotone ``displacement``; return the sum of their forces [F].

    F_i ← clip(F_i + k_i Δ, ± α_i F_s(direction)): exact however far they go, because a block that has
    reached its limit stays there while the direction lasts.
    """
    return _moved_blocks(parameters, state, displacement, limit_factor, True)
