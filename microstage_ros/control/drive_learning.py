"""What the observer learns about the drive while it runs: delay, resistance, zero, motor constant.

The back-EMF speed leans on the voltage that was applied and on three numbers that change: the resistance
warms up, the amplifier has a gain and a zero, the motor constant spreads. Encoder and back-EMF see the same
motion, so what they disagree on tells (compiled parts of `observer_law`).
"""

from microstage_ros.axis.compiled import compiled

JOLT_TIME = 1e-2  # s, for which a jolt is remembered
LAGS = 4  # voltage delays told apart, in periods


@compiled
def forget_drive(p, s):
    """Nominal R, zero and back-EMF, with all their doubt."""
    s.learned[0] = 1.0
    s.learned[1] = 0.0
    s.learned[2] = 1.0
    s.learned_covariance[:] = 0.0
    s.learned_covariance[0, 0] = p.resistance_spread * p.resistance_spread
    s.learned_covariance[1, 1] = p.zero_spread * p.zero_spread
    s.learned_covariance[2, 2] = p.emf_spread * p.emf_spread
    s.shift[:] = 0.0
    s.jolt = 0.0


@compiled
def find_lag(s, voltage, step):
    """Which past voltage the current follows, from its newest ``step`` [A]; keeps the voltages [V].

    True if it is another one than before.
    """
    for j in range(LAGS, 0, -1):
        s.voltages[j] = s.voltages[j - 1]
    s.voltages[0] = voltage
    best = s.lag
    for j in range(LAGS):
        s.answers[j] += 0.01 * (step * (s.voltages[j] - s.voltages[j + 1]) - s.answers[j])
        if s.answers[j] > 1.5 * s.answers[best]:
            best = j
    change = s.voltages[0] - s.voltages[1]
    s.excitation += 0.01 * (change * change - s.excitation)
    if s.excitation < 1e-6 or best == s.lag:  # 1 mV rms of steps: enough to tell
        return False
    s.lag = best
    return True


@compiled
def settled_drop(p, model, s, current):
    """R i [V] by the nominal R, of the current at the end of the period without its last transient."""
    return model.resistance * ((current - p.transient * s.current) / (1.0 - p.transient))


@compiled
def learn_drive(p, model, s, period, drop, position, speed, trust):
    """Learn R, the amplifier's zero and the back-EMF from the innovations of position [m] and speed [m/s].

    Friedland's two-stage filter: ``shift`` is how far a wrong R (or zero) has led x, v and d astray, so both
    innovations are known multiples of that error. Takes the learned part out of x, v, d.
    """
    noise_x = p.encoder_noise * p.encoder_noise
    noise_v = p.voltage_noise / model.volts_per_velocity
    noise_v *= noise_v
    # while the encoder is far beyond its noise, something else is going on (backlash, a jolt): learn less
    s.jolt = max(abs(position), s.jolt * (1.0 - min(period / JOLT_TIME, 1.0)))
    doubt = max(1.0, s.jolt / (5.0 * p.encoder_noise))
    noise_x *= doubt * doubt
    noise_v *= doubt * doubt
    follow_shift(p, model, s, period, drop, trust)
    for k in range(3):
        spread = p.resistance_spread if k == 0 else (p.zero_spread if k == 1 else p.emf_spread)
        s.learned_covariance[k, k] += spread * spread * period / (p.zero_time if k == 1 else p.forgetting_time)
    speed -= take_in(s, s.of_position, s.of_speed, position, noise_x)
    take_in(s, s.of_speed, s.of_position, speed, noise_v)
    s.learned[0] = min(max(s.learned[0], 0.3), 3.0)
    s.learned[1] = min(max(s.learned[1], -1.0), 1.0)
    # a gain of the amplifier looks like both R and back-EMF, a warm winding like R alone; the motor itself hardly changes
    low, high = min(s.learned[0], 1.0), max(s.learned[0], 1.0)
    s.learned[2] = min(max(s.learned[2], low * (1.0 - p.emf_spread)), high * (1.0 + p.emf_spread))


@compiled
def follow_shift(p, model, s, period, drop, trust):
    """One period of ``shift``, and by how much each innovation changes per unit error of what is learned."""
    emf = model.volts_per_velocity
    for k in range(3):
        shift = s.shift[k]
        direct = drop / emf if k == 0 else (1.0 / emf if k == 1 else s.v)
        shift[0] += shift[1] * period
        shift[1] -= shift[2] * period
        s.of_position[k] = -shift[0]
        s.of_speed[k] = direct - shift[1]
        for j in range(3):
            shift[j] += (trust * p.motion_gain[j, 0] + (1.0 - trust) * p.encoder_gain[j]) * s.of_position[k]
            shift[j] += trust * p.motion_gain[j, 1] * s.of_speed[k]


@compiled
def take_in(s, along, other, innovation, noise):
    """Scalar Kalman step of what is learned: ``innovation`` = along . error + noise of that variance.

    Returns by how much the innovation that goes with ``other`` becomes smaller.
    """
    c = s.learned_covariance
    g0 = c[0, 0] * along[0] + c[0, 1] * along[1] + c[0, 2] * along[2]
    g1 = c[0, 1] * along[0] + c[1, 1] * along[1] + c[1, 2] * along[2]
    g2 = c[0, 2] * along[0] + c[1, 2] * along[1] + c[2, 2] * along[2]
    part = 1.0 / (along[0] * g0 + along[1] * g1 + along[2] * g2 + noise)
    c[0, 0] -= part * g0 * g0
    c[0, 1] -= part * g0 * g1
    c[0, 2] -= part * g0 * g2
    c[1, 1] -= part * g1 * g1
    c[1, 2] -= part * g1 * g2
    c[2, 2] -= part * g2 * g2
    part *= innovation
    s.learned[0] += part * g0
    s.learned[1] += part * g1
    s.learned[2] += part * g2
    s.x -= part * (g0 * s.shift[0, 0] + g1 * s.shift[1, 0] + g2 * s.shift[2, 0])
    s.v -= part * (g0 * s.shift[0, 1] + g1 * s.shift[1, 1] + g2 * s.shift[2, 1])
    s.d -= part * (g0 * s.shift[0, 2] + g1 * s.shift[1, 2] + g2 * s.shift[2, 2])
    return part * (g0 * other[0] + g1 * other[1] + g2 * other[2])


@compiled
def trust_in_speed(p, variance):
    """1 if the back-EMF is as good as the amplifier's noise, towards 0 while R and zero are not known: `voltage_variance`."""
    noise = p.voltage_noise * p.voltage_noise
    return noise / (noise + variance)


@compiled
def voltage_variance(model, s, drop):
    """Variance [V^2] that R, zero and back-EMF leave in the voltage behind the back-EMF."""
    c, emf = s.learned_covariance, model.volts_per_velocity * s.v
    found = c[0, 0] * drop * drop + c[1, 1] + c[2, 2] * emf * emf
    return max(found + 2.0 * (c[0, 1] * drop + c[0, 2] * drop * emf + c[1, 2] * emf), 0.0)
