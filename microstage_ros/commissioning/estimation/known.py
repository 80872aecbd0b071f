"""The axis as far as it is known: the sketch with what the first measurements gave."""

import numpy as np

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
    if axis.choices["drive.type"] == "force":
        mass = found.inertia * axis.value("drive.gain")
        values = {"stage.mass": fit.values["stage.mass"] if fit else mass}
        force = found.friction * axis.value("drive.gain")
        values |= _friction(axis, force)
        return axis.with_values(values, source="estimate")
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
    values |= _friction(axis, found.friction * emf / resistance, ratio)
    if axis.has("contacts.actuator.viscous") and found.has_current:
        viscous = found.viscous * emf / resistance * ratio * axis.value("transmission.gear_ratio")
        values["contacts.actuator.viscous"] = max(viscous, 0.1 * axis.value("contacts.actuator.viscous"))
    return axis.with_values(values, source="estimate")


def _friction(axis, level, ratio=None):
    """Friction limits scaled so that sliding takes ``level`` [N m at the motor; N for a force drive]."""
    at_motor = (
        axis.value("contacts.actuator.coulomb")
        if axis.has("contacts.actuator.coulomb")
        else (axis.value("contacts.actuator.static") if axis.has("contacts.actuator.static") else 0.0)
    )
    at_stage = next((axis.value(key) for key in FRICTION[:1:-1] if axis.has(key)), 0.0)
    expected = at_motor + (at_stage * ratio if ratio else at_stage)
    factor = float(np.clip(level / max(expected, 1e-12), *LIMITS))
    return {key: axis.value(key) * factor for key in FRICTION if axis.has(key)}
