"""Ordinary closed-loop records of the whole axis: the torque balance over everything that moves.

    k_M i = J_t dω/dt + M_f(φ; θ) + (r/N) F_g(x) + M_0

with M_f the generalised Maxwell-slip law driven by the measured motion, J_t the rotor and the reflected
stage, F_g the guideways as the axis file has them (7 % of the whole, so their errors hardly matter, and
nothing here can tell them). Both sides pass one zero-phase low-pass. Rows at rest are left out: there the
friction turns on movements far below one count.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from scipy.optimize import least_squares

from microstage_ros.identification.estimators.acceleration import balance_edge, law_parameters, total_inertia_of
from microstage_ros.identification.estimators.actuator import slip_displacement
from microstage_ros.identification.estimators.estimate import Curve, Estimate, Identification, from_interval, narrow
from microstage_ros.identification.estimators.intervals import block_covariance, correlated_score, correlation
from microstage_ros.model.friction.contact import blocks_of, limit_of
from microstage_ros.model.friction.positions import maxwell_slip_force
from microstage_ros.model.friction.registry import law_named, run_law
from microstage_ros.numerics.filters import low_pass
from microstage_ros.model.transmission import screw_ratio
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.readable import quantity

PARAMETERS = ("coulomb", "drop", "stribeck_velocity", "stribeck_exponent", "viscous", "stiffness", "inertia", "offset")
OF_LAW = 6  # of `PARAMETERS`, the first: those of the friction law
PRIOR = np.array([1.0, 1.0, 1.0, 0.35, 1.0, 1.0, 1.0, 1.0])
"""Standard deviations of the parameters (logarithms; the offset in M_C) about the axis file: they keep finite
what the records do not tell. The exponent is held more closely: a few speeds cannot tell it from the static limit."""
SCALE, LEAST_VARIED = 0.06, 0.01
"""Of M_C: residual beyond which a row counts linearly, and least variability of the friction that is believed."""
METHOD = np.array([0.002, 0.1, 0.08, 0.06, 0.002, 0.15, 0.007, 0.0])
"""What the method itself puts off (low-pass before a nonlinear law), measured on a simulated record without any
noise; added to the standard deviations of the logarithms. The stiffness's is over 22 simulated machines, of which
two lie outside twice of it (0.45 times the truth): their stiffest blocks let go within a count of the encoder."""
DETERMINED_SHARE = 0.5  # determined: the records shrink the prior's deviation at least to this share
SPEED_NOISE = 0.05  # of the Stribeck velocity, that the resolution may put on the speed
WINDUP_EDGE = 50.0  # band of the acceleration that winds the drive train up [Hz]
LEAST_COUNTS = 4  # travel about a row, in counts over a tenth of a second, that counts as motion
BLOCK = 1.0  # residuals hang together over about this time [s]
MOST_LEFT = 0.5  # of the torque: beyond it the record is not of such an axis
EXPONENTS = (0.1, 5.0)  # that an axis file may hold
EXPERIMENT = "the actuator's own experiments (slow reversals, constant speeds) would"


def driven_load(signals, axis):
    """Torque at the motor [N m], shape (n,), of the guideways and the constant force along the record."""
    ratio, gear = screw_ratio(axis), axis.value("transmission.gear_ratio")
    position = ratio * low_pass(signals.angle, min(100.0, 0.2 / signals.period), signals.period)
    viscous = axis.value("contacts.guideway.viscous") if axis.has("contacts.guideway.viscous") else 0.0
    force = viscous * np.gradient(position, signals.period) + axis.value("stage.offset_force")
    if axis.law("guideway") != "none" and limit_of(axis, "guideway") > 0.0:
        stiffness, weight = blocks_of(axis, "guideway")
        force = force + maxwell_slip_force(position, stiffness, weight * limit_of(axis, "guideway"))
    return ratio / gear * force


def with_windup(signals, axis):
    """The record's signals with the angle of the screw in place of that of the stage.

    Between them lies the drive train's wind-up (m a + F_g) / K_c, 40 to 80 nm: little for the friction, but its
    change at a reversal or a start feigns a speed that would shift R by up to a hundredth.
    """
    if signals.at_motor or not axis.has("transmission.stiffness"):
        return signals
    ratio, edge = screw_ratio(axis), min(WINDUP_EDGE, 0.2 / signals.period)
    load = driven_load(signals, axis) * axis.value("transmission.gear_ratio") / ratio
    acceleration = ratio * np.gradient(signals.smooth_speed(edge), signals.period)
    windup = (axis.value("stage.mass") * acceleration + load) / axis.value("transmission.stiffness")
    return replace(signals, angle=signals.angle + windup / ratio)


@dataclass(frozen=True)
class Balance:
    """One record made ready: speed [rad/s] that drives the law, motor acceleration [rad/s²] and torque [N m]
    behind the low-pass, on a coarser period [s]; ``used`` rows count."""

    period: float
    edge: float
    speed: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray
    used: np.ndarray

    def way(self):
        """Travel [rad of the output] and time [s] of the rows that count, shape (used,) each."""
        travel = np.cumsum(np.abs(self.speed)) * self.period
        return travel[self.used], (np.arange(len(self.used)) * self.period)[self.used]


def prepare(signals, axis):
    """`Balance` of one record."""
    edge = balance_edge(signals, axis)
    unit = 0.5 * signals.resolution * 2.0 * math.pi * math.sqrt(2.0 * signals.period / 3.0)
    law_edge = (SPEED_NOISE * axis.value("contacts.actuator.stribeck_velocity") / unit) ** (2.0 / 3.0)
    law_edge = min(max(law_edge, 2.0 * edge), 0.2 / signals.period)
    step = max(int(0.25 / (law_edge * signals.period)), 1)
    speed = signals.smooth_speed(law_edge)
    torque = low_pass(signals.torque - driven_load(signals, axis), edge, signals.period)
    acceleration = axis.value("transmission.gear_ratio") * np.gradient(signals.smooth_speed(edge), signals.period)
    half = int(0.05 / signals.period)
    padded = np.pad(signals.angle, half, mode="edge")
    moving = np.abs(padded[2 * half :] - padded[: -2 * half]) > LEAST_COUNTS * signals.resolution
    travel = np.cumsum(np.abs(speed)) * signals.period
    moving &= travel > 4.0 * slip_displacement(axis)  # by then the unknown first state is wiped out
    cut = int(2.0 / (edge * signals.period))
    moving[:cut] = moving[-cut:] = False
    return Balance(signals.period * step, edge, speed[::step], acceleration[::step], torque[::step], moving[::step])


def _axis_numbers(vector, axis, inertia):
    """Law parameters, inertia and offset of a parameter vector (logarithms against the axis file, offset in M_C)."""
    base = law_parameters(axis)
    coulomb = base["coulomb"] * math.exp(vector[0])
    drop = max(base["static"] - base["coulomb"], 0.02 * base["coulomb"]) * math.exp(vector[1])
    values = {
        **base, "coulomb": coulomb, "static": coulomb + drop,
        "stribeck_velocity": base["stribeck_velocity"] * math.exp(vector[2]),
        "stribeck_exponent": min(max(base["stribeck_exponent"] * math.exp(vector[3]), EXPONENTS[0]), EXPONENTS[1]),
        "viscous": max(base["viscous"], 1e-9) * math.exp(vector[4]),
        "stiffness": tuple(np.asarray(base["stiffness"]) * math.exp(vector[5])),
    }
    return values, inertia * math.exp(vector[6]), base["coulomb"] * vector[7]


def _residual(vector, axis, inertia, balances, friction):
    """What the balance leaves [N m]; ``friction``: that of `_friction`, for the parameters of the law."""
    _, total, offset = _axis_numbers(vector, axis, inertia)
    parts = zip(balances, friction(tuple(vector[:OF_LAW])))
    return np.concatenate([(b.torque - f - total * b.acceleration - offset)[b.used] for b, f in parts])


def _friction(axis, balances, of_law):
    """Friction [N m] behind the low-pass along each record, list of (n,), with the parameters ``of_law``."""
    law = law_named("generalised_maxwell_slip")
    packed = law.pack(_axis_numbers(np.append(of_law, np.zeros(len(PARAMETERS) - OF_LAW)), axis, 0.0)[0])
    return [low_pass(run_law(law, packed, b.speed, b.period), b.edge, b.period) for b in balances]


def independent_share(balances, axis):
    """Independent values of the friction's variability per row that counts [1], in units of `SCALE`: at most 1.

    ``balances``: list of `Balance`.
    A process of correlation length ℓ has one independent value per 2ℓ of its way, of travel or of time; without
    this share thousands of rows of one slow stretch would outweigh any prior.
    """
    travel, time = (2.0 * axis.value(f"variability.{name}_length") for name in ("travel", "time"))
    ratio, count, rows = screw_ratio(axis), 0.0, 0
    for b in balances:
        rows += int(b.used.sum())
        count += b.period * float(np.abs(b.speed[b.used]).sum() * ratio / travel + b.used.sum() / time)
    spread = max(axis.value("variability.relative"), LEAST_VARIED)
    return min(count / rows * (SCALE / spread) ** 2, 1.0)


def _loss(share, free, squares):
    """Cost of squared residuals and its two derivatives (scipy's ``loss``), shape (3, n): rows like ``soft_l1``, each
    for ``share`` of an independent value; the last ``free``, those of the prior, as they are."""
    root = np.sqrt(1.0 + squares)
    found = share * np.array([2.0 * (root - 1.0), 1.0 / root, -0.5 / root**3])
    found[:, -free:] = squares[-free:], np.ones(free), np.zeros(free)
    return found


def _varied_score(jacobian, left, per_torque, weak, balances, axis):
    """Covariance of Wᵀe where the friction varies along travel and time as the axis file has it, shape (p, p).

    e_i = M_i q_i, cov q = σ² [p exp(−Δs / ℓ) + (1 − p) exp(−Δt / τ)] within a record. σ² is such that what is
    ``left`` after the fit has the size that it is expected to have: tr K − tr((WᵀW)⁻¹ WᵀKW) with K = cov e.

    ``jacobian``: W, shape (n, p); ``left``: e, shape (n,); ``per_torque``: e per torque [1/(N m)]; ``weak``: the
    inverse of the information, shape (p, p).
    """
    names = ("travel_length", "time_length", "travel_share")
    length, time, share = (axis.value(f"variability.{name}") for name in names)
    score, start, power, ratio = np.zeros_like(weak), 0, 0.0, screw_ratio(axis)
    for b in balances:
        way, moment = b.way()
        torque = per_torque * b.torque[b.used]
        power += float(torque @ torque)
        part = jacobian[start : start + len(way)] * torque[:, None]
        score += share * correlated_score(part, ratio * way, length)
        score += (1.0 - share) * correlated_score(part, moment, time)
        start += len(way)
    expected = power - float(np.trace(weak @ score))
    return score * float(left @ left) / max(expected, 0.1 * power)


def identify_whole_axis(signals, axis, known):
    """Friction of the actuator, inertia [kg m²] and constant torque [N m] from closed-loop records of the whole axis.

    Parameters
    ----------
    signals : list of `MotorSignals`. axis : `Axis` with what is known so far. known : `Identification`;
        what it has determined is held and not reported again.

    Returns
    -------
    `Identification`; nothing in it where the records hold too little motion.

    Raises
    ------
    InputError : more than half of the torque is left over.
    """
    result = Identification()
    balances = [b for b in (prepare(s, axis) for s in signals) if b.used.sum() > 200]
    if not balances:
        result.remarks.append(f"No motion beyond the slip displacement: friction cannot be determined; {EXPERIMENT}.")
        return result
    inertia = total_inertia_of(axis)
    held = _held(known)
    free = [i for i in range(len(PARAMETERS)) if i not in held]
    scale = SCALE * axis.value("contacts.actuator.coulomb")
    share = independent_share(balances, axis)

    # a derivative by inertia or offset has the friction of the point at which it is taken
    friction = lru_cache(maxsize=len(PARAMETERS))(partial(_friction, axis, balances))

    def residual(shifted):
        part = shifted - 1.0  # about one, so that relative steps of the derivative are sound
        vector = np.zeros(len(PARAMETERS))
        vector[free] = part
        return np.concatenate([_residual(vector, axis, inertia, balances, friction) / scale, part / PRIOR[free]])

    fit = least_squares(residual, np.ones(len(free)), loss=partial(_loss, share, len(free)), diff_step=2e-3,
                        bounds=(-1.5, 3.5), max_nfev=40)
    vector = np.zeros(len(PARAMETERS))
    vector[free] = fit.x - 1.0
    error = _residual(vector, axis, inertia, balances, friction)
    jacobian, left = fit.jac[: len(error)], math.sqrt(share) * error / scale
    information, prior = jacobian.T @ jacobian, np.diag(PRIOR[free] ** -2.0)
    weak = np.linalg.inv(information + prior)
    # in place of the rows' white-noise information
    if axis.value("variability.relative") > 0.0:
        score = _varied_score(jacobian, left, math.sqrt(share) / scale, weak, balances, axis)
    else:
        block = max(int(BLOCK / balances[0].period), 10)
        score = information @ block_covariance(jacobian, left, block) @ information
    covariance = weak @ (score + prior) @ weak
    _report(result, vector, free, covariance, axis, inertia, held)
    torque = np.concatenate([b.torque[b.used] for b in balances])
    if np.std(error) > MOST_LEFT * np.std(torque):
        raise InputError(
            f"{signals[0].source}: current_A against encoder_m",
            f"{np.std(error) / np.std(torque):.0%} of the torque left unexplained",
            f"at most {MOST_LEFT:.0%} by inertia and friction; do the columns belong to one motion, and the axis "
            "file to them?",
        )
    speed = np.concatenate([b.speed[b.used] for b in balances])
    pick = np.linspace(0, len(torque) - 1, min(len(torque), 4000)).astype(int)
    result.curves.append(
        Curve(
            "Torque balance of the whole axis",
            "speed of the output [rad/s]",
            "torque at the motor [N m]",
            speed[pick],
            torque[pick],
            speed[pick],
            (torque - error)[pick],
            residual=error[pick],
        )
    )
    result.remarks.append(
        f"Torque balance: residual {quantity(float(np.std(error)), 'N m')} of {quantity(float(np.std(torque)), 'N m')}"
        " rms."
    )
    expected = _expected(vector, axis, inertia, balances, error)
    if np.std(error) > expected:
        result.remarks.append(
            f"The balance leaves more than the friction's variability explains ({expected * 1e6:.3g} µN m): the stated "
            "errors do not hold. The axis has a cause outside the nominal model, which `diagnose` can name."
        )
    return result


def _expected(vector, axis, inertia, balances, error):
    """Largest residual [N m], rms, of an axis without a cause: twice the friction's variability times the friction
    alone, as a torque that turns an inertia to and fro does not vary, and beside it what the method puts off of the
    inertia's torque. ``error`` [N m]: the residual of the rows that count."""
    total, offset = _axis_numbers(vector, axis, inertia)[1:]
    inertial = np.concatenate([total * b.acceleration[b.used] for b in balances])
    friction = np.concatenate([b.torque[b.used] for b in balances]) - error - inertial - offset
    varied = 2.0 * max(axis.value("variability.relative"), 0.03) * float(np.median(np.abs(friction)))
    return math.hypot(varied, METHOD[6] * float(np.std(inertial)))


def _held(known):
    """Indices of `PARAMETERS` that dedicated experiments have determined."""
    names = {"coulomb": 0, "static": 1, "stribeck_velocity": 2, "stribeck_exponent": 3, "viscous": 4, "stiffness": 5}
    done = {e.key for e in known.estimates.values() if e.determined}
    held = {index for name, index in names.items() if f"contacts.actuator.{name}" in done}
    return held | ({6} if "drive.rotor_inertia" in done else set())


def _report(result, vector, free, covariance, axis, inertia, held):
    """Estimates of what is free; what the prior rules is not determined."""
    values, total, offset = _axis_numbers(vector, axis, inertia)
    full = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    full[np.ix_(free, free)] = covariance + np.diag(METHOD[free] ** 2)
    spread = np.sqrt(np.diag(full))
    determined = spread <= DETERMINED_SHARE * PRIOR
    # static = coulomb + drop, both free: propagate
    slope = np.array([values["coulomb"], values["static"] - values["coulomb"]])
    static_spread = math.sqrt(max(slope @ full[:2, :2] @ slope, 0.0))
    reflected = inertia - axis.value("drive.rotor_inertia")
    friction = "contacts.actuator."
    rows = [
        (0, friction + "coulomb", values["coulomb"], values["coulomb"] * spread[0], "N m"),
        (1, friction + "static", values["static"], static_spread, "N m"),
        (
            2,
            friction + "stribeck_velocity",
            values["stribeck_velocity"],
            values["stribeck_velocity"] * spread[2],
            "rad/s",
        ),
        (3, friction + "stribeck_exponent", values["stribeck_exponent"], values["stribeck_exponent"] * spread[3], "1"),
        (4, friction + "viscous", values["viscous"], values["viscous"] * spread[4], "N m s/rad"),
        (5, "stiffness factor of the actuator", math.exp(vector[5]), math.exp(vector[5]) * spread[5], "1"),
        (6, "drive.rotor_inertia", total - reflected, total * spread[6], "kg m^2"),
        (7, "constant torque", offset, axis.value("contacts.actuator.coulomb") * spread[7], "N m"),
    ]
    for index, key, value, stderr, unit in rows:
        if index not in held:
            estimate = from_interval(
                key,
                value,
                stderr,
                unit,
                method="torque balance, block sandwich",
                experiment=EXPERIMENT,
                floor=values["coulomb"] if index == 7 else 0.0,
            )
            if not determined[index]:
                estimate = replace(
                    estimate,
                    determined=False,
                    remark=f"not determined by these records (they hardly narrow it); {EXPERIMENT}",
                )
            result.add(estimate)
    stiffness = np.asarray(values["stiffness"])
    spreads = stiffness * spread[5]
    if 5 not in held and determined[5] and narrow(stiffness, stiffness - 1.96 * spreads, stiffness + 1.96 * spreads):
        result.add(
            Estimate(
                "contacts.actuator.stiffness",
                stiffness.tolist(),
                "N m/rad",
                spreads.tolist(),
                (stiffness - 1.96 * spreads).tolist(),
                (stiffness + 1.96 * spreads).tolist(),
                method="torque balance: the axis file's blocks times one factor",
            )
        )
    if abs(offset) > max(3.0 * axis.value("contacts.actuator.coulomb") * spread[7], 0.02 * values["coulomb"]):
        result.remarks.append(
            f"A constant torque of {quantity(offset, 'N m')}: an amplifier or current zero, a tilt or a pulling cable; "
            "`diagnose` distinguishes them."
        )
    result.correlations.append((tuple(PARAMETERS[i] for i in free), correlation(covariance)))
