"""Motor constants from voltage, current and speed: resistance, back-EMF constant, inductance, voltage offset.

In the band in which the speed can be measured the winding has settled to the voltage of the period before,
and it follows the back EMF with the lag L/R,

    i = [u + u_0 − K_E (ω − (L/R) dω/dt)] / R;

linear in 1/R, u_0/R, K_E/R and K_E L/R²; one zero-phase low-pass of all columns leaves that true. Without
the lag R would be a part in a thousand too small, since dω/dt goes with the current. The amplifier's noise
enters after u was recorded and is the equation's own error, so the current is the dependent variable.

Derived: the winding R i + L di/dt = u + u_0 − K_E ω, whose stationary form is Eq. 9 of the paper, with di/dt replaced
by that of the back EMF.
"""

import numpy as np

from microstage_ros.identification.estimators.estimate import Identification, from_interval
from microstage_ros.identification.estimators.intervals import block_covariance, correlation
from microstage_ros.identification.signals import steady_windows, window_means
from microstage_ros.numerics.filters import low_pass
from microstage_ros.quantities.errors import InputError

NAMES = ("drive.resistance", "drive.back_emf", "drive.inductance", "amplifier offset")
UNITS = ("ohm", "V s/rad", "H", "V")
SPEED_EDGE = 150.0  # low-pass of the speed [Hz]
MOST_LEFT = 0.5  # of the current's variance: beyond it voltage and current are not of one motor
FILTERED = 2e-5  # of R and K_E: what the low-pass puts off, where hours of records would claim less
FAST = 0.25  # of the speed's edge: below it the residual may hold a winding that warms up, which is no noise
MOST_NOISE = 2.0  # rms of the residual above `FAST` over that of the noise
"""On healthy simulated axes 0.88 to 0.94 with the angle of the motor and 0.87 to 1.44 with that of the stage, whose
encoder has errors within its signal period too (`test_whole_axis.py`); with a gap of 0.03° at the screw 2.7 to 6.2."""
TIMING = 0.01  # how well the instants of the readings are known [periods]: counts for the inductance alone
EXPERIMENTS = (
    "a record with voltages in both directions, larger than the noise, would",
    "runs at several speeds in both directions would (the faster the better)",
    "runs with strong acceleration would: L/R is shorter than the period and shows as a lag of the back EMF",
    "a record with the motor in both directions would",
)


def identify_motor(signals, axis):
    """R, K_E, L and the zero error of the amplifier, with intervals.

    Parameters
    ----------
    signals : list of `MotorSignals`.
    axis : gives the gear ratio.

    Returns
    -------
    `Identification` with the keys of `NAMES`; the offset in volts at the amplifier's output.

    Raises
    ------
    InputError : voltage and speed do not explain the current.
    """
    gear, period = axis.value("transmission.gear_ratio"), signals[0].period
    parts = [_low_band(s, gear) for s in signals]
    w, i = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
    scale = np.maximum(np.abs(w).max(axis=0), 1e-300)
    values = np.linalg.lstsq(w / scale, i, rcond=None)[0]
    covariance = block_covariance(w / scale, i - (w / scale) @ values, max(int(0.05 / period), 50))
    left = np.var(i - (w / scale) @ values) / max(np.var(i), 1e-300)
    if left > MOST_LEFT:
        raise InputError(
            f"{signals[0].source}: voltage_V against current_A",
            f"{left:.0%} of the current left unexplained",
            f"at most {MOST_LEFT:.0%} by voltage and speed; do the columns belong to one motor?",
        )
    (g, h, o, lag), covariance = values / scale, covariance / np.outer(scale, scale)
    resistance, back_emf = 1.0 / g, h / g
    constants = np.array([resistance, back_emf, resistance * lag / h, o / g])
    # derivatives of (R, K_E, L, u_0) by (1/R, K_E/R, u_0/R, K_E L/R²)
    jacobian = np.array([
        [-(resistance**2), 0.0, 0.0, 0.0],
        [-h * resistance**2, resistance, 0.0, 0.0],
        [-(resistance**2) * lag / h, -resistance * lag / h**2, 0.0, resistance / h],
        [-o * resistance**2, 0.0, resistance, 0.0],
    ])
    spread = jacobian @ covariance @ jacobian.T
    spread[2, 2] += (TIMING * resistance * period) ** 2
    spread[0, 0] += (FILTERED * resistance) ** 2
    spread[1, 1] += (FILTERED * back_emf) ** 2
    result = Identification()
    floors = (0.0, 0.0, 0.0, 0.02)
    for k, key in enumerate(NAMES):
        result.add(
            from_interval(
                key,
                constants[k],
                float(np.sqrt(spread[k, k])),
                UNITS[k],
                method="least squares, block sandwich",
                experiment=EXPERIMENTS[k],
                floor=floors[k],
            )
        )
    result.correlations.append((NAMES, correlation(spread)))
    left = np.concatenate([_fast(i - (w / scale) @ values, s.period) for s, (w, i) in zip(signals, parts)])
    result.remarks += filter(None, [_beyond_noise(left, signals, axis, g, h)])
    return result


def _edge(period):
    """Low-pass of the speed [Hz] at this ``period`` [s]."""
    return min(SPEED_EDGE, 0.2 / period)


def _fast(residual, period):
    """The part of a residual [A], shape (n,), above `FAST` of the speed's edge."""
    return residual - low_pass(residual, FAST * _edge(period), period)


def noise_left(signals, axis, by_voltage, by_speed):
    """Standard deviation [A] that the noise of the axis file alone leaves of the current above `FAST` of the edge.

    White noise of amplifier and current has the share 2 (f₂ − f₁) T of its variance between f₁ and f₂; the speed is
    the derivative of the angle's noise, (2π f)² integrated: (2π)² 2 T (f₂³ − f₁³)/3.

    ``signals``: `MotorSignals`; ``by_voltage``: 1/R [1/ohm], ``by_speed``: K_E/R [A s/rad].
    """
    upper, period = _edge(signals.period), signals.period
    lower = FAST * upper
    counts = 1.0 / np.sqrt(12.0)
    if not signals.at_motor:
        counts = np.hypot(counts, axis.value("sensors.encoder.noise") / axis.value("sensors.encoder.resolution"))
    angle = axis.value("transmission.gear_ratio") * signals.resolution * counts
    white = (by_voltage * axis.value("drive.noise")) ** 2 + axis.value("sensors.current.noise") ** 2
    power = white * 2.0 * (upper - lower) * period
    power += (by_speed * angle * 2.0 * np.pi) ** 2 * 2.0 * period * (upper**3 - lower**3) / 3.0
    return float(np.sqrt(power))


def _beyond_noise(left, signals, axis, by_voltage, by_speed):
    """Sentence where the residual ``left`` [A] stands above the noise; '' where it does not, or the axis file states no
    noise of the amplifier."""
    if axis.value("drive.noise") <= 0.0:
        return ""
    expected = np.sqrt(np.mean([noise_left(s, axis, by_voltage, by_speed) ** 2 for s in signals]))
    times = float(np.std(left) / expected)
    if times <= MOST_NOISE:
        return ""
    return (
        f"Voltage, current and speed leave {times:.2g} times the noise of the axis file above"
        f" {FAST * _edge(signals[0].period):.3g} Hz: the encoder does not show the motor's speed (lost motion, a soft"
        " drive train), or there is more noise than stated. The stated errors do not hold; `diagnose` can name the"
        " cause."
    )


def _low_band(signals, gear):
    """Regressors (u(n−1), −ω, 1, dω/dt) and i(n), all below the speed's edge."""
    edge = _edge(signals.period)
    speed = gear * signals.smooth_speed(edge)
    columns = low_pass(np.column_stack([signals.voltage[:-1], signals.current[1:]]), edge, signals.period)
    w = np.column_stack([columns[:, 0], -speed[1:], np.ones(len(columns)), np.gradient(speed, signals.period)[1:]])
    cut = int(2.0 / (edge * signals.period)) + 1
    return w[cut:-cut], columns[cut:-cut, 1]


def speed_by_voltage(signals, window, resistance, back_emf, gear):
    """Speed of the output [rad/s] of a steady window from voltage and current alone (paper Eq. 9).

    ω_r = (U − R I) / (i K_E), with the voltage of the row before, which the current answers; ``resistance`` R [ohm],
    ``back_emf`` K_E [V s/rad], ``gear``: ratio i [1].
    """
    voltage = np.mean(signals.voltage[window.start - 1 : window.stop - 1])
    current = np.mean(signals.current[window.start : window.stop])
    return float((voltage - resistance * current) / (gear * back_emf))


def cross_check(signals, estimates, axis):
    """Sentence on how far Eq. 9 and the encoder agree over all steady windows; '' where there are none."""
    if not (estimates["drive.resistance"].determined and estimates["drive.back_emf"].determined):
        return ""
    constants = (
        estimates["drive.resistance"].value,
        estimates["drive.back_emf"].value,
        axis.value("transmission.gear_ratio"),
    )
    pairs = np.array(
        [(window_means(s, w)[0], speed_by_voltage(s, w, *constants)) for s in signals for w in steady_windows(s)]
    )
    if not len(pairs):
        return ""
    worst = np.abs(pairs[:, 1] - pairs[:, 0]).max()
    return (
        f"Speed by voltage and current (Eq. 9) against the encoder: {worst:.2g} rad/s apart at most, over "
        f"{len(pairs)} steady runs "
        f"up to {np.abs(pairs[:, 0]).max():.3g} rad/s."
    )
