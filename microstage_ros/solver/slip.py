"""The common slip force over one chunk: df/dt = C (1 − f / s(t)), fourth order, exact when s is steady.

ρ = C/s and the source are taken as parabolas through the chunk's start, middle and end, so constant s gives
the exact exponential and no error remains in steady sliding, however long it lasts.

`relax` takes any s. `near` does the same (but for the quadratures' own error) to first order in the relative
change ε of ρ since the start, which leaves nothing but a few products to be done once the velocities are known:
with G = ρ(0) h, E = e^(−G/2),
e = f(0) − s(0) and de/dt = −ρ (1 + ε) e − ρ ε s(0),

    f(h/2) = s + e E  − G/24 [8 (s + e E) ε_m − (s/E + e E) ε_1]
    f(h)   = s + e E² − G/6  [4 (s + e E) E ε_m + (s + e E²) ε_1]

What it leaves out is of the order of (G ε)²; up to `NEAR` it shows nowhere in the distance from the converged solution.
"""

import math

from microstage_ros.numerics.compiled import compiled, inlined_before_typing, internal
from microstage_ros.solver.vectors import fused

SERIES_END = 0.5
LEAST_OFFSET = 1e-30
NEAR = 1 / 8                   # largest change of the velocity over a chunk, relative, for `near`


@internal
def decay(g):
    """exp(−g) for g ≥ 0: a series (to 1e-7, in Estrin's order, which a processor overlaps) where g is small."""
    if g < SERIES_END:
        return decay_series(g)
    return math.exp(-g)


@inlined_before_typing
def decay_series(g):
    """`decay` below `SERIES_END`."""
    square = g * g
    high = fused(square, fused(g, -1 / 5040, 1 / 720), fused(g, -1 / 120, 1 / 24))
    return fused(square, fused(square, high, fused(g, -1 / 6, 0.5)), 1.0 - g)


@inlined_before_typing
def forgotten(offset):
    """``offset``, or 0 when nothing is left of it.

    It would end as the smallest of all numbers, with which processors are slow.
    """
    return offset if offset > LEAST_OFFSET else 0.0


@compiled
def relax(attraction, f0, s0, s_mid, s1, h):
    """(f(h/2), f(h), exp(−∫ρ)) from f0 and the limits at start, middle and end of a chunk of length h."""
    if math.isinf(attraction):
        return s_mid, s1, 0.0
    r0, rm, r1 = attraction / s0, attraction / s_mid, attraction / s1
    to_mid = h / 24.0 * (5.0 * r0 + 8.0 * rm - r1)
    from_mid = h / 24.0 * (-r0 + 8.0 * rm + 5.0 * r1)
    first, second = decay(to_mid), decay(from_mid)
    source0, source_mid = r0 * (s0 - s1), rm * (s_mid - s1)
    e0 = f0 - s1
    e_mid = first * (e0 + h * (5.0 / 24.0) * source0) + h * (8.0 / 24.0) * source_mid
    e1 = first * second * (e0 + h / 6.0 * source0) + second * (h * 4.0 / 6.0) * source_mid
    return s1 + e_mid, s1 + e1, first * second


@compiled(inline="always")
def near(g, f0, s0):
    """(f(h/2), f(h)) at ε = 0, their derivatives by ε_m and ε_1, and exp(−G).

    As (mid, mid_m, mid_1, end, end_m, end_1, fade).
    """
    return near_with(g, decay(0.5 * g), f0, s0)


@inlined_before_typing
def near_with(g, half, f0, s0):
    """`near`, E = exp(−G/2) given."""
    g_half = 0.5 * g
    rise = fused(g_half, fused(g_half, fused(g_half, 1 / 6, 0.5), 1.0), 1.0)     # 1/E, in a small term
    fade = half * half
    e = f0 - s0
    mid, end = fused(e, half, s0), fused(e, fade, s0)
    part = g * (1 / 24)
    eight = -8.0 * part * mid
    return mid, eight, part * fused(s0, rise, e * half), end, 2.0 * half * eight, -4.0 * part * end, fade


@inlined_before_typing
def change_of_rate(s, slope, bend, turn):
    """(k1, k2) of ε = k1 Δω + k2 Δω², from s, d(1/s)/dw, (d²(1/s)/dw²)/2 and dw/dω."""
    return s * slope * turn, s * bend * (turn * turn)


@inlined_before_typing
def corrections_near(course, pull, f0, grow):
    """`corrections` for `near`'s six numbers ``course``, each as (at ε = 0, its derivatives by ε_m and ε_1)."""
    mid, mid_m, mid_1, end, end_m, end_1 = course
    linear = pull * (fused(4.0, mid, -end)
                     - fused(3.0, f0, grow)), pull * fused(4.0, mid_m, -end_m), pull * fused(4.0, mid_1, -end_1)
    square = pull * (fused(-4.0, mid, 2.0 * f0) + 2.0
                     * end), pull * fused(-4.0, mid_m, 2.0 * end_m), pull * fused(-4.0, mid_1, 2.0 * end_1)
    return linear, square


@inlined_before_typing
def change(k1, k2, turned):
    """ε after a change of ω by ``turned``, see `change_of_rate`."""
    return turned * fused(k2, turned, k1)


@inlined_before_typing
def with_change(parts, by_mid, by_end):
    """A number given as (at ε = 0, its derivatives by ε_m and ε_1), at these ε."""
    return fused(parts[1], by_mid, fused(parts[2], by_end, parts[0]))


@inlined_before_typing
def corrections(pull, f0, f_mid, f1, grow):
    """What the parabola of the slip's torque pull·f through f0, f_mid, f1 adds to pull·(f0 + grow t/h).

    The coefficients of t/h and of (t/h)².
    """
    return pull * (fused(4.0, f_mid, -f1) - fused(3.0, f0, grow)), pull * (fused(-4.0, f_mid, 2.0 * f0) + 2.0 * f1)
