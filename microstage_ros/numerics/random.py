"""Random numbers of the compiled step: xoshiro256++ and a ziggurat, state in the caller's record.

D. Blackman, S. Vigna, Scrambled linear pseudorandom number generators, ACM TOMS 47 (2021).
J. A. Doornik, An improved ziggurat method to generate normal random samples (2005), 128 layers.
"""

import math

import numpy as np

from microstage_ros.numerics.compiled import compiled, internal, not_inlined

LAYERS = 128
TAIL = 3.442619855899          # right end of the base layer
AREA = 9.91256303526217e-3     # area of one layer


def _layers():
    """Edges X_0 > X_1 > … of the layers and the ratios X_{i+1}/X_i inside which no test is needed."""
    edge = np.zeros(LAYERS + 1)
    f = math.exp(-0.5 * TAIL**2)
    edge[0], edge[1] = AREA / f, TAIL
    for i in range(2, LAYERS):
        edge[i] = math.sqrt(-2.0 * math.log(AREA / edge[i - 1] + f))
        f = math.exp(-0.5 * edge[i] ** 2)
    return edge, edge[1:] / edge[:-1]


EDGE, SAFE = _layers()
UNIT = 1.0 / (1 << 53)
SIGNED_UNIT = 1.0 / (1 << 52)  # of 53 bits with sign
_7, _11, _17, _19, _23, _41, _45 = (np.uint64(n) for n in (127, 11, 17, 19, 23, 41, 45))


def seed_state(seed):
    """State of a generator, uint64 of shape (4,), from any integer ``seed`` >= 0 [1] (numpy's SeedSequence)."""
    return np.random.SeedSequence(seed).generate_state(4, np.uint64)


@internal(makes_arrays=False)
def next_bits(s):
    """Next 64 random bits; advances the state ``s`` (uint64[4])."""
    total = s[0] + s[3]
    result = ((total << _23) | (total >> _41)) + s[0]
    t = s[1] << _17
    s[2] ^= s[0]
    s[3] ^= s[1]
    s[1] ^= s[2]
    s[0] ^= s[3]
    s[2] ^= t
    s[3] = (s[3] << _45) | (s[3] >> _19)
    return result


@compiled(makes_arrays=False)
def uniform(s):
    """Uniform in [0, 1)."""
    return (next_bits(s) >> _11) * UNIT


@compiled(makes_arrays=False)
def normal(s):
    """Standard normal deviate."""
    bits = next_bits(s)
    i = bits & _7
    u = (np.int64(bits) >> 11) * SIGNED_UNIT
    if abs(u) < SAFE[i]:
        return u * EDGE[i]
    return _rare_normal(s, np.int64(i), u)


@internal(makes_arrays=False)
def _rare_normal(s, i, u):
    """`normal` outside the inner rectangle of layer i (one draw in eighty)."""
    not_inlined()
    while True:
        if i == 0:
            x = -math.log(1.0 - uniform(s)) / TAIL
            y = -math.log(1.0 - uniform(s))
            while y + y < x * x:
                x = -math.log(1.0 - uniform(s)) / TAIL
                y = -math.log(1.0 - uniform(s))
            return TAIL + x if u > 0 else -TAIL - x
        x = u * EDGE[i]
        f0 = math.exp(-0.5 * (EDGE[i] ** 2 - x * x))
        f1 = math.exp(-0.5 * (EDGE[i + 1] ** 2 - x * x))
        if f1 + uniform(s) * (f0 - f1) < 1.0:
            return x
        bits = next_bits(s)
        i = np.int64(bits & _7)
        u = (np.int64(bits) >> 11) * SIGNED_UNIT
        if abs(u) < SAFE[i]:
            return u * EDGE[i]
