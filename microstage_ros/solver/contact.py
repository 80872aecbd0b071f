"""One friction contact of the compiled step: generalised Maxwell-slip blocks (paper Eqs. 1–8).

Forces are normalised, f_j = F_j / α_j, so that every block slips at the same f = λ s(w), where λ
gathers the factors on the limits (random friction, position, direction, dwell). All slipping blocks
obey the one equation df/dt = C (1 − f / (λ s)), so their weighted mean is one state and their
differences only decay: the contact is a spring (sticking blocks) beside one relaxing force.

Sticking:  df_j/dt = κ_j w with κ_j = k_j/α_j, until f_j sgn(w) ≥ λ s(w).
Slipping:  as above, until w changes sign; then all blocks stick again.
"""

import math

import numpy as np

from microstage_ros.model.friction.curve import stribeck_curve
from microstage_ros.model.plant_record import BLOCKS, CELLS, OCTAVES
from microstage_ros.numerics.compiled import compiled, inlined_before_typing, internal, not_inlined
from microstage_ros.solver.vectors import fused

LOWEST_OCTAVE = -18
FRACTION_BITS = 48                       # mantissa bits below the cell's four
START_MASK = -1 << FRACTION_BITS
ENTRIES = np.uint64(OCTAVES * CELLS)
NO_TABLE = 1 << 40                        # a first cell that no speed reaches
FACTOR_MARGIN = 0.01                      # fall of a random limit factor that needs no new look at the blocks


def sliding_table(static, coulomb, velocity, exponent):
    """(first cell, cubic pieces) of s(w) = F_C + (F_s − F_C) exp(−(w/V)^δ) and of 1/s(w), on CELLS cells per octave.

    ``static`` F_s and ``coulomb`` F_C [F], ``velocity`` V [q/s], ``exponent`` δ [1].

    The pieces, shape (OCTAVES·CELLS, 8), are the coefficients of 1, d, d², d³ of s, then those of 1/s; d is the speed
    beyond the cell's lower edge (through Chebyshev nodes). Cell and d are read off the bits of w, so a look-up costs no
    logarithm. The cells begin about V·2^-18; below, s is a straight line. Relative error below 2e-8 (2e-6 on that
    line).
    """
    lowest = math.floor(math.log2(velocity)) + LOWEST_OCTAVE
    octave = 2.0 ** (lowest + np.repeat(np.arange(OCTAVES), CELLS))
    start, width = octave * (1.0 + np.tile(np.arange(CELLS), OCTAVES) / CELLS), octave / CELLS
    nodes = 0.5 - 0.5 * np.cos(np.pi * (np.arange(4) + 0.5) / 4)
    s = stribeck_curve(start[:, None] + nodes * width[:, None], static, coulomb, velocity, exponent)
    to_powers = np.linalg.inv(np.vander(nodes, 4, increasing=True)).T
    scale = width[:, None] ** np.arange(4)
    return (1023 + lowest) * CELLS, np.hstack([s @ to_powers / scale, (1.0 / s) @ to_powers / scale])


@compiled
def limit(contact, w):
    """s(w) = F_C + (F_s − F_C) exp(−|w/V_S|^δ), without factors (paper Eq. 2); w the speed."""
    bits = np.float64(abs(w)).view(np.int64)
    cell = np.uint64((bits >> FRACTION_BITS) - contact.first_cell)
    if cell >= ENTRIES:
        return _limit_beyond_table(contact, abs(w))
    d = abs(w) - np.int64(bits & START_MASK).view(np.float64)
    c = contact.sliding[cell]
    return c[0] + d * (c[1] + d * (c[2] + d * c[3]))


@internal
def _limit_beyond_table(contact, w):
    """`limit` where there is no drop, or a speed so low that the curve is a line, or so high that it has ended."""
    not_inlined()
    low = contact.velocity * 2.0**LOWEST_OCTAVE
    if contact.drops == 0 or w > low:
        return contact.coulomb
    return contact.static + (contact.sliding[0, 0] - contact.static) * (w / low)


@inlined_before_typing
def limit_and_slopes(contact, w):
    """s(w) as `limit`, 1/s, d(1/s)/dw and (d²(1/s)/dw²)/2 of the cubic pieces that w lies on.

    Without factors, for w > 0.
    """
    bits = np.float64(w).view(np.int64)
    cell = np.uint64((bits >> FRACTION_BITS) - contact.first_cell)
    if cell >= ENTRIES:
        s = _limit_beyond_table(contact, w)
        return s, 1.0 / s, 0.0, 0.0
    d = w - np.int64(bits & START_MASK).view(np.float64)
    return cubics(d, contact.sliding[cell])


@inlined_before_typing
def cubics(d, c):
    """What `limit_and_slopes` returns, of the cubic pieces ``c`` (s, then 1/s) at d."""
    square = d * d
    high = fused(d, c[7], c[6])
    bend = fused(2.0 * d, c[7], high)
    s = fused(square, fused(d, c[3], c[2]), fused(d, c[1], c[0]))
    return s, fused(square, high, fused(d, c[5], c[4])), fused(d, c[6] + bend, c[5]), bend


@inlined_before_typing
def direction_factor(contact, w):
    """1 ± asymmetry, by the direction of motion."""
    return 1.0 + contact.asymmetry if w > 0.0 else 1.0 - contact.asymmetry


@internal
def _flush(contact, c):
    """Add the travel since the last flush to the sticking blocks' forces."""
    for j in range(BLOCKS):
        c.force[j] += c.stuck[j] * contact.kappa[j] * c.stretch
    c.stuck_weight_force = stuck_force(c)
    c.ahead -= c.stretch
    c.behind += c.stretch
    c.stretch = 0.0


@inlined_before_typing
def stuck_force(c):
    """Sum of the sticking blocks' forces."""
    return fused(c.stuck_stiffness, c.stretch, c.stuck_weight_force)


@compiled
def regroup(contact, c):
    """Recompute from the blocks: their sums and the mode's mask; nothing is known to be free of events."""
    not_inlined()
    _flush(contact, c)
    force, stiffness, mask = 0.0, 0.0, 0
    for j in range(contact.blocks):
        if c.stuck[j] == 1.0:
            force += contact.weight[j] * c.force[j]
            stiffness += contact.weight[j] * contact.kappa[j]
            mask |= 1 << j
    c.stuck_weight_force, c.stuck_stiffness, c.mask, c.guard = force, stiffness, mask, -1.0


@inlined_before_typing
def crosses(contact, c, travel, w):
    """Whether after ``travel`` a sticking block has reached its limit at velocity w."""
    stretch = c.stretch + travel
    if (stretch < c.ahead or travel <= 0.0) and (-stretch < c.behind or travel >= 0.0) and abs(w) < c.guard:
        return False
    return _reaches(contact, c, travel, w)


@internal
def _reaches(contact, c, travel, w):
    """`crosses` in full; if not, finds the travel that is free of events up to 1.25 of this speed.

    The direction is that of the travel: the velocity may have changed sign at the very end.
    """
    not_inlined()
    _flush(contact, c)
    sign = 1.0 if travel > 0.0 else -1.0
    top = c.factor * direction_factor(contact, sign) * limit(contact, w)
    for j in range(contact.blocks):
        if c.stuck[j] == 1.0 and (c.force[j] + contact.kappa[j] * travel) * sign >= top:
            return True
    c.guard = 1.25 * abs(w) + 1e-3 * contact.velocity
    c.least_factor = c.factor * (1.0 - FACTOR_MARGIN if contact.random > 0.0 else 1.0)
    safe = c.least_factor * (1.0 - abs(contact.asymmetry)) * min(limit(contact, c.guard), contact.static)
    c.ahead, c.behind = np.inf, np.inf
    for j in range(contact.blocks):
        if c.stuck[j] == 1.0:
            c.ahead = min(c.ahead, (safe - c.force[j]) / contact.kappa[j])
            c.behind = min(c.behind, (safe + c.force[j]) / contact.kappa[j])
    return False


@internal
def stick_all(contact, c):
    """The velocity changed sign: every block sticks with the force it has."""
    not_inlined()
    _flush(contact, c)
    for j in range(contact.blocks):
        if c.stuck[j] == 0.0:
            c.force[j] = c.direction * (c.slip_force + c.force[j] * c.slip_offset)
            c.stuck[j] = 1.0
    c.slip_weight = 0.0
    c.slip_force = 0.0
    c.slip_change = 0.0
    c.slip_offset = 1.0
    regroup(contact, c)


@internal
def release(contact, c, travel, w):
    """Let every sticking block slip that the last ``travel`` brought to its limit; it joins the common slip force."""
    not_inlined()
    _flush(contact, c)
    sign = 1.0 if travel > 0.0 else -1.0
    top = c.factor * direction_factor(contact, sign) * limit(contact, w)
    changed = False
    for j in range(contact.blocks):
        if c.stuck[j] == 1.0 and c.force[j] * sign >= top:
            _join(contact, c, j, sign, top)
            changed = True
    if changed:
        regroup(contact, c)


@internal
def _join(contact, c, j, sign, top):
    """Block j begins to slip: the common force is the weighted mean, the differences are kept."""
    own = top if math.isinf(contact.attraction) else c.force[j] * sign
    before, weight = c.slip_weight, contact.weight[j]
    mean = (before * c.slip_force + weight * own) / (before + weight)
    for i in range(contact.blocks):
        if c.stuck[i] == 0.0:
            c.force[i] = c.force[i] * c.slip_offset + c.slip_force - mean
    c.stuck[j] = 0.0
    c.force[j] = own - mean
    c.slip_force, c.slip_weight, c.slip_offset, c.direction = mean, before + weight, 1.0, sign


@inlined_before_typing
def block_force(c):
    """Σ F_j of all blocks, with sign, or the force of the contact's other law; without the viscous part."""
    return stuck_force(c) + c.direction * c.slip_weight * c.slip_force + c.law_force


@compiled
def slide(contact, c, w):
    """A contact found in motion at velocity w: every block slips, at its limit."""
    sign = 1.0 if w > 0.0 else -1.0
    c.lagged = abs(w)
    for j in range(contact.blocks):
        c.force[j] = sign * c.factor * direction_factor(contact, sign) * limit(contact, w)
    release(contact, c, sign, w)


@internal
def settle_limit(contact, c, w):
    """For blocks that follow their limit at once (C infinite): put the slip force on it."""
    if c.slip_weight > 0.0 and math.isinf(contact.attraction):
        c.slip_force = c.factor * direction_factor(contact, w) * limit(contact, w)
