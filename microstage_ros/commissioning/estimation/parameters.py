"""From the records of a commissioning to the axis, with uncertainty."""

import math
from dataclasses import replace

import numpy as np

from microstage_ros.commissioning.estimation import force_axis
from microstage_ros.commissioning.estimation.force_axis import MOVING, WELL, identify_force
from microstage_ros.commissioning.estimation.known import load_bounds, moving_mass
from microstage_ros.commissioning.estimation.plant_fit import fit_plant
from microstage_ros.commissioning.estimation.smoothing import smoothed
from microstage_ros.commissioning.sketch import USUAL
from microstage_ros.identification.estimators.estimate import Estimate
from microstage_ros.identification.intake import take_in
from microstage_ros.identification.pipeline import identify
from microstage_ros.identification.torque_constant import TIED
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.transmission import motor_ratio
from microstage_ros.quantities.errors import InputError

FITTED = tuple(f"contacts.actuator.{name}" for name in ("coulomb", "static", "stribeck_velocity", "viscous"))
FAR = math.log(10.0)  # from its first value; the bounds are at a factor of twelve
LARGEST_LOAD = 0.9  # of the moving mass: the rotor keeps a tenth
ROUGHLY = 0.5  # relative standard deviation beyond which no number is called determined
VOLTS_ONLY = (
    "drive.resistance",
    "drive.back_emf",
    "drive.inductance",
    "drive.torque_constant",
    "drive.rotor_inertia",
    "contacts.actuator.static",
    "contacts.actuator.coulomb",
    "contacts.actuator.viscous",
    "constant torque",
)
"""What cannot be determined in its own unit without a current: only together with the sketch's resistance."""

SYSTEMATIC = {
    "drive.resistance": 0.005,
    "drive.back_emf": 5e-4,
    "drive.inductance": 0.25,
    "drive.rotor_inertia": 0.02,
    "stage.mass": 0.05,
    "contacts.actuator.coulomb": 0.035,
    "contacts.actuator.viscous": 0.02,
    "contacts.actuator.static": 0.02,
    "contacts.actuator.stribeck_velocity": 0.05,
    "contacts.actuator.stribeck_exponent": 0.05,
    "variability.relative": 0.2,
    "variability.travel_share": 0.25,
    "variability.travel_length": 0.6,
}
"""Relative standard uncertainty beside that of the records' scatter: friction differs by place and time, sensors are
not ideal, the model's friction law is not the machine's. Calibrated on six machines (seeds 1 to 6), the friction's
curve on sixteen (7501 to 7516: what its variability explains is in the scatter);
`test/commissioning/systematic.py FOLDER...` says from commissionings of simulated machines what each should be."""


def identified(records, axis, sketch, found, response, seed):
    """(`Axis`, estimates by key, remarks) from closed-loop records; a number of both has one standard uncertainty.

    Parameters
    ----------
    records : list of `Record`. axis : as known so far. sketch : `Sketch`. found : `open_loop.Strokes`.
    response : plant `Response` in sliding before any loop was closed, or None. seed : of the bootstrap [1].
    """
    if axis.choices["drive.type"] != "voltage_motor":
        axis, estimates, fit, remarks = identify_force(records, axis, sketch, found, response, seed)
        if fit is not None and axis.has("transmission.stiffness"):
            axis = _drive_train(axis, sketch, fit, estimates, remarks)
        return with_errors_of(axis, estimates), estimates, remarks
    current_free = not found.has_current
    try:
        taken = [take_in(_with_current(r, axis) if current_free else r, axis)[0] for r in records]
        stated = axis if "drive.noise" in sketch.given and not current_free else axis.with_values({"drive.noise": 0.0})
        result = identify(iter(taken), stated, seed)  # a noise that the sketch does not state is held against nothing
        if _far(result, stated):
            result = identify(iter(taken), result.to_axis(stated), seed)
    except InputError as error:
        return (
            axis,
            {},
            [f"The records were not explained by the model ({error}); the numbers of the first measurements stay."],
        )
    estimates, remarks = dict(result.estimates), list(result.remarks)
    if current_free:
        estimates = {
            key: replace(e, determined=False, remark="without a current only voltages are known")
            if key in VOLTS_ONLY
            else e
            for key, e in estimates.items()
        }
        values = {
            e.key: e.value
            for e in result.estimates.values()
            if e.determined
            and axis.has(e.key)
            and e.key not in ("drive.resistance", "drive.back_emf", "drive.inductance")
        }
        axis = axis.with_values(values, source="identified")
    else:
        axis = _tied(result.to_axis(axis), estimates)
    fit = (
        None
        if response is None
        else fit_plant(axis, response, records[0].period_s, slope_of(axis, found), held=("drive.back_emf",))
    )
    if fit is not None:
        axis = _inertia(axis, fit, estimates, current_free)
    if fit is not None and axis.has("transmission.stiffness") and "transmission.stiffness" in fit.values:
        axis = _drive_train(axis, sketch, fit, estimates, remarks)
    shared = guideway_doubt(axis, sketch)
    widened = {key: _widened(e, shared.get(key, 0.0)) for key, e in estimates.items()}
    for key, why in unseen(widened, axis.value("period")).items():
        widened[key] = replace(widened[key], determined=False, remark=why)
    if "drive.inductance" in widened and not widened["drive.inductance"].determined:
        axis = axis.with_values({"drive.inductance": sketch.axis.value("drive.inductance")}, source="estimate")
    return with_errors_of(axis, widened), widened, remarks


def with_errors_of(axis, estimates):
    """The `Axis` with the standard uncertainties of the ``estimates`` (by key), whose numbers it has: the axis file and
    the report say the same of a number, whether it is determined or only the best there is."""
    spreads = {
        key: e.stderr
        for key, e in estimates.items()
        if axis.has(key) and e.stderr is not None and (e.determined or axis.quantity(key).stderr is not None)
        and np.array_equal(axis.value(key), e.value)
    }
    return axis.with_values({key: axis.value(key) for key in spreads}, source="identified", stderr=spreads)


def _far(result, axis):
    """Whether the fit ended near the bounds about its first values: strokes slower than the Stribeck velocity tell
    little of the viscous torque, and what its bound holds back goes into the Coulomb torque.
    """
    found = [
        (result.estimates[key].value, axis.value(key)) for key in FITTED if key in result.estimates and axis.has(key)
    ]
    return any(value > 0.0 and first > 0.0 and abs(math.log(value / first)) > FAR for value, first in found)


def slope_of(axis, found):
    """Viscous torque at the motor per motor speed [N m s/rad]; force per speed of the stage [N s/m] without a rotor.

    ``found``: `open_loop.Strokes`.
    """
    if axis.choices["drive.type"] != "voltage_motor":
        return force_axis.slope_of(axis, found)
    if axis.has("contacts.actuator.viscous"):
        return axis.value("contacts.actuator.viscous") / axis.value("transmission.gear_ratio")
    return 0.0


def guideway_doubt(axis, sketch):
    """Doubt of the actuator's friction, by key, from what the guideway takes of it: the records tell the sum of both at
    the motor.

    δM = q δF, with q [m/rad] the way per motor angle; δF is the guideway's friction times how little is known of it:
    the sketch's tolerance, and as much for having been scaled with the actuator's. Viscous, per speed of the actuator's
    shaft: q² n δb.
    """
    q, found = motor_ratio(axis), {}
    level = next((key for key in ("contacts.guideway.coulomb", "contacts.guideway.static") if axis.has(key)), None)
    if level is not None:
        doubt = math.sqrt(2.0) * sketch.spread(level) * q * axis.value(level)
        found = {"contacts.actuator.coulomb": doubt, "contacts.actuator.static": doubt}
    if axis.has("contacts.guideway.viscous"):
        found["contacts.actuator.viscous"] = (
            math.sqrt(2.0)
            * sketch.spread("contacts.guideway.viscous")
            * q
            * q
            * axis.value("transmission.gear_ratio")
            * axis.value("contacts.guideway.viscous")
        )
    return found


def unseen(estimates, period):
    """Why estimates that the fit returns are not determined after all, by key.

    An electrical time constant L/R below a period (of ``period`` [s]) shows only in exp(−T R/L) of the current's last
    step; the Stribeck velocity and exponent only where the torque falls by more than its own doubt; a number whose
    standard uncertainty is half of it has no symmetric 95 % interval.
    """
    found = {
        key: f"known within some {e.stderr / abs(e.value):.0%} only" if e.stderr < abs(e.value)
        else "its standard uncertainty is its value or more"
        for key, e in estimates.items()
        if e.determined and e.stderr is not None and not isinstance(e.value, list) and e.stderr > ROUGHLY * abs(e.value)
    }
    inductance, resistance = (estimates.get(f"drive.{name}") for name in ("inductance", "resistance"))
    if (
        inductance is not None
        and resistance is not None
        and inductance.determined
        and inductance.value < period * resistance.value
    ):
        found["drive.inductance"] = "the current settles within a control period: shorter periods would tell it"
    static, coulomb = (estimates.get(f"contacts.actuator.{name}") for name in ("static", "coulomb"))
    if static is not None and coulomb is not None and None not in (static.stderr, coulomb.stderr):
        if static.value - coulomb.value < 2.0 * math.hypot(static.stderr, coulomb.stderr):
            found |= {
                key: "the sliding torque does not fall from its static value by more than is in doubt"
                for key in ("contacts.actuator.stribeck_velocity", "contacts.actuator.stribeck_exponent")
                if key in estimates
            }
    return found


def _widened(estimate, shared=0.0):
    """The estimate with its systematic part, and ``shared`` (in its unit); 95 % about the value, and a share within 0
    and 1."""
    part = SYSTEMATIC.get(estimate.key)
    if part is None or not estimate.determined or isinstance(estimate.value, list):
        return estimate
    spread = math.hypot(float(estimate.stderr or 0.0), part * abs(float(estimate.value)), shared)
    low, high = estimate.value - 1.96 * spread, estimate.value + 1.96 * spread
    if estimate.key == "variability.travel_share":
        low, high = max(low, 0.0), min(high, 1.0)
    return replace(estimate, stderr=spread, low=low, high=high)


def _inertia(axis, fit, estimates, current_free):
    """Inertia by the response in sliding: above the corner of back-EMF and friction it alone is in the way of the
    torque; ``current_free``: for the axis's resistance, so it is no estimate."""
    key, unit = "drive.rotor_inertia", "kg m^2"
    value, relative = fit.values[key], fit.relative[key]
    if relative < WELL and current_free:
        return axis.with_values({key: value}, source="identified")
    if relative < WELL:
        spread = relative * value
        estimates[key] = Estimate(
            key, value, unit, spread, value - 1.96 * spread, value + 1.96 * spread, True, "response in sliding"
        )
        return axis.with_values({key: value}, source="identified", stderr={key: spread})
    return axis


def _tied(axis, estimates):
    """The torque constant is the back-EMF constant."""
    emf = axis.value("drive.back_emf")
    estimate = estimates.get("drive.back_emf")
    spread = math.hypot(
        TIED * emf, float(estimate.stderr) if estimate is not None and estimate.determined else 0.1 * emf
    )
    estimates["drive.torque_constant"] = Estimate(
        "drive.torque_constant",
        emf,
        "N m/A",
        spread,
        emf - 1.96 * spread,
        emf + 1.96 * spread,
        estimate is not None and estimate.determined,
        "equals the back-EMF constant",
    )
    return axis.with_values(
        {"drive.torque_constant": emf}, source="identified", stderr={"drive.torque_constant": spread}
    )


def _drive_train(axis, sketch, fit, estimates, remarks):
    """Stiffness and damping by the measured resonance, for the mass that the axis file has: their ratio to it is what
    shows.

    Their standard uncertainty is that of the ratio, so that the file's resonance is as well known as it was measured;
    the interval, and whether they are determined, take the mass's doubt with them.
    """
    mass = sketch.spread("stage.mass")
    values, given = {}, {}
    for key, unit in (("transmission.stiffness", "N/m"), ("transmission.damping", "N s/m")):
        relative = math.hypot(fit.relative[key], mass)
        value = fit.values[key]
        values[key], given[key] = value, fit.relative[key] * value
        why = (
            ""
            if relative < WELL
            else "only its ratio to the mass shows, in the resonance; weighing the stage would tell both"
        )
        estimates[key] = Estimate(
            key,
            value,
            unit,
            given[key],
            value * math.exp(-1.96 * relative),
            value * math.exp(1.96 * relative),
            relative < WELL,
            "response in sliding",
            why,
        )
    doubt = f"within {mass:.0%} (one standard deviation)" if mass < 1.0 else "to its order of magnitude at best"
    remarks.append(
        f"Stiffness and damping of the drive train are those for a stage of {axis.value('stage.mass'):.4g} kg, as in"
        f" axis.yaml, and so are their standard uncertainties: they go with the mass, which is known {doubt}."
    )
    error = fit.resonance_error * fit.resonance
    estimates["resonance of the drive train"] = Estimate(
        "resonance of the drive train",
        fit.resonance,
        "Hz",
        error,
        fit.resonance - 1.96 * error,
        fit.resonance + 1.96 * error,
        True,
        "response in sliding",
    )
    return axis.with_values(values, source="identified", stderr=given)


def _with_current(record, axis):
    """The record with the current that voltage and speed stand for, with the sketch's resistance."""
    _, speed, _ = smoothed(record, record.period_s)
    back = axis.value("drive.back_emf") * speed / motor_ratio(axis)
    current = (np.append(0.0, record.command[:-1]) - back) / axis.value("drive.resistance")
    return replace(record, columns={**record.columns, "current_A": current})


def draws(axis, estimates, count, seed, sketch=None):
    """Axes drawn from the posterior: every determined number independent and log-normal about its value.

    ``count``: of axes [1]; ``seed``: of the draws [1]; ``sketch``: whose tolerances hold for a stage and a rotor of
    which the sum alone is measured. Returns list of `Axis`.
    """
    rng = np.random.default_rng(seed)
    known = [
        e
        for e in estimates.values()
        if e.determined
        and axis.has(e.key)
        and e.stderr is not None
        and not isinstance(e.value, list)
        and axis.value(e.key) > 0.0
        and not e.key.startswith(("variability", "sensors", "transmission"))
    ]
    train, moving = _drive_train_doubt(axis, estimates, sketch), estimates.get(MOVING)
    found = []
    for _ in range(count):
        values = {
            e.key: axis.value(e.key) * math.exp(rng.standard_normal() * min(float(e.stderr) / abs(float(e.value)), 0.5))
            for e in known
        }
        if "contacts.actuator.static" in values and "contacts.actuator.coulomb" in values:
            values["contacts.actuator.static"] = max(
                values["contacts.actuator.static"], 1.01 * values["contacts.actuator.coulomb"]
            )
        if train is not None:
            common, ratio, damping = (math.exp(rng.standard_normal() * part) for part in train)
            values["stage.mass"] = axis.value("stage.mass") * common
            values["transmission.stiffness"] = axis.value("transmission.stiffness") * common * ratio
            values["transmission.damping"] = axis.value("transmission.damping") * common * damping
        if moving is not None and moving.determined:
            total = moving_mass(axis) * math.exp(rng.standard_normal() * moving.stderr / moving.value)
            mass = values.get(force_axis.MASS, axis.value(force_axis.MASS) * total / moving_mass(axis))
            if sketch is not None:
                least, most = load_bounds(sketch, total)
                mass = min(max(mass, least), most)
            values |= _shared_out(axis, total, mass, ratio if train is not None else 1.0)
        found.append(axis.with_values(values, source="estimate"))
    return found


def _shared_out(axis, total, mass, ratio):
    """{key: value} of an axis of which stage and rotor together are known as ``total`` [kg], and the resonance.

    Nothing tells the two apart: of a stage of another ``mass`` [kg] the rotor is the rest, and the drive train keeps
    the resonance, whose square is stiffness over the reduced mass m M/(m + M), times ``ratio`` [1].
    """
    rotor, load = actuator_of(axis).reflected_mass(axis), axis.value(force_axis.MASS)
    mass = min(mass, LARGEST_LOAD * total)
    values = {force_axis.MASS: mass, force_axis.ROTOR: axis.value(force_axis.ROTOR) * (total - mass) / rotor}
    reduced = mass * (total - mass) / total / (load * rotor / (load + rotor))
    train = [key for key in ("transmission.stiffness", "transmission.damping") if axis.has(key)]
    return values | {key: axis.value(key) * reduced * ratio for key in train}


def _drive_train_doubt(axis, estimates, sketch):
    """Standard deviations (logarithms) of the mass, and of stiffness and damping over mass, which the resonance tells;
    None without a resonance. Without a ``sketch`` the mass is in doubt as one that it does not give."""
    if "transmission.stiffness" not in estimates or not axis.has("transmission.stiffness"):
        return None
    ratio, damping = (
        (axis.quantity(key).stderr or 0.0) / axis.value(key)
        for key in ("transmission.stiffness", "transmission.damping")
    )
    mass = sketch.spread("stage.mass") if sketch is not None else math.log1p(USUAL) / math.sqrt(3.0)
    return min(mass, 0.5), min(ratio, 0.5), min(damping, 0.5)
