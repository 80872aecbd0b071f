"""The numbers of a voltage-driven screw axis that the residual channels need, by name."""

import dataclasses
import math

import numpy as np

from microstage_ros.model.friction.contact import OTHER_LAWS, blocks_of, law_values, limit_of
from microstage_ros.model.friction.registry import law_named
from microstage_ros.model.sensors.current import sensed_transient
from microstage_ros.quantities.errors import InputError

# N: limit of a contact without friction; derived: 10⁻¹⁰ of what winds the drive train up by a nanometre, 10⁻² N
NO_FRICTION = 1.0e-12
# 1/s, in limits: a law without an attraction parameter slips at its limit at once; derived: in a hundredth of a
# period of 100 µs
FAST_ATTRACTION = 1.0e6


@dataclasses.dataclass(frozen=True)
class Contact:
    """Friction of one contact: block arrays of shape (blocks,), see `solver.contact`; limits in N m or N.

    ``law``: number of a law that is not made of blocks (`model.friction.registry`) with its packed parameters, viscous
    part left out; −1 for one that is. The blocks then follow its first loading.
    """

    stiffness: np.ndarray
    weight: np.ndarray
    static: float
    coulomb: float
    stribeck_velocity: float
    stribeck_exponent: float
    attraction: float
    viscous: float
    law: int = -1
    packed: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))


@dataclasses.dataclass(frozen=True)
class Variability:
    """How the axis file says that friction varies: standard deviation of the limits' factor, the travel [m] and the
    time [s] over which it is correlated, and the share of its variance that goes with travel."""

    relative: float
    travel_length: float
    time_length: float
    travel_share: float


@dataclasses.dataclass(frozen=True, eq=False)
class Drive:
    """Motor, transmission, stage and contacts in SI.

    ``lever`` is r/N [m per radian of the motor]: stage travel for a radian of the motor shaft. ``amplifier_noise`` [V]
    and ``variability`` are what the axis file states of noise; where records of the healthy axis are given, they say it
    instead. ``pull``: the force that pulls on the stage towards smaller x [N] and its standard error, where a rattle in
    a gap told it. ``offset``: of the amplifier [V], once it is found; its dead band is centred on the command
    −offset.
    """

    resistance: float
    inductance: float
    back_emf: float
    torque_constant: float
    inertia: float
    gear_ratio: float
    pitch: float
    stiffness: float
    damping: float
    mass: float
    converter_step: float
    voltage_limit: float
    actuator: Contact
    guideway: Contact
    # source: sensors.encoder.signal_period of config/axis.yaml
    signal_period: float = 1.0e-5
    interpolation: tuple = ()
    interpolation_cosine: tuple = ()
    encoder_resolution: float = 0.0
    encoder_noise: float = 0.0
    current_offset: float = 0.0
    current_bandwidth: float = 0.0
    current_skew: float = 0.0
    amplifier_noise: float = 0.0
    variability: "Variability | None" = None
    pull: tuple[float, float] | None = None
    offset: float = 0.0

    def interpolation_error(self, position):
        """What the encoder of the axis file reads beyond ``position`` [m], (n,), by interpolation [m]."""
        phase = 2.0 * math.pi * position / self.signal_period
        error = sum((size * np.sin(n * phase) for n, size in enumerate(self.interpolation, 1)), np.zeros(len(position)))
        return error + sum(
            (size * np.cos(n * phase) for n, size in enumerate(self.interpolation_cosine, 1)), np.zeros(len(position))
        )

    def current_transient(self, period):
        """Share [1] of the current before in a reading of the current, a ``period`` [s] later, by the winding and the
        sensor's own filter."""
        settling = self.inductance / self.resistance
        return sensed_transient(period, settling, self.current_bandwidth, self.current_skew)

    @property
    def radius(self):
        """r: travel per angle of the screw [m/rad]."""
        return self.pitch / (2.0 * math.pi)

    @property
    def lever(self):
        """r/N: travel per angle of the motor shaft [m/rad]."""
        return self.radius / self.gear_ratio


def drive_of(axis):
    """`Drive` from an `Axis`.  Raises InputError if it is not a voltage-driven screw."""
    if axis.choices.get("drive.type") != "voltage_motor" or axis.choices.get("transmission.type") != "screw":
        raise InputError(f"{axis.place}: drive.type", axis.choices.get("drive.type"),
                         "voltage_motor with a screw (force-driven axes are re-simulated instead)")
    value = axis.value
    return Drive(
        resistance=value("drive.resistance"),
        inductance=value("drive.inductance"),
        back_emf=value("drive.back_emf"),
        torque_constant=value("drive.torque_constant"),
        inertia=value("drive.rotor_inertia"),
        gear_ratio=value("transmission.gear_ratio"),
        pitch=value("transmission.pitch"),
        stiffness=value("transmission.stiffness"),
        damping=value("transmission.damping"),
        mass=value("stage.mass"),
        converter_step=2.0 * value("drive.dac_range") / 2.0 ** value("drive.dac_bits"),
        voltage_limit=value("drive.voltage_limit"),
        actuator=_contact(axis, "actuator"),
        guideway=_contact(axis, "guideway"),
        signal_period=value("sensors.encoder.signal_period"),
        interpolation=tuple(value("sensors.encoder.interpolation_error")),
        encoder_resolution=value("sensors.encoder.resolution"),
        encoder_noise=value("sensors.encoder.noise"),
        current_offset=value("sensors.current.offset"),
        current_bandwidth=value("sensors.current.bandwidth"),
        current_skew=value("sensors.current.skew"),
        amplifier_noise=value("drive.noise"),
        variability=Variability(
            *(value(f"variability.{key}") for key in ("relative", "travel_length", "time_length", "travel_share"))
        ),
    )


def _contact(axis, name):
    """`Contact` of the axis, whatever its law; its blocks are those of `model.friction.contact.blocks_of`."""
    law = axis.law(name)
    if law == "none":
        if name == "actuator":
            raise InputError(
                f"{axis.place}: contacts.actuator.law",
                law,
                "a friction law: the torque balance is judged against the actuator's friction",
            )
        return Contact(
            np.array([1.0]), np.ones(1), NO_FRICTION, NO_FRICTION, 1.0, 1.0, FAST_ATTRACTION * NO_FRICTION, 0.0
        )

    def get(key, default):
        full = f"contacts.{name}.{key}"
        return axis.value(full) if axis.has(full) else default

    stiffness, weight = blocks_of(axis, name)
    static = limit_of(axis, name)
    number, packed = -1, np.zeros(0)
    if law in OTHER_LAWS:
        number, packed = law_named(law).number, law_named(law).pack({**law_values(axis, name), "viscous": 0.0})
    return Contact(
        stiffness,
        weight,
        static,
        get("coulomb", static),
        get("stribeck_velocity", 1.0),
        get("stribeck_exponent", 1.0),
        get("attraction", FAST_ATTRACTION * static),
        get("viscous", 0.0),
        number,
        packed,
    )
