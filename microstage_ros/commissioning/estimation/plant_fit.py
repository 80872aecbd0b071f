"""The linear axis fitted to a measured frequency response in sliding: drive-train resonance, damping, delay,
inertia."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.transmission import motor_ratio

INERTIA, EMF, TRAIN = "drive.rotor_inertia", "drive.back_emf", ("transmission.stiffness", "transmission.damping")
GRID = 24  # starting values of the resonance
SPAN = (0.15, 3.5)  # of the sketched resonance
LEAST_LINES = 8
FLOOR = 0.02  # relative: what the linear model itself leaves


@dataclass(frozen=True)
class PlantFit:
    """Fitted numbers by key of the axis file, their standard deviations (relative), resonance [Hz] and delay [s]."""

    values: dict
    relative: dict
    resonance: float
    resonance_error: float
    delay: float
    delay_error: float
    left: float


def held_response(axis, values, frequency, period, slope, delay):
    """Response [m/V], position at the start of a period to a voltage held over it, shape of ``frequency`` [Hz].

    ``slope``: viscous torque at the motor per motor speed [N m s/rad] (the slope of the sliding curve); force per speed
    of the stage [N s/m] for a drive that has no rotor. ``values``: {key: value in SI units} in place of the axis's.
    ``delay``: from the command to the voltage [s].
    """
    s = 2j * math.pi * frequency
    hold = (1.0 - np.exp(-s * period)) / (s * period) * np.exp(-s * delay)
    get = {**{key: quantity.value for key, quantity in axis.quantities.items()}, **values}
    kind, mass = axis.choices["drive.type"], get["stage.mass"]
    if kind == "force":
        return hold * get["drive.gain"] / (mass * s * s + slope * s)
    if kind == "voice_coil":
        coil, impedance = get["drive.force_constant"], get["drive.resistance"] + s * get["drive.inductance"]
        return hold * (coil / impedance) / (mass * s * s + (slope + coil * coil / impedance) * s)
    q, inertia = motor_ratio(axis), get[INERTIA]
    if kind == "current_motor":
        torque, braking = 1.0 / (1.0 + s / (2.0 * math.pi * get["drive.bandwidth"])), 0.0
    else:
        emf, impedance = get[EMF], get["drive.resistance"] + s * get["drive.inductance"]
        torque, braking = emf / impedance, emf * emf / impedance
    if axis.choices["transmission.type"] == "rigid":
        load, stage = q * q * mass * s * s, q
    else:
        spring = get["transmission.stiffness"] + s * get["transmission.damping"]
        drag = get.get("contacts.guideway.viscous", 0.0)  # left out, it makes the transmission's damping 4 % too large
        stage = q * spring / (mass * s * s + drag * s + spring)
        load = q * spring * (q - stage)
    motor = torque / (inertia * s * s + (slope + braking) * s + load)
    return hold * stage * motor


def resonance_of(axis, values=None):
    """Resonance of the drive train [Hz], motor free; NaN for a rigid transmission.

    ``values``: {key: value in SI units} in place of the axis's.
    """
    values = values or {}
    if axis.choices["transmission.type"] == "rigid":
        return math.nan

    def get(key):
        return values.get(key, axis.value(key))

    q = motor_ratio(axis)
    reduced = 1.0 / (1.0 / get("stage.mass") + q * q / get("drive.rotor_inertia"))
    return math.sqrt(get("transmission.stiffness") / reduced) / (2.0 * math.pi)


def volts_per_acceleration(axis, fit):
    """Voltage per acceleration of the stage [V s²/m] of a DC motor: R (J + q² m)/(K q), with the axis's R and m.

    ``fit``: `PlantFit`, for J [kg m²] and K [V s/rad].
    """
    q = motor_ratio(axis)
    moving = fit.values[INERTIA] + q * q * axis.value("stage.mass")
    return axis.value("drive.resistance") * moving / (fit.values[EMF] * q)


def fit_plant(axis, response, period, slope=0.0, held=()):
    """`PlantFit` of a plant's ``response`` in sliding, `Response`; None where too few lines are coherent.

    ``period``: of control [s]. ``slope``: of the sliding friction, in the units of `held_response`. ``held``: keys that
    keep the axis's value.
    """
    response = response.kept()
    if len(response.frequency) < LEAST_LINES:
        return None
    rigid, emf = axis.choices["transmission.type"] == "rigid", actuator_of(axis).emf_key
    names = INERTIA if axis.has(INERTIA) else "stage.mass", emf, *(() if rigid else TRAIN)
    names = tuple(name for name in names if name and name not in held)
    start = np.array([math.log(max(axis.value(name), 1e-12)) for name in names])
    weight = 1.0 / np.hypot(np.maximum(response.relative, 1e-4), FLOOR)

    def residual(vector):
        values = {name: math.exp(v) for name, v in zip(names, vector[:-1])}
        model = held_response(axis, values, response.frequency, period, slope, vector[-1] * period)
        error = np.log(response.value / model) * weight
        return np.concatenate(
            [error.real, np.arctan2(np.sin(error.imag / weight), np.cos(error.imag / weight)) * weight]
        )

    starts = [np.append(start, 0.0)]
    if not rigid:
        base = resonance_of(axis)
        starts = [np.append(start + np.array([0.0] * (len(names) - 2) + [2.0 * math.log(f), math.log(f)]), d)
                  for f in np.geomspace(*SPAN, GRID) for d in (0.0, 5.0) if base * f < 0.6 / period]
        starts = starts or [np.append(start, 0.0)]
    starts.sort(key=lambda v: float(np.sum(np.minimum(residual(v) ** 2, 1e3))))
    fits = [least_squares(residual, v, loss="soft_l1", max_nfev=60) for v in starts[:3]]
    fit = min(fits, key=lambda f: f.cost)
    freedom = max(len(fit.fun) - len(fit.x), 1)
    scale = max(float(fit.fun @ fit.fun) / freedom, 1.0)
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * scale
    spread = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    values = {name: math.exp(v) for name, v in zip(names, fit.x[:-1])}
    error = 0.5 * spread[names.index(TRAIN[0])] if not rigid else math.nan
    return PlantFit(values, dict(zip(names, spread)), resonance_of(axis, values), error, float(fit.x[-1] * period),
                    float(spread[-1] * period), float(np.sqrt(np.mean((fit.fun / np.tile(weight, 2)) ** 2))))
