"""Dead band of the amplifier, and R where the current is noisy: from means of voltage and current in slow motion.

An amplifier with a dead band b gives D(u) = u - b sgn(u) beyond it and nothing within. At low speed v the current says
what it gave, so with the nominal resistance and the back-EMF taken off

    e = u - R i - E v = o + [u - D(u)] + rho D(u),

o the zero, v of the encoder, rho = 1 - R / R_true: within the band e rises with u however wrong R is, beyond it a wrong
R bends it and b does not. The means of u and e are kept in bins of u, and o, rho are solved for by least squares for
each b of a grid, one per period; the b with the least weighted sum of squares is taken where it is significantly less
than that of b = 0. The command then goes over the band. (Tao, Kokotovic, "Adaptive Control of Systems with Actuator and
Sensor Nonlinearities", Wiley 1996, chapter 3: the inverse of a dead zone.)
"""

import math

from microstage_ros.numerics.compiled import compiled

# V, of |u|
EDGES = (0.0, 3e-3, 6e-3, 9e-3, 1.2e-2, 1.6e-2, 2.4e-2, 3.2e-2, 4.8e-2, 6.4e-2, 9.6e-2, 0.128, 0.192)
BINS = len(EDGES) - 1
SLOW = 2e-2  # V, back-EMF beyond which a wrong motor constant would weigh
STEADY_STEP = 1e-2  # V, change of the voltage from one period to the next beyond which its delay would weigh
SPEED_TIME = 5e-3  # s, over which the encoder's speed is averaged
# V, back-EMF by which that average may lag; beyond, it changes faster than is allowed for: in moves of 10 um with half
# the friction a dead band of 23 to 39 mV was found that was none. Calibrated with `test_dead_band.py`
MOST_LAG = 5e-3
FLOOR = 5e-4  # V, error of a bin's mean that is no noise
FIRST, RATIO, COARSE = 2.5e-3, 1.13, 34  # V, the grid of b: FIRST RATIO^k
FINE, FINE_STEP = 13, 0.01  # about the best of it
SIGNIFICANT = 40.0  # fall of the weighted sum of squares by one more parameter: more than 6 standard deviations
EXPLAINED, REFUTED = 0.05, 0.5
"""Share of the sum of squares left at most by a dead band (below 1 % on simulated axes; what lost motion leaves behind
looks like one that leaves 23 % and more), and from which on there is none."""

LEAST_COUNT = 30.0  # readings in a bin that counts
LEAST_BINS = 6
LARGEST_RHO = 0.8  # R five times nominal
REST_TIME = 0.2  # s, from one pass over the grid to the next
MEMORY = 2e4  # readings in a bin after which older ones fade
INVERSE_WIDTH = 3e-3  # V, of command about zero over which the inverse rises: no step for the noise to play with
FIELDS = [
    ("dead_band", "f8"),  # V, half width
    ("band_bins", "f8", (2 * BINS, 3)),  # readings, mean of u [V], mean of e [V]; negative u first
    ("band_least", "f8"),  # least weighted sum of squares of this pass
    ("band_best", "f8"),  # V, where it was
    ("band_centre", "f8"),  # V, of the coarse grid's best
    ("band_none", "f8"),  # that of no dead band
    ("band_turn", "i8"),  # place in the pass
    ("band_wait_s", "f8"),  # s, since the last one
    ("binned_resistance", "f8"),  # 1, R over nominal by the bins, which noise of the current does not bias
    ("binned_spread", "f8"),  # 1, its standard deviation; infinite where nothing is known
    ("band_voltage", "f8"),  # V, of the period before
    ("band_speed", "f8"),  # m/s, by the encoder
    ("band_lag", "f8"),  # V, largest back-EMF by which it has lagged of late
]


@compiled
def dead_band_reset(s):
    """No dead band."""
    s.dead_band = 0.0
    forget_bins(s)
    s.band_least = 0.0
    s.band_best = 0.0
    s.band_centre = 0.0
    s.band_none = 0.0
    s.band_voltage = 0.0
    s.band_speed = s.band_lag = 0.0


@compiled
def forget_bins(s):
    """What was read from another drive."""
    s.band_bins[:] = 0.0
    s.band_turn = 0
    s.band_wait_s = 0.0
    s.binned_resistance = 1.0
    s.binned_spread = math.inf


@compiled
def beyond_band(voltage, band):
    """What an amplifier of dead band ``band`` [V] gives for ``voltage`` [V]."""
    return voltage - min(max(voltage, -band), band)


@compiled
def over_band(voltage, band):
    """The command [V] for which such an amplifier gives ``voltage`` [V] (nearly, within `INVERSE_WIDTH` of zero)."""
    return voltage + band * min(max(voltage / INVERSE_WIDTH, -1.0), 1.0)


@compiled
def watch_dead_band(s, period, voltage, drop, constant, speed):
    """One period of the ``voltage`` [V] commanded and nominal R i = ``drop`` [V]. True where a dead band was found that
    was not known: what was learned without it (R, zero, a gap) does not hold.

    constant : back-EMF over speed [V s/m]. speed : of the encoder in this period [m/s]: the estimated one leans on the
        voltage that is in question.
    """
    step = abs(voltage - s.band_voltage)
    s.band_voltage = voltage
    s.band_wait_s += period
    size = abs(voltage)
    s.band_speed += min(period / SPEED_TIME, 1.0) * (speed - s.band_speed)
    lag = constant * SPEED_TIME * s.planned_acceleration
    s.band_lag = max(abs(lag), s.band_lag * (1.0 - min(period / SPEED_TIME, 1.0)))
    emf = constant * s.band_speed + lag
    if abs(emf) < SLOW and s.band_lag < MOST_LAG and step < STEADY_STEP and size < EDGES[BINS]:
        k = 0
        while size >= EDGES[k + 1]:
            k += 1
        row = s.band_bins[BINS + k if voltage > 0.0 else BINS - 1 - k]
        row[0] = min(row[0] + 1.0, MEMORY)
        row[1] += (voltage - row[1]) / row[0]
        row[2] += (voltage - drop - emf - row[2]) / row[0]
    return s.band_wait_s > REST_TIME and scan(s)


@compiled
def scan(s):
    """One candidate of the grid; at its end the best is taken, if it is significant. True where that is the first."""
    turn = s.band_turn
    s.band_turn += 1
    if turn == 0:
        s.band_none = s.band_least = left(s, 0.0)
        s.band_best = 0.0
    elif turn <= COARSE + FINE:
        near = turn - COARSE - 1 - FINE // 2
        if turn == COARSE + 1:
            s.band_centre = s.band_best
        band = FIRST * RATIO ** (turn - 1) if turn <= COARSE else s.band_centre * (1.0 + FINE_STEP * near)
        found = left(s, band)
        if found < s.band_least:
            s.band_least, s.band_best = found, band
    else:
        known = s.dead_band > 0.0
        if s.band_least < min(s.band_none - SIGNIFICANT, EXPLAINED * s.band_none):
            s.dead_band = s.band_best
        elif s.band_least > REFUTED * s.band_none:
            s.dead_band = 0.0
        read_resistance(s)
        s.band_turn = 0
        s.band_wait_s = 0.0
        return s.dead_band > 0.0 and not known
    return False


@compiled
def left(s, band):
    """Weighted sum of squares that the best o and rho leave with this ``band`` [V]; 0 where too few bins are filled."""
    sxx, sxy, syy = moments(s, band)
    return syy - sxy * sxy / sxx if sxx > 0.0 else syy


@compiled
def read_resistance(s):
    """R over nominal from rho = 1 - R / R_true: the bins are those of the command, so noise of the current, averaged in
    them, biases nothing (an instrumental variable; Söderström, Stoica, "System Identification", Prentice Hall 1989,
    chapter 8)."""
    sxx, sxy, _ = moments(s, s.dead_band)
    if sxx > 0.0 and sxy < LARGEST_RHO * sxx:
        s.binned_resistance = 1.0 / (1.0 - sxy / sxx)
        s.binned_spread = s.binned_resistance * s.binned_resistance / math.sqrt(sxx)


@compiled
def moments(s, band):
    """Weighted sums of squares and products about their means of D(u) and e - [u - D(u)]; 0 where too few bins are
    filled."""
    noise = s.voltage_noise * s.voltage_noise
    n = sx = sy = sxx = sxy = syy = 0.0
    filled = 0
    for k in range(2 * BINS):
        count, voltage, found = s.band_bins[k, 0], s.band_bins[k, 1], s.band_bins[k, 2]
        if count < LEAST_COUNT:
            continue
        filled += 1
        x = beyond_band(voltage, band)
        y = found - (voltage - x)
        weight = 1.0 / (noise / count + FLOOR * FLOOR)
        n += weight
        sx += weight * x
        sy += weight * y
        sxx += weight * x * x
        sxy += weight * x * y
        syy += weight * y * y
    if filled < LEAST_BINS:
        return 0.0, 0.0, 0.0
    return sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
