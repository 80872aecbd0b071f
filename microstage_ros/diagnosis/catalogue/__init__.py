"""The candidates: one file per family, one line per form."""

from microstage_ros.diagnosis.catalogue import command, drive, electrical, friction, generic, measuring

FORMS = tuple(form for family in (command, friction, drive, electrical, measuring, generic) for form in family.FORMS)


def forms_of(channel):
    """All forms that show in the channel of this name."""
    return tuple(form for form in FORMS if form.channel == channel)


#: Shapes without a name that hold a named one: what they explain beyond it is not that cause.
WIDER = {
    "cable_spring": ("generic:position",), "gravity_tilt": ("generic:position",),
    "direction_asymmetry": ("generic:speed",), "position_dependent_friction": ("generic:friction in time",),
    "viscous_change": ("generic:velocity", "generic:viscous in time"),
    "nonlinear_viscous": ("generic:velocity", "generic:viscous in time"),
    "friction_level_change": ("generic:velocity", "generic:friction in time"),
    "frictional_lag": ("generic:velocity",), "rising_static_friction": ("generic:velocity",),
    "presliding_creep": (), "torque_ripple": (),
    "payload_change": ("generic:velocity",),
    "amplifier_offset": ("generic:voltage",), "amplifier_gain": ("generic:voltage",),
    "amplifier_deadband": ("generic:voltage",), "resistance_rise": ("generic:voltage",),
    "screw_pitch_error": ("generic:voltage",), "backlash": ("generic:voltage",),
    "scale_error": ("generic:position",), "thermal_drift": ("generic:time",), "refractive_index": ("generic:time",),
    "encoder_sde": ("generic:position",), "sampling_jitter": ("generic:direction",),
}

#: A wider effect that contains a simpler one and so always fits as well: no rival of it.
CONTAINS = {"gravity_tilt": ("cable_spring",), "friction_level_change": ("position_dependent_friction",)}
