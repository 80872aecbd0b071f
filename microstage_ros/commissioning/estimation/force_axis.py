"""From the records of a commissioning to an axis that is commanded with a force, or with a coil's voltage at the stage.

Masses and friction are in the force that is commanded: with another torque constant, or gain, than the amplifier has
they are all off by the same factor.
"""

import math
from dataclasses import replace

import numpy as np

from microstage_ros.commissioning.estimation.known import moving_mass, split_mass
from microstage_ros.commissioning.estimation.plant_fit import fit_plant
from microstage_ros.commissioning.estimation.smoothing import smoothed, window_rows
from microstage_ros.identification.estimators.estimate import Estimate
from microstage_ros.identification.intake import take_in
from microstage_ros.identification.pipeline import identify
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.transmission import motor_ratio
from microstage_ros.quantities.errors import InputError
from microstage_ros.signals.rows import of_row_before

MOVING, MASS, ROTOR = "moving mass", "stage.mass", "drive.rotor_inertia"
WELL = 0.25  # relative standard deviation below which a number counts as determined
SYSTEMATIC = {MOVING: 0.02, "contacts.guideway.coulomb": 0.02, "contacts.guideway.viscous": 0.05, "command": 3e-3}
"""Relative standard uncertainty beside that of the records' scatter, as `parameters.SYSTEMATIC`; ``command``: of
command per ampere and of a coil's resistance and constant."""


def identify_force(records, axis, sketch, found, response, seed):
    """(`Axis`, estimates by key, plant fit or None, remarks) from closed-loop records.

    ``found``: `open_loop.Strokes`; ``response``: `Response` in sliding, or None; ``seed``: of the bootstrap [1]; the
    rest as in `parameters.identified`.
    """
    actuator, constants = actuator_of(axis), _constants(records, axis, found)
    axis = axis.with_values({key: e.value for key, e in constants.items()}, source="identified")
    try:
        taken = [take_in(_without_current(r, axis, found), axis)[0] for r in records]
        result = identify(iter(taken), axis.with_controller({"type": "none"}), seed)
        remarks = list(result.remarks)
    except InputError as reason:
        result, remarks = None, [
            f"The records were not explained by the model ({reason}); the numbers of the first measurements stay."
        ]
    estimates = {} if result is None else dict(result.estimates)
    total, doubt = moving_mass(axis), WELL * moving_mass(axis)
    if MASS in estimates:
        whole = estimates.pop(MASS)
        total, doubt = whole.value + actuator.reflected_mass(axis), whole.stderr
    known = {e.key: e for e in estimates.values() if e.determined and axis.has(e.key)}
    axis = axis.with_values({key: e.value for key, e in known.items()}, source="identified",
                            stderr={key: e.stderr for key, e in known.items()})
    held = (actuator.emf_key,)
    fit = None if response is None else fit_plant(axis, response, records[0].period_s, slope_of(axis, found), held)
    inertia = ROTOR if axis.has(ROTOR) else MASS
    if fit is not None and fit.relative[inertia] < WELL:
        total = moving_mass(axis.with_values(fit.values, source="estimate"))
        doubt = fit.relative[inertia] * total
    estimates |= _masses(sketch, total, math.hypot(doubt, SYSTEMATIC[MOVING] * total), axis)
    estimates |= constants | _friction(estimates, sketch, records)
    values = {key: e for key, e in estimates.items() if axis.has(key) and (e.determined or key in (MASS, ROTOR))}
    axis = axis.with_values({key: e.value for key, e in values.items()}, source="identified",
                            stderr={key: e.stderr for key, e in values.items()})
    return axis, estimates, fit, remarks


def _without_current(record, axis, found):
    """The record without a current that is none."""
    if found.has_current:
        return record
    actuator, columns = actuator_of(axis), {k: v for k, v in record.columns.items() if k != "current_A"}
    if actuator.emf_key:  # what voltage and speed stand for, with the sketch's resistance
        _, speed, _ = smoothed(record, record.period_s)
        drop = np.append(0.0, record.command[:-1]) - actuator.emf_per_speed(axis) * speed
        columns["current_A"] = drop * actuator.amperes_per_command(axis)
    return replace(record, columns=columns)


def _masses(sketch, total, error, axis):
    """Estimates of the moving mass, and of what of it is the stage and the rotor."""
    gain = _gain_doubt(sketch)
    error = math.hypot(error, gain * total)
    found = {MOVING: _estimate(MOVING, total, "kg", error, "response in sliding, force balance")}
    for key, (value, spread) in split_mass(sketch, total, error).items():
        found[key] = _estimate(key, value, "kg" if key == MASS else "kg m^2", spread, "moving mass and sketch",
                               "only the moving mass shows; weighing the stage would tell both")
    if not axis.has(ROTOR):
        del found[MOVING]
    return found


def _friction(estimates, sketch, records):
    """Estimates of the friction with their systematic parts; what the Coulomb force is in doubt by counts as viscous at
    the records' largest speed."""
    found, shared, offset = {}, 0.0, estimates.get("stage.offset_force")
    if offset is not None and offset.determined and _gain_doubt(sketch):
        spread = math.hypot(offset.stderr, _gain_doubt(sketch) * offset.value)
        found["stage.offset_force"] = _estimate("stage.offset_force", offset.value, "N", spread, offset.method)
    fastest = max(float(np.abs(np.diff(r["reference_m"])).max()) / r.period_s for r in records)
    for key in ("contacts.guideway.coulomb", "contacts.guideway.viscous"):
        if key in estimates and estimates[key].determined:
            e = estimates[key]
            part = SYSTEMATIC[key] * abs(e.value)
            spread = math.hypot(e.stderr, part, shared, _gain_doubt(sketch) * e.value)
            found[key] = _estimate(key, e.value, e.unit, spread, e.method)
            shared = part / fastest
    return found


def _constants(records, axis, found):
    """Estimates of the torque constant, or of a coil's resistance and force constant, where there is a current."""
    actuator = actuator_of(axis)
    if not found.has_current:
        return {}
    keys = (("drive.resistance", "ohm"), (actuator.emf_key, "N/A")) if actuator.emf_key else (
        ("drive.torque_constant", "N m/A"),)
    each = np.array([_balance(record, len(keys)) for record in records])
    values, spreads = each.mean(0), np.ptp(each, axis=0) / 2.0
    return {key: _estimate(key, float(value), unit, math.hypot(spread, SYSTEMATIC["command"] * value),
                           "command against current")
            for (key, unit), value, spread in zip(keys, values, spreads)}


def _balance(record, count):
    """Command per ampere, and with ``count`` 2 per speed [V s/m], by least squares of u = R i + K v + o."""
    period, average = record.period_s, np.ones(window_rows(record.period_s)) / window_rows(record.period_s)
    sent, current = (
        np.convolve(v, average, "same") for v in (of_row_before(record.command), np.nan_to_num(record["current_A"]))
    )
    speed = np.convolve(smoothed(record, period)[1], average, "same")
    columns = [current, speed][:count] + [np.ones(len(speed))]
    return np.linalg.lstsq(np.column_stack(columns), sent, rcond=None)[0][:count]


def _gain_doubt(sketch):
    """Relative doubt of the force per command, where nothing but the sketch tells it."""
    return sketch.spread("drive.gain") if "drive.gain" in sketch.axis.quantities else 0.0


def _estimate(key, value, unit, spread, method, why="only its ratio to the force per command shows"):
    determined = spread < WELL * abs(value)
    return Estimate(key, value, unit, spread, value - 1.96 * spread, value + 1.96 * spread, determined, method,
                    "" if determined else why)


def slope_of(axis, found):
    """Viscous torque at the motor per motor speed [N m s/rad]; force per speed of the stage [N s/m] without a rotor.

    ``found``: `open_loop.Strokes`.
    """
    actuator = actuator_of(axis)
    if axis.has(ROTOR):
        return found.volts_per_speed * motor_ratio(axis)
    held = found.viscous if actuator.emf_key else found.volts_per_speed
    return held * actuator.force_per_command(axis)
