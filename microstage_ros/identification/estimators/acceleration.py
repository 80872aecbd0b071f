"""What acceleration tells: the inertia at the shaft, and the attraction parameter C of the GMS law.

    k_M i = J dω/dt + M_f(φ, ω_r) + M_0

J from fast sliding, where M_f is Coulomb and viscous friction and the equation is linear; C from the lag of
the friction behind its curve, |s| / C, wherever the speed passes the curve's knee quickly. Both sides pass one
zero-phase low-pass.

Sources: paper, Eqs. 7 and 8 (lag of the slipping blocks); the balance is Newton's at the shaft.
"""

import math

import numpy as np
from scipy.optimize import minimize_scalar

from microstage_ros.identification.estimators.estimate import Estimate, Identification, from_interval, in_short
from microstage_ros.identification.estimators.intervals import block_covariance, profile_interval
from microstage_ros.model.friction.registry import law_named, run_law
from microstage_ros.model.transmission import motor_ratio
from microstage_ros.numerics.filters import low_pass
from microstage_ros.quantities.readable import quantity

NOISE_SHARE = 0.02  # inertial torque that the angle's resolution may feign, of the static torque
SMEAR = 0.003  # of the inertia: what the low-pass carries over from the friction's step at a reversal
SMEAR_DRIVEN = 0.01  # the same where a stage hangs on the shaft by a spring
LAW_EDGE = 1500.0  # low-pass of the speed that drives the friction law [Hz]: well above C / (2π |s|)
FAST = 5.0  # fast sliding: above this many Stribeck velocities
REVERSAL_BLOCK = 0.02  # [s] rows that hang together: more than the band's memory, less than a half wave
LEVEL_PLACES, LEVEL_TIME = 8, 0.5  # places along the stroke, and [s], between which the friction's level runs straight
LEAST_LAG = 0.01  # friction torque by which it must lag, of M_s, at C = 1 N m/s, for C to show at all
ATTRACTION_RANGE = (1e-3, 1e3)  # [N m/s]; outside, the lag is longer than a second or below a microsecond
INERTIA_EXPERIMENT = "fast moves with strong acceleration would (inertial torque above the friction's)"
ATTRACTION_EXPERIMENT = (
    "sines or reversals that pass the Stribeck velocity within a few |s|/C would (8 to 16 Hz, 30 mrad of the output)"
)


def identify_inertia(signals, axis):
    """Rotor inertia [kg m²] and the friction of fast sliding.

    The stage's reflected mass is taken off with the axis file's value.

    Parameters
    ----------
    signals : list of `MotorSignals`.
    axis : gives gear ratio, mass and Stribeck velocity.

    Returns
    -------
    `Identification` with ``drive.rotor_inertia``; not determined without fast sliding.
    """
    gear, result = axis.value("transmission.gear_ratio"), Identification()
    fast = FAST * axis.value("contacts.actuator.stribeck_velocity")
    parts = [_fast_rows(s, gear, fast, balance_edge(s, axis)) for s in signals]
    w, torque = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
    if len(torque) < 500:
        result.add(
            Estimate(
                "drive.rotor_inertia",
                axis.value("drive.rotor_inertia"),
                "kg m^2",
                determined=False,
                remark=f"not determined by these records (no sliding above {fast:.2g} rad/s); {INERTIA_EXPERIMENT}",
            )
        )
        return result
    scale = np.maximum(np.abs(w).max(axis=0), 1e-300)
    values = np.linalg.lstsq(w / scale, torque, rcond=None)[0]
    covariance = block_covariance(w / scale, torque - (w / scale) @ values, max(int(0.1 / signals[0].period), 50))
    values, spread = values / scale, np.sqrt(np.diag(covariance)) / scale
    spread[0] = math.hypot(spread[0], (SMEAR if axis.law("guideway") == "none" else SMEAR_DRIVEN) * values[0])
    reflected = total_inertia_of(axis) - axis.value("drive.rotor_inertia")
    result.add(from_interval("drive.rotor_inertia", values[0] - reflected, spread[0], "kg m^2",
                             method="least squares, block sandwich", experiment=INERTIA_EXPERIMENT))
    result.remarks.append(
        f"Fast sliding: level {in_short(values[1], spread[1], 'N m')}, slope "
        f"{in_short(values[2], spread[2], 'N m s/rad')}, "
        f"constant torque {in_short(values[3], spread[3], 'N m')}."
    )
    return result


def _fast_rows(signals, gear, fast, edge):
    """(dω/dt, sgn, ω_r, 1) and torque of the rows that slide fast, clear of where they do not."""
    speed = signals.smooth_speed(edge)
    torque = low_pass(signals.torque, edge, signals.period)
    clear = int(3.0 / (edge * signals.period))
    slow = np.abs(speed) <= fast
    slow[: 2 * clear] = slow[-2 * clear :] = True
    near = np.convolve(slow, np.ones(2 * clear + 1), "same") > 0.5
    w = np.column_stack([gear * np.gradient(speed, signals.period), np.sign(speed), speed, np.ones_like(speed)])
    return w[~near], torque[~near]


def law_parameters(axis, attraction=None, level=1.0):
    """Parameters of the actuator's law as `model.friction` takes them, with another C if given, its limits times
    ``level`` [1]; ``attraction``: C [N m/s]."""
    keys = (
        "stiffness",
        "weight",
        "static",
        "coulomb",
        "stribeck_velocity",
        "stribeck_exponent",
        "attraction",
        "viscous",
    )
    values = {key: axis.value(f"contacts.actuator.{key}") for key in keys}
    values["stiffness"], values["weight"] = tuple(values["stiffness"]), tuple(values["weight"])
    values["static"], values["coulomb"] = values["static"] * level, values["coulomb"] * level
    return {**values, "attraction": attraction or values["attraction"]}


def friction_along(signals, axis, attraction=None, level=1.0):
    """Friction torque [N m] of the actuator's law, its limits times ``level`` [1], along the record's motion, shape
    (n,); ``attraction``: another C [N m/s]."""
    law = law_named("generalised_maxwell_slip")
    speed = signals.smooth_speed(min(LAW_EDGE, 0.2 / signals.period))
    return run_law(law, law.pack(law_parameters(axis, attraction, level)), speed, signals.period)


def total_inertia_of(axis):
    """Inertia at the motor shaft [kg m²]: the rotor and the reflected stage."""
    ratio = motor_ratio(axis)
    return axis.value("drive.rotor_inertia") + axis.value("stage.mass") * ratio**2


def balance_edge(signals, axis):
    """Band of the balance [Hz]: where J d²φ/dt² of half a count grows to `NOISE_SHARE` of the static torque."""
    allowed = NOISE_SHARE * axis.value("contacts.actuator.static")
    unit = axis.value("drive.rotor_inertia") * axis.value("transmission.gear_ratio") * 0.5 * signals.resolution
    edge = (allowed / (unit * (2.0 * math.pi) ** 2 * math.sqrt(2.0 * signals.period))) ** 0.4
    return min(max(edge, 30.0), 0.1 / signals.period, 500.0)


def identify_attraction(signals, axis):
    """C [N m/s] by profile likelihood; levels along stroke and time and the inertia are fitted along with each C.

    Parameters
    ----------
    signals : list of `MotorSignals` with accelerations.
    axis : the axis with all other friction parameters already identified.

    Returns
    -------
    `Identification` with ``contacts.actuator.attraction``. Where only slower friction is ruled out, the
    estimate is not determined and its remark gives the bound.
    """
    key, edge, result = "contacts.actuator.attraction", balance_edge(signals[0], axis), Identification()
    signals = [s for s in signals if _largest_lag(s, axis, edge) > LEAST_LAG]
    if not signals:
        result.add(
            Estimate(
                key,
                axis.value(key),
                "N m/s",
                determined=False,
                method="profile likelihood",
                remark="not determined by these records (the speed passes the curve's knee too slowly); "
                f"{ATTRACTION_EXPERIMENT}",
            )
        )
        return result
    balances = [_Balance(s, axis, edge) for s in signals]

    def squares(log_c):
        return sum(float(e @ e) for e in (b.left(log_c) for b in balances))

    lowest, highest = np.log(ATTRACTION_RANGE)
    grid = np.linspace(lowest, highest, 15)
    best = _refine(squares, grid, int(np.argmin([squares(c) for c in grid])))
    rows = _rows_that_count(
        balances, best, [[_Balance(s, other, edge) for s in signals] for other in _other_curves(axis)]
    )
    low, high = profile_interval(lambda c: rows * math.log(squares(c)), best, lowest, highest, spread=0.1)
    if axis.value("contacts.actuator.coulomb") / math.exp(best) < signals[0].period:
        high = math.inf  # a lag of less than a period is none that these rows can show
    if not (np.isfinite(low) and np.isfinite(high)):
        bound = (f"above {quantity(math.exp(low), 'N m/s')}" if np.isfinite(low) else
                 f"below {quantity(math.exp(high), 'N m/s')}" if np.isfinite(high) else "anything")
        result.add(
            Estimate(
                key,
                axis.value(key),
                "N m/s",
                low=math.exp(low),
                high=math.exp(high),
                determined=False,
                method="profile likelihood",
                remark=f"not determined by these records (95 %: {bound}); {ATTRACTION_EXPERIMENT}",
            )
        )
    else:
        spread = math.exp(best) * (high - low) / 3.92
        result.add(
            from_interval(
                key,
                math.exp(best),
                spread,
                "N m/s",
                math.exp(low),
                math.exp(high),
                "profile likelihood",
                ATTRACTION_EXPERIMENT,
            )
        )
    return result


class _Balance:
    """Torque of one record against friction, inertia and a constant, for any C.

    The record's friction level goes into the law's limits: 6 % more of it is reached that much later after each
    reversal, by the same stiffness, and would look like a lag, 15 % of C at the paper's values.
    """

    def __init__(self, signals, axis, edge):
        self.signals, self.axis, self.edge = signals, axis, edge
        settled = int(3.0 / (edge * signals.period))
        step = max(int(0.5 / (edge * signals.period)), 1)  # one row per independent value of the band
        self.rows = slice(settled, -settled, step)
        self.torque = low_pass(signals.torque, edge, signals.period)[self.rows]
        speed = signals.smooth_speed(edge)
        acceleration = axis.value("transmission.gear_ratio") * np.gradient(speed, signals.period)
        self.others = np.column_stack([acceleration, np.ones_like(speed)])[self.rows]
        self.levels, self.level = _levels(signals)[self.rows], 1.0
        for _ in range(2):
            w = np.column_stack([self._friction(None), self.others])
            self.level *= float(np.linalg.lstsq(w, self.torque, rcond=None)[0][0])

    def _friction(self, attraction):
        s = self.signals
        return low_pass(friction_along(s, self.axis, attraction, self.level), self.edge, s.period)[self.rows]

    def left(self, log_c):
        """What friction of C = e^log_c, its levels, inertia and a constant leave of the torque, shape (n,)."""
        w = np.column_stack([self._friction(math.exp(log_c))[:, None] * self.levels, self.others])
        return self.torque - w @ np.linalg.lstsq(w, self.torque, rcond=None)[0]


def _levels(signals):
    """Columns by which the friction's level may differ along the stroke and with time, shape (n, p)."""
    time = np.arange(len(signals.angle)) * signals.period
    places = np.linspace(signals.angle.min(), signals.angle.max(), LEVEL_PLACES)
    times = np.linspace(0.0, time[-1], min(max(int(time[-1] / LEVEL_TIME), 1), 20) + 1)
    return np.column_stack([_hats(signals.angle, places), _hats(time, times)[:, 1:]])


def _hats(x, knots):
    """Piecewise linear functions, each 1 at its knot and 0 at the others, shape (n, knots)."""
    return np.column_stack([np.interp(x, knots, unit) for unit in np.eye(len(knots))])


def _other_curves(axis):
    """Axes whose Stribeck curve is off by one standard uncertainty, one for each parameter whose uncertainty is
    known."""
    keys = [f"contacts.actuator.{name}" for name in ("static", "coulomb", "stribeck_velocity", "stribeck_exponent")]
    return [
        axis.with_values({key: axis.value(key) + axis.quantity(key).stderr})
        for key in keys
        if axis.quantity(key).stderr
    ]


def _rows_that_count(balances, best, others):
    """Independent rows n that make n log Σe² as curved at ``best`` as var(ln C) says.

    Only the few rows near a reversal tell of C, and what is left there is neither white nor of the size it has
    elsewhere, so the variance is a block sandwich; to it comes what C moves by with each of ``others``, balances by
    Stribeck curves that are a standard uncertainty off.

        n = Σe² / (var(ln C) Σd²),    d = ∂e/∂ln C

    Source: the vertical scaling of a profile likelihood whose information identity does not hold, R. Chandler,
    S. Bate, "Inference for clustered data using the independence loglikelihood", Biometrika 94 (2007).
    """
    step, period = 0.02, balances[0].rows.step * balances[0].signals.period
    e = np.concatenate([b.left(best) for b in balances])
    d = np.concatenate([(b.left(best + step) - b.left(best - step)) / (2.0 * step) for b in balances])
    variance = block_covariance(d[:, None], e, max(int(REVERSAL_BLOCK / period), 2))[0, 0]
    for other in others:
        moved = np.concatenate([b.left(best) for b in other]) - e
        variance += (float(d @ moved) / float(d @ d)) ** 2
    return float(e @ e) / (variance * float(d @ d))


def _largest_lag(signals, axis, edge):
    """Lag of the friction in its knee at C = 1 N m/s as a share of M_s: (M_s / C) · (M_s − M_C)/w_S · dω_r/dt / M_s.

    Nothing for an angle so coarse that the speed is not known to a thirtieth of the knee.
    """
    knee = axis.value("contacts.actuator.stribeck_velocity")
    drop = axis.value("contacts.actuator.static") - axis.value("contacts.actuator.coulomb")
    if signals.resolution * 2.0 * math.pi * edge * math.sqrt(2.0 * edge * signals.period) > 0.03 * knee:
        return 0.0
    speed = signals.smooth_speed(edge)
    near = np.abs(speed) < 2.0 * knee
    return (
        drop / knee * float(np.quantile(np.abs(np.gradient(speed, signals.period))[near], 0.95)) if near.any() else 0.0
    )


def _refine(function, grid, i):
    """Minimum near grid point i by golden section between its neighbours."""
    bounds = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
    found = minimize_scalar(function, bounds=bounds, method="bounded", options={"xatol": 1e-3})
    return float(found.x)
