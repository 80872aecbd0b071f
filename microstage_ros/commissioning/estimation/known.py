"""The axis as far as it is known: the sketch with what the first measurements gave."""

import math

import numpy as np

from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.transmission import motor_ratio

FRICTION = (
    "contacts.actuator.static",
    "contacts.actuator.coulomb",
    "contacts.guideway.static",
    "contacts.guideway.coulomb",
)
LIMITS = (0.05, 20.0)  # factors on the sketched friction


def known_axis(sketch, found, fit=None):
    """`Axis` with the numbers that open-loop strokes, and the response where there is one, determined.

    The torque constant is the back-EMF constant: in SI those of a DC motor are one number.

    Parameters
    ----------
    sketch : `Sketch`. found : `open_loop.Strokes`. fit : `plant_fit.PlantFit` or None.
    """
    axis = sketch.axis
    if axis.choices["drive.type"] != "voltage_motor":
        return _forced(sketch, found, fit)
    ratio, resistance = motor_ratio(axis), found.resistance
    emf = max(found.volts_per_speed, 1e-9) * ratio
    if not found.has_current:  # the viscous part of the friction cannot be distinguished from back-EMF
        emf = min(emf, axis.value("drive.back_emf") * (1.0 + sketch.tolerance["drive.back_emf"]))
    inertia = found.inertia * emf * ratio / resistance - ratio * ratio * axis.value("stage.mass")
    values = {
        "drive.resistance": resistance,
        "drive.back_emf": emf,
        "drive.torque_constant": emf,
        "drive.rotor_inertia": max(inertia, 0.05 * axis.value("drive.rotor_inertia")),
    }
    if fit is not None and axis.choices["transmission.type"] != "rigid":
        values |= {key: fit.values[key] for key in ("transmission.stiffness", "transmission.damping")}
    values |= _friction(axis.with_values(values, source="estimate"), found.friction)
    if axis.has("contacts.actuator.viscous") and found.has_current:
        viscous = found.viscous * emf / resistance * ratio * axis.value("transmission.gear_ratio")
        values["contacts.actuator.viscous"] = max(viscous, 0.1 * axis.value("contacts.actuator.viscous"))
    return axis.with_values(values, source="estimate")


def _forced(sketch, found, fit):
    """`known_axis` of a drive whose command is a force, or a voltage on a coil straight at the stage."""
    axis, actuator = sketch.axis, actuator_of(sketch.axis)
    values = {}
    if actuator.emf_key:
        values = {"drive.resistance": found.resistance, actuator.emf_key: max(found.volts_per_speed, 1e-9)}
        if not found.has_current:
            values = {}
    elif found.has_current:
        values = {"drive.torque_constant": found.resistance}
    axis = axis.with_values(values, source="estimate")
    per_command = actuator.force_per_command(axis)
    total = found.inertia * per_command
    if fit is not None:
        total = moving_mass(axis.with_values(fit.values, source="estimate"))
        if axis.has("drive.bandwidth"):  # what the response lags beyond the sketched current loop
            lag = 1.0 / (2.0 * math.pi * axis.value("drive.bandwidth")) + fit.delay
            values["drive.bandwidth"] = 1.0 / (2.0 * math.pi * max(lag, 0.1 * axis.value("period")))
        values |= {key: fit.values[key] for key in fit.values if key.startswith("transmission.")}
    values |= {key: value for key, (value, _) in split_mass(sketch, total).items()}
    values |= _friction(axis, found.friction)
    if axis.has("contacts.guideway.viscous"):
        viscous = (found.viscous if actuator.emf_key else found.volts_per_speed) * per_command
        values["contacts.guideway.viscous"] = max(viscous, 0.1 * axis.value("contacts.guideway.viscous"))
    return sketch.axis.with_values(values, source="estimate")


def breakaway(axis):
    """Command [V, N m or N] at which both contacts of an axis break away; 0 without friction."""
    model = controller_parameters("pid_feedforward", axis, {})["feedforward"]
    torque = float(model["volts_per_torque"]) * float(model["actuator"][0]) if model["has_actuator"] else 0.0
    force = float(model["volts_per_force"]) * float(model["guideway"][0]) if model["has_guideway"] else 0.0
    return torque + force


def moving_mass(axis):
    """Stage and reflected rotor [kg]."""
    return axis.value("stage.mass") + actuator_of(axis).reflected_mass(axis)


def split_mass(sketch, total, error=0.0):
    """{key: (value, standard deviation)} of the stage's mass and the rotor's inertia that together move as ``total``
    [kg], known within ``error`` [kg].

    The motion tells the sum alone. What it departs from the sketch's falls to each by the square of its doubt there:
    the least-squares answer; the sum is never shared out by less than a tenth of the sketch's.
    """
    axis = sketch.axis
    rotor, load = actuator_of(axis).reflected_mass(axis), axis.value("stage.mass")
    doubts = sketch.spread("stage.mass") * load, sketch.spread("drive.rotor_inertia") * rotor if rotor else 0.0
    both = math.hypot(*doubts) or 1.0
    more, share = total - rotor - load, (doubts[0] / both) ** 2 if rotor else 1.0
    left = doubts[0] * doubts[1] / both
    found = {"stage.mass": (max(load + share * more, 0.1 * load), math.hypot(left, share * error))}
    if rotor:
        reflected = max(total - found["stage.mass"][0], 0.1 * rotor)
        scale = axis.value("drive.rotor_inertia") / rotor
        found["drive.rotor_inertia"] = reflected * scale, math.hypot(left, (1.0 - share) * error) * scale
    return found


def load_bounds(sketch, total):
    """(least, greatest) mass of the stage [kg] of a machine that moves ``total`` [kg]: by the sketch's tolerances of
    stage and rotor; where the two contradict each other, by the stage's."""
    load, rotor = sketch.axis.value("stage.mass"), actuator_of(sketch.axis).reflected_mass(sketch.axis)
    factor, other = (1.0 + sketch.tolerance[key] for key in ("stage.mass", "drive.rotor_inertia"))
    own = load / factor, load * factor
    both = max(own[0], total - rotor * other), min(own[1], total - rotor / other)
    return both if both[0] < both[1] else own


def _friction(axis, level):
    """Friction limits scaled so that sliding takes ``level`` [unit of the command]."""
    model = controller_parameters("pid_feedforward", axis, {})["feedforward"]
    at_motor, at_stage = (
        next((axis.value(key) for key in keys if axis.has(key)), 0.0) for keys in (FRICTION[1::-1], FRICTION[:1:-1])
    )
    expected = at_motor * float(model["volts_per_torque"]) + at_stage * float(model["volts_per_force"])
    factor = float(np.clip(level / max(expected, 1e-12), *LIMITS))
    return {key: axis.value(key) * factor for key in FRICTION if axis.has(key)}
