"""What the observer learns about the drive while it runs: delay, resistance, zero, motor constant.

The back-EMF speed leans on the voltage that was applied and on three numbers that change: the resistance
warms up, the amplifier has a gain and a zero, the motor constant spreads. Encoder and back-EMF see the same
motion, so what they disagree on tells (compiled parts of `observer_law`).
"""

import math

from microstage_ros.axis.compiled import compiled

LAGS = 4  # voltage delays told apart, in periods


@compiled
def forget_drive(p, s):
    """Nominal R, zero and back-EMF, with all their doubt."""
    s.learned[0] = 1.0
    s.learned[1] = 0.0
    s.learned[2] = 1.0
    s.learned_variance[0] = p.resistance_spread * p.resistance_spread
    s.learned_variance[1] = p.zero_spread * p.zero_spread
    s.learned_variance[2] = p.emf_spread * p.emf_spread
    s.shift[:] = 0.0


@compiled
def find_lag(s, voltage, step):
    """Which past voltage the current follows, from its newest ``step`` [A]; keeps the voltages [V]."""
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
    if s.excitation > 1e-6:  # 1 mV rms of steps: enough to tell
        s.lag = best


@compiled
def settled_drop(model, s, period, current):
    """R i [V] by the nominal R, of the current at the end of the period without its last transient."""
    settled = current
    if model.settling > 0.0:
        rest = math.exp(-period / model.settling)
        settled = (current - rest * s.current) / (1.0 - rest)
    return model.resistance * settled


@compiled
def learn_drive(p, model, s, period, drop, position, speed, trust):
    """Learn R and the amplifier's zero from the innovations of position [m] and speed [m/s].

    Friedland's two-stage filter: ``shift`` is how far a wrong R (or zero) has led x, v and d astray, so both
    innovations are known multiples of that error. Takes the learned part out of x, v, d.
    """
    noise_x = p.encoder_noise * p.encoder_noise
    noise_v = p.voltage_noise / model.volts_per_velocity
    noise_v *= noise_v
    # while the encoder is far beyond its noise, something else is going on (backlash, a jolt): learn less
    doubt = max(1.0, abs(position) / (5.0 * p.encoder_noise))
    noise_x *= doubt * doubt
    noise_v *= doubt * doubt
    for k in range(3):
        shift = s.shift[k]
        spread, direct = p.resistance_spread, drop / model.volts_per_velocity
        if k == 1:
            spread, direct = p.zero_spread, 1.0 / model.volts_per_velocity
        elif k == 2:
            spread, direct = p.emf_spread, s.v
        shift[0] += shift[1] * period
        shift[1] -= shift[2] * period
        of_position = -shift[0]
        of_speed = direct - shift[1]
        for j in range(3):
            shift[j] += (trust * p.motion_gain[j, 0] + (1.0 - trust) * p.encoder_gain[j]) * of_position
            shift[j] += trust * p.motion_gain[j, 1] * of_speed
        variance = s.learned_variance[k] + spread * spread * period / p.forgetting_time
        information = of_position * of_position / noise_x + of_speed * of_speed / noise_v
        variance /= 1.0 + variance * information
        s.learned_variance[k] = variance
        change = variance * (of_position * position / noise_x + of_speed * speed / noise_v)
        s.learned[k] += change
        s.x -= shift[0] * change
        s.v -= shift[1] * change
        s.d -= shift[2] * change
        position -= of_position * change
        speed -= of_speed * change
    s.learned[0] = min(max(s.learned[0], 0.3), 3.0)
    s.learned[1] = min(max(s.learned[1], -1.0), 1.0)
    # a gain of the amplifier looks like both R and back-EMF, a warm winding like R alone; the motor itself hardly changes
    low, high = min(s.learned[0], 1.0), max(s.learned[0], 1.0)
    s.learned[2] = min(max(s.learned[2], low * (1.0 - p.emf_spread)), high * (1.0 + p.emf_spread))


@compiled
def trust_in_speed(p, model, s, drop):
    """1 if the back-EMF is as good as the amplifier's noise, towards 0 while R and zero are not known."""
    noise = p.voltage_noise * p.voltage_noise
    emf = model.volts_per_velocity * s.v
    doubt = s.learned_variance[0] * drop * drop + s.learned_variance[1] + s.learned_variance[2] * emf * emf
    return noise / (noise + doubt)


@compiled
def doubt_in_speed(p, model, s, drop):
    """Standard deviation [m/s] that R, zero and back-EMF leave in the speed."""
    emf = model.volts_per_velocity * s.v
    doubt = s.learned_variance[0] * drop * drop + s.learned_variance[1] + s.learned_variance[2] * emf * emf
    return math.sqrt(doubt) / model.volts_per_velocity
