"""The common slip force over one chunk: df/dt = C (1 − f / s(t)), fourth order, exact when s is steady.

With e = f − s(h): de/dt = −ρ e + ρ (s − s(h)), ρ = C/s. ρ and the source are taken as parabolas through
the chunk's start, middle and end, so constant s gives the exact exponential and no error remains in
steady sliding, however long it lasts.
"""

import math

from microstage_ros.axis.compiled import compiled


@compiled
def decay(g):
    """exp(−g) for g ≥ 0: a series (to 1e-7, in Estrin's order, which a processor overlaps) where g is small."""
    if g < 0.5:
        square = g * g
        high = (1 / 24 - g * (1 / 120)) + square * (1 / 720 - g * (1 / 5040))
        return ((1.0 - g) + square * (0.5 - g * (1 / 6))) + square * square * high
    return math.exp(-g)


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

