"""What an axis file may hold: every key with its unit, its range and its meaning.

One table is the only source of a parameter's unit, range and description; the loader, the error
messages and the parameter tables of the documentation all come from it.
"""

from microstage_ros.model.actuators import BY_NAME
from microstage_ros.model.friction.registry import SECTIONS
from microstage_ros.model.sensors import POSITION_SENSORS, SENSOR_KEY, SENSORS_BY_NAME
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec, any_number, not_negative, positive

GENERAL = {
    "period": Spec("s", 1e-6, 1.0, "control period T, the voltage is held over it"),
    "travel.minimum": any_number("m", "lower end of the stroke"),
    "travel.maximum": any_number("m", "upper end of the stroke"),
    "stage.mass": positive("kg", "moving mass m"),
    "stage.flexure_stiffness": not_negative("N/m", "spring between stage and ground, without force at x = 0",
                                            default=0.0),
    "stage.flexure_damping": not_negative("N s/m", "damper between stage and ground", default=0.0),
    "stage.offset_force": any_number("N", "constant force on the stage that opposes positive motion", default=0.0),
    "sensors.encoder.resolution": not_negative("m", "one count; 0 means not quantised", default=0.0),
    "sensors.encoder.noise": not_negative("m", "standard deviation of one reading before rounding", default=8.0e-9),
    "sensors.encoder.signal_period": positive("m", "signal period of the scale", default=1.0e-5),
    "sensors.encoder.interpolation_error": not_negative(
        "m", "amplitudes a_1, a_2 of the error a_1 sin(2 pi x/period) + a_2 sin(4 pi x/period)", default=[0.0, 0.0],
        is_list=True),
    "sensors.interferometer.noise": not_negative("m", "standard deviation of one reading", default=0.0),
    "sensors.interferometer.expanded_uncertainty": not_negative("m", "declared U, k = 2", default=0.0),
    "sensors.current.noise": not_negative("A", "standard deviation of one reading before rounding", default=0.0),
    "sensors.current.offset": any_number("A", "reading at no current", default=0.0),
    "sensors.current.range": not_negative("A", "readings are clipped to ± this; 0 means not at all", default=0.0),
    "sensors.current.bits": Spec("1", 0, 32, "converter width over ± range; 0 means not quantised", default=0),
    "sensors.current.bandwidth": not_negative("Hz", "-3 dB frequency of its first-order filter; 0 means without",
                                              default=0.0),
    "sensors.current.skew": not_negative("s", "time by which the current is sampled before the encoder", default=0.0),
    "variability.relative": not_negative("1", "standard deviation of the limits' factor 1 + q", default=0.0),
    "variability.travel_length": positive("m", "correlation length of q over travel", default=1e-4),
    "variability.time_length": positive("s", "correlation time of q", default=20.0),
    "variability.travel_share": Spec("1", 0, 1, "part of q's variance that goes with travel", default=0.8),
    "variability.clip": not_negative("1", "largest |q|", default=0.15),
}

DRIVES = {name: actuator.parameters for name, actuator in BY_NAME.items()}

TRANSMISSIONS = {
    "screw": {
        "gear_ratio": positive("1", "motor turns per screw turn N"),
        "pitch": positive("m", "travel per screw turn p"),
        "stiffness": positive("N/m", "axial stiffness K_c between screw and stage"),
        "damping": not_negative("N s/m", "axial damping D_c between screw and stage"),
    },
    "rigid": {
        "gear_ratio": positive("1", "motor turns per screw turn N", default=1.0),
        "pitch": positive("m", "travel per screw turn p", default=6.283185307179586),
    },
}

CONTACT_LAWS = SECTIONS
ANGULAR = {"actuator": True, "guideway": False}
_LINEAR_UNITS = {
    "N m": "N", "N m/rad": "N/m", "N m/s": "N/s", "N m s/rad": "N s/m", "rad/s": "m/s", "1": "1",
}
CHOICES = {
    "drive.type": DRIVES,
    "transmission.type": TRANSMISSIONS,
}
READINGS = ("blocks", "segment_slopes")


def linear_unit(unit):
    """Unit of a friction parameter at the stage, given its unit at the screw angle."""
    return _LINEAR_UNITS[unit]


def leaf_specs(choices, place):
    """All leaves allowed by the chosen drive, transmission and friction laws.

    ``choices``: {"drive.type": ..., "transmission.type": ..., "contacts.NAME.law": ...}.
    Returns {dotted key: Spec}. Raises InputError for an unknown choice.
    """
    specs = dict(GENERAL)
    for key, table in CHOICES.items():
        chosen = choices.get(key)
        if not isinstance(chosen, str) or chosen not in table:
            raise InputError(f"{place}: {key}", chosen, "one of " + ", ".join(table))
        prefix = key.split(".")[0]
        specs.update({f"{prefix}.{name}": spec for name, spec in table[chosen].items()})
    sensor = choices.get(SENSOR_KEY, POSITION_SENSORS[0].name)
    if not isinstance(sensor, str) or sensor not in SENSORS_BY_NAME:
        raise InputError(f"{place}: {SENSOR_KEY}", sensor, "one of " + ", ".join(SENSORS_BY_NAME))
    specs.update({f"sensors.encoder.{name}": spec for name, spec in SENSORS_BY_NAME[sensor].parameters.items()})
    for contact, angular in ANGULAR.items():
        law = choices.get(f"contacts.{contact}.law", "none")
        if not isinstance(law, str) or law not in CONTACT_LAWS:
            raise InputError(f"{place}: contacts.{contact}.law", law, "one of " + ", ".join(CONTACT_LAWS))
        for name, spec in CONTACT_LAWS[law].items():
            if not angular:
                spec = spec.scaled(linear_unit(spec.unit))
            specs[f"contacts.{contact}.{name}"] = spec
    return specs

