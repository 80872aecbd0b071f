"""The catalogue in a technician's words: what an effect is called, and what one does about it."""

from microstage_ros.report.plots import quantity

MOST = 3                       # sizes told in a sentence
SUFFIXES = ("_rad", "_m", "_s", "_kg", "_N_m", "_Nm", "_V", "_hz", "_N", "_K", "_Pa", "_m_s")

#: id: (name, what to do next)
WORDS = {
    "direction_asymmetry": ("Friction differs between directions",
                            "Look at preload and seals of nut and bearings; feed forward each direction with its own friction."),
    "position_dependent_friction": ("Friction varies along the stroke",
                                    "Clean and grease the guide and the screw; check their alignment where friction is highest."),
    "rising_static_friction": ("Breakaway grows with time at rest",
                               "Expect larger first moves after a pause; an exercise move before precise work avoids it."),
    "frictional_lag": ("Friction lags behind speed", "Lubricant film: check grease and its temperature; let the observer use the lag."),
    "presliding_creep": ("The axis creeps under load at rest", "Keep the loop closed while holding, or unload the contact before a wait."),
    "viscous_change": ("Viscous friction differs", "Check grease, its amount and its temperature."),
    "nonlinear_viscous": ("Friction is not linear in speed", "Use the extended friction curve in feed-forward; check lubricant and seals."),
    "friction_level_change": ("All of the friction has changed", "Check preload and wear; identify the friction anew."),
    "backlash": ("Lost motion at reversal", "Check gearhead, coupling and nut preload; approach targets from one side until it is mended."),
    "drive_compliance": ("The drive train is softer than assumed", "Check coupling clamps and bearing preload; lower the gains until then."),
    "screw_pitch_error": ("The lead of the screw is not even", "Enter the error in a compensation table, or replace the screw."),
    "torque_ripple": ("The drive's force ripples with its turn", "Check commutation and the coupling's alignment; compensate by angle."),
    "payload_change": ("Another mass sits on the stage", "Enter the mass in the axis file, or take the load off."),
    "gravity_tilt": ("The axis is not level", "Level the machine, or feed the constant force forward."),
    "cable_spring": ("A cable or a gauge pulls on the stage", "Re-route the cable; feed the force forward if it must stay."),
    "amplifier_offset": ("The amplifier is off zero", "Trim the amplifier's offset."),
    "amplifier_deadband": ("The amplifier has a dead zone", "Trim the crossover of the output stage, or compensate it by command."),
    "amplifier_gain": ("The amplifier's gain differs", "Measure the gain and enter it in the axis file."),
    "resistance_rise": ("The winding warms up", "Let the motor cool or lower the duty; let the observer follow the resistance."),
    "transport_delay": ("The command arrives late", "Check the controller's timing and the bus; lower the gains or add prediction."),
    "actuator_lag": ("The amplifier follows with a lag", "Check the current loop's tuning; account for the lag in the controller."),
    "sampling_jitter": ("Readings are late or lost", "Check the reading's timing and the cable; stamp readings where they are made."),
    "encoder_sde": ("The encoder errs within its signal period", "Clean and re-align the reading head; calibrate the interpolation."),
    "scale_error": ("The encoder's scale is off", "Calibrate against the interferometer; check cosine and Abbe alignment."),
    "thermal_drift": ("Parts expand", "Let the machine warm up; compensate by the stage thermometer."),
    "refractive_index": ("The air's refractive index is not compensated", "Switch on the interferometer's weather station."),
    "floor_vibration": ("The floor vibrates", "Find the machine that runs at this frequency; isolate the table."),
}
VERDICTS = {
    "agrees": "The model agrees with the records.",
    "explained": "What the model lacked is found, down to the noise.",
    "partly_explained": "Part of what the model lacks is found; something is left.",
    "undetermined": "Something is there, but these records cannot tell what.",
    "unexplained": "The model and the records part, and no cause of the catalogue fits.",
}
#: Tone of a verdict on the page.
TONES = {"agrees": "good", "explained": "good", "partly_explained": "caution", "undetermined": "caution", "unexplained": "bad"}


def name_of(cause_id):
    """Plain name of an effect; the id itself for one that has none."""
    return WORDS.get(cause_id, (cause_id.replace("_", " ").capitalize(), ""))[0]


def advice_for(cause_id):
    """What to do next about an effect."""
    return WORDS.get(cause_id, ("", ""))[1]


def sentence_of(cause_id, parameters):
    """Name and sizes in one sentence; ``parameters``: {name: `diagnosis.Parameter`}."""
    told = [f"{_plain(name)} {quantity(number.value, number.unit, stderr=number.stderr)}"
            for name, number in list(parameters.items())[:MOST]]
    more = f" and {len(parameters) - MOST} more sizes" if len(parameters) > MOST else ""
    return f"{name_of(cause_id)}: {', '.join(told)}{more}." if told else f"{name_of(cause_id)}."


def _plain(name):
    """A parameter's name without its unit: ``width_rad`` as ``width``."""
    for suffix in sorted(SUFFIXES, key=len, reverse=True):
        if name.endswith(suffix) and len(name) > len(suffix):
            return name[: -len(suffix)].replace("_", " ")
    return name.replace("_", " ")
