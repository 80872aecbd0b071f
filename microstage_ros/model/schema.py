"""What an axis file may hold: every key with its unit, its range and its meaning.

One table is the only source of a parameter's unit, range and description; the loader, the error
messages and the parameter tables of the documentation all come from it.
"""

from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec
from microstage_ros.quantities.spec import any_number as _any
from microstage_ros.quantities.spec import not_negative as _not_negative
from microstage_ros.quantities.spec import positive as _positive

GENERAL = {
    "period": Spec("s", 1e-6, 1.0, "control period T, the voltage is held over it"),
    "travel.minimum": _any("m", "lower end of the stroke"),
    "travel.maximum": _any("m", "upper end of the stroke"),
    "stage.mass": _positive("kg", "moving mass m"),
    "stage.offset_force": _any("N", "constant force on the stage that opposes positive motion", default=0.0),
    "sensors.encoder.resolution": _not_negative("m", "one count; 0 means not quantised", default=0.0),
    "sensors.encoder.noise": _not_negative("m", "standard deviation of one reading before rounding", default=8.0e-9),
    "sensors.encoder.signal_period": _positive("m", "signal period of the scale", default=1.0e-5),
    "sensors.encoder.interpolation_error": _not_negative(
        "m", "amplitudes a_1, a_2 of the error a_1 sin(2 pi x/period) + a_2 sin(4 pi x/period)", default=[0.0, 0.0], is_list=True),
    "sensors.interferometer.noise": _not_negative("m", "standard deviation of one reading", default=0.0),
    "sensors.interferometer.expanded_uncertainty": _not_negative("m", "declared U, k = 2", default=0.0),
    "sensors.current.noise": _not_negative("A", "standard deviation of one reading before rounding", default=0.0),
    "sensors.current.offset": _any("A", "reading at no current", default=0.0),
    "sensors.current.range": _not_negative("A", "readings are clipped to ± this; 0 means not at all", default=0.0),
    "sensors.current.bits": Spec("1", 0, 32, "converter width over ± range; 0 means not quantised", default=0),
    "sensors.current.bandwidth": _not_negative("Hz", "-3 dB frequency of its first-order filter; 0 means without", default=0.0),
    "sensors.current.skew": _not_negative("s", "time by which the current is sampled before the encoder", default=0.0),
    "variability.relative": _not_negative("1", "standard deviation of the limits' factor 1 + q", default=0.0),
    "variability.travel_length": _positive("m", "correlation length of q over travel", default=1e-4),
    "variability.time_length": _positive("s", "correlation time of q", default=20.0),
    "variability.travel_share": Spec("1", 0, 1, "part of q's variance that goes with travel", default=0.8),
    "variability.clip": _not_negative("1", "largest |q|", default=0.15),
}

DRIVES = {
    "voltage_motor": {
        "voltage_limit": _positive("V", "amplifier output is clipped to ± this"),
        "dac_range": _positive("V", "converter spans ± this"),
        "dac_bits": Spec("1", 0, 32, "converter width; 0 means not quantised"),
        "noise": _not_negative("V", "standard deviation of the amplifier's output, held over a period", default=1.0e-3),
        "resistance": _positive("ohm", "terminal resistance R"),
        "inductance": _positive("H", "terminal inductance L"),
        "back_emf": _not_negative("V s/rad", "back-EMF constant K_E of the motor"),
        "torque_constant": _positive("N m/A", "torque constant k_M of the motor"),
        "rotor_inertia": _positive("kg m^2", "all rotating parts, at the motor shaft"),
    },
    "force": {
        "voltage_limit": _positive("V", "command is clipped to ± this"),
        "dac_range": _positive("V", "converter spans ± this", default=10.0),
        "dac_bits": Spec("1", 0, 32, "converter width; 0 means not quantised", default=0),
        "noise": _not_negative("V", "standard deviation of the command that the amplifier adds, held over a period", default=1.0e-3),
        "gain": _positive("N/V", "force on the stage per volt of command"),
    },
}

TRANSMISSIONS = {
    "screw": {
        "gear_ratio": _positive("1", "motor turns per screw turn N"),
        "pitch": _positive("m", "travel per screw turn p"),
        "stiffness": _positive("N/m", "axial stiffness K_c between screw and stage"),
        "damping": _not_negative("N s/m", "axial damping D_c between screw and stage"),
    },
    "rigid": {
        "gear_ratio": _positive("1", "motor turns per screw turn N", default=1.0),
        "pitch": _positive("m", "travel per screw turn p", default=6.283185307179586),
    },
}

_BLOCKS = {
    "stiffness": _positive("N m/rad", "block stiffnesses k_j", is_list=True),
    "weight": _positive("1", "block weights α_j, normalised to a sum of 1 on load", is_list=True),
}
_STRIBECK = {
    "static": _positive("N m", "static limit F_s"),
    "coulomb": _positive("N m", "Coulomb level F_C"),
    "stribeck_velocity": _positive("rad/s", "Stribeck velocity V_S"),
    "stribeck_exponent": Spec("1", 0.1, 5.0, "Stribeck shape δ"),
}
_VISCOUS = {"viscous": _not_negative("N m s/rad", "viscous coefficient σ", default=0.0)}

CONTACT_LAWS = {
    "none": {},
    "coulomb_viscous": {"coulomb": _not_negative("N m", "Coulomb level F_C"), **_VISCOUS},
    "coulomb_viscous_stribeck": {**_STRIBECK, **_VISCOUS},
    "maxwell_slip": {**_BLOCKS, "static": _positive("N m", "constant limit F_s"), **_VISCOUS},
    "generalised_maxwell_slip": {
        **_BLOCKS, **_STRIBECK, "attraction": _positive("N m/s", "attraction parameter C"), **_VISCOUS,
    },
}
_SLOPE = {"stiffness": _positive("N m/rad", "stiffness at zero force")}
_DAMPING = {"damping": _not_negative("N m s/rad", "micro-damping σ₁ of the bristles", default=0.0)}
_CURVE = {**_STRIBECK, **_VISCOUS}
CONTACT_LAWS.update({
    "dahl": {**_SLOPE, "exponent": _positive("1", "shape of the approach to the limit", default=1.0),
             "static": _STRIBECK["static"], **_VISCOUS},
    "lugre": {**_SLOPE, **_DAMPING, **_CURVE},
    "elasto_plastic": {**_SLOPE, **_DAMPING, **_CURVE,
                       "breakaway_share": Spec("1", 0.0, 1.0, "elastic share of the Coulomb limit", default=0.7)},
    "leuven": {**_BLOCKS, **_DAMPING, **_CURVE, "exponent": Spec("1", 1.0, 50.0, "lateness of the transition", default=6.0)},
    "hsieh_pan": {**_BLOCKS, "static": _STRIBECK["static"], **_VISCOUS, "creep_velocity": _positive("rad/s", "flow velocity of the plastic module"),
                  "sharpness": _positive("1", "sharpness of the flow"), "hardening": _not_negative("N m/rad", "hardening")},
})
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
        if chosen not in table:
            raise InputError(f"{place}: {key}", chosen, "one of " + ", ".join(table))
        room = key.split(".")[0]
        specs.update({f"{room}.{name}": spec for name, spec in table[chosen].items()})
    for contact, angular in ANGULAR.items():
        law = choices.get(f"contacts.{contact}.law", "none")
        if law not in CONTACT_LAWS:
            raise InputError(f"{place}: contacts.{contact}.law", law, "one of " + ", ".join(CONTACT_LAWS))
        for name, spec in CONTACT_LAWS[law].items():
            if not angular:
                spec = spec.scaled(linear_unit(spec.unit))
            specs[f"contacts.{contact}.{name}"] = spec
    return specs

