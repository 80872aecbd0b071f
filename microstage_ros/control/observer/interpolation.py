"""The encoder's error of interpolation, learned where the axis is too fast to follow it (compiled parts of
`observer_law`).

Offsets, amplitudes and phase of the two signals of a scale of period p leave an error of the reading y of two harmonics
(P. L. M. Heydemann, Applied Optics 20 (1981) 3382):

    e(y) = a_1 sin φ + b_1 cos φ + a_2 sin 2φ + b_2 cos 2φ,    φ = 2π y/p

A slow axis is led along it, and nothing tells. At a speed v it comes at the frequency v/p, which neither the axis nor
the motion filter follows: of the first harmonic the innovation of the position keeps 0.85 at `LEAST_FREQUENCY`, 34
degrees ahead, and all beyond 200 Hz. What is left of it in the innovation is taken into the four coefficients, each by
a Kalman filter of its own, since the harmonics are orthogonal over whole periods; the reading is corrected by e(y) at
every speed. Nothing is learned while the loop swings. A phase below 90 degrees makes the learning slower, not wrong: it
ends where the innovation holds no harmonic.
"""

from microstage_ros.numerics.compiled import compiled
from microstage_ros.numerics.turns import sine_and_cosine

LEAST_FREQUENCY = 80.0  # Hz, of the first harmonic: derived from the gains of the shipped motion filter, see above
MOST_TURNS = 0.2  # of the first harmonic per period: the second stays below half the sampling rate
# signal periods of a fast motion that are passed over, since what its start leaves belongs to one place: calibrated
# with `robustness --moves 1003`, whose moves of 10 um taught 3 nm that are not there
FIRST_TURNS = 3.0
# s, for which a swing of the loop makes innovations alike: the readings of such a time count as one. With each for
# itself, a swing near v/p was learned within 50 ms, and what was taken off kept it up: calibrated with
# `robustness --random 200 --first 8200 --seeds 5 --seed 12400 --beside self_tuning` (5 machines lost by it)
CORRELATED = 1e-2
# s in fast motion, in which a coefficient may change by its spread: 0.3 nm in a second, some millimetres of scale
CHANGE_TIME = 1000.0
FIELDS = [
    ("interpolation", "f8", 4),  # m: a_1, b_1, a_2, b_2
    ("interpolation_variance", "f8", 4),  # m^2
    ("harmonics", "f8", 4),  # sin φ, cos φ, sin 2φ, cos 2φ of the newest reading
    ("fast_turns", "f8"),  # signal periods passed since the axis has been fast
    ("interpolated", "f8"),  # m, error of the newest reading as far as it is known
]


@compiled
def interpolation_reset(p, s):
    """Nothing is known but the spread."""
    s.interpolation[:] = 0.0
    s.interpolation_variance[:] = p.interpolation_spread * p.interpolation_spread
    s.harmonics[:] = 0.0
    s.fast_turns = s.interpolated = 0.0


@compiled
def interpolation_error(p, model, s, encoder):
    """Known error [m] of the reading ``encoder`` [m]."""
    if p.interpolation_spread == 0.0 or model.signals_per_metre == 0.0:
        return 0.0
    sine, cosine = sine_and_cosine(model.signals_per_metre * encoder)
    h, a = s.harmonics, s.interpolation
    h[0], h[1], h[2], h[3] = sine, cosine, 2.0 * sine * cosine, cosine * cosine - sine * sine
    s.interpolated = a[0] * h[0] + a[1] * h[1] + a[2] * h[2] + a[3] * h[3]
    return s.interpolated


@compiled
def learn_interpolation(p, model, s, period, position, expected):
    """Take in one innovation ``position`` [m] of the variance ``expected`` [m^2]."""
    if p.interpolation_spread == 0.0:
        return
    frequency = abs(s.v) * model.signals_per_metre
    if frequency < LEAST_FREQUENCY or frequency * period > MOST_TURNS:
        s.fast_turns = 0.0
        return
    s.fast_turns += frequency * period
    if s.fast_turns < FIRST_TURNS:
        return
    h, c = s.harmonics, s.interpolation_variance
    walk = p.interpolation_spread * p.interpolation_spread * period / CHANGE_TIME
    variance = max(expected, s.noise) * max(CORRELATED / period, 1.0)
    for j in range(4):
        variance += c[j] * h[j] * h[j]
    for j in range(4):
        gain = c[j] * h[j] / variance
        s.interpolation[j] += gain * position
        c[j] += walk - gain * h[j] * c[j]
