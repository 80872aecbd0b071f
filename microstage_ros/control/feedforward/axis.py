"""Feed-forward of the whole axis along the reference: friction of both contacts, drive train, motor.

    F_c  = F_g(x_ref) + m a_ref                        force through the drive train
    z    = x_ref + F_c / K_c                           where the screw has to be, wound up by F_c
    U_ff = (R/k_M) [ M_f(z) + (r/N) F_c + J (N/r) a_z ] + K_E (N/r) v_z

F_g and M_f are the friction laws of the axis file, run along the reference with their memory: the feed-
forward knows which blocks slip. A current- or force-driven axis has U_ff = (F_g + m a_ref) / gain. Speeds
and accelerations are differences of the reference; a reference faster than the axis can go is taken as
one that goes as fast as it can.
"""

import math

import numpy as np

from microstage_ros.control.gains import Gain, record_type
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.friction import generalised_maxwell_slip
from microstage_ros.model.friction.blocks import COUNT, STIFFNESS
from microstage_ros.model.friction.contact import blocks_of, limit_of
from microstage_ros.model.friction.curve import SLIDING, pack_curve, sliding_limit, viscous_force
from microstage_ros.model.sensors import position_sensor_of
from microstage_ros.model.transmission import screw_ratio
from microstage_ros.numerics.compiled import compiled

GAINS = (
    Gain("friction_share", "1", 0.0, 2.0, 1.0, "share of the modelled friction that is fed forward"),
    Gain("motion_share", "1", 0.0, 2.0, 1.0, "share of the modelled back-EMF and inertia that is fed forward"),
)
WITH_SCALE = ("incremental", "sine_cosine")  # position sensors that interpolate the signal periods of a scale
WIDTH = 32  # packed friction law: two directions, up to eight blocks, attraction
BLOCK_STATE = 16
MODEL_FIELDS = [
    ("volts_per_force", "f8"),  # V/N at the stage
    ("volts_per_torque", "f8"),  # V/(N m) at the motor shaft
    ("volts_per_velocity", "f8"),  # V s/m
    ("volts_per_position", "f8"),  # V/m of a drive whose command sets a position, else 0
    ("integral_rate", "f8"),  # 1/s, fastest integral control that such a drive's resonance bears
    ("rotor", "f8"),  # V s^2/m, rotor inertia alone
    ("mass", "f8"),  # kg
    ("moving_mass", "f8"),  # kg, stage and reflected rotor
    ("force_per_torque", "f8"),  # N at the stage per N m at the motor shaft
    ("force_per_ampere", "f8"),  # N/A; 0: no current, the force comes from the voltage
    ("resistance", "f8"),  # ohm
    ("settling", "f8"),  # s, L/R
    ("current_bandwidth", "f8"),  # Hz, of the current's sensor; 0: without a filter
    ("current_skew", "f8"),  # s, by which it is sampled before the encoder
    ("compliance", "f8"),  # m/N of the drive train
    ("drive_damping", "f8"),  # N s/m of the drive train
    ("screw_ratio", "f8"),  # m per radian of the screw
    ("offset_force", "f8"),  # N
    ("signals_per_metre", "f8"),  # 1/m, signal periods of the encoder's scale; 0: nothing is looked for
    ("top_speed", "f8"),  # m/s
    ("has_actuator", "i8"),
    ("has_guideway", "i8"),
    ("actuator", "f8", WIDTH),
    ("guideway", "f8", WIDTH),
]
PARAMETERS = record_type(GAINS, MODEL_FIELDS)
STATE_FIELDS = [
    ("reference", "f8"),
    ("velocity", "f8"),
    ("screw", "f8"),
    ("screw_velocity", "f8"),
    ("actuator", "f8", BLOCK_STATE),
    ("guideway", "f8", BLOCK_STATE),
    ("actuator_friction", "f8"),  # N m at the motor shaft
    ("guideway_friction", "f8"),  # N
    ("screw_acceleration", "f8"),
    ("offset_speed", "f8"),
    ("friction", "f8"),  # V, all of the modelled friction
]

FAST_ATTRACTION = 1e6  # 1/s, in limits: a slip that follows its limit at once


def packed_contact(axis, contact):
    """Friction law of a contact as a packed generalised Maxwell-slip law, shape (WIDTH,), or None.

    Every law becomes the blocks of `model.friction.contact.blocks_of`; one without an attraction parameter slips at
    its limit at once, one without a Stribeck drop has none. Units are those of the axis file: N m and rad at the
    actuator (angle of the screw), N and m at the guideway.
    """
    law = axis.law(contact)
    if law == "none":
        return None

    def number(name, otherwise):
        key = f"contacts.{contact}.{name}"
        return axis.value(key) if axis.has(key) else otherwise

    static = limit_of(axis, contact)
    if not static:
        return None
    curve = pack_curve({"static": static, **{name: number(name, None) for name in SLIDING if name != "static"}})
    stiffness, weight = blocks_of(axis, contact)
    own = {"stiffness": stiffness, "weight": weight, "attraction": number("attraction", FAST_ATTRACTION * static)}
    packed = curve * 2 + generalised_maxwell_slip.pack(own)
    return np.array(packed + [0.0] * (WIDTH - len(packed)))


def fill_model(record, axis):
    """Write the axis's numbers into the model fields of a parameter record."""
    ratio = screw_ratio(axis)
    record["screw_ratio"] = ratio
    record["mass"] = axis.value("stage.mass")
    record["offset_force"] = axis.value("stage.offset_force")
    scale = position_sensor_of(axis).name in WITH_SCALE
    record["signals_per_metre"] = 1.0 / axis.value("sensors.encoder.signal_period") if scale else 0.0
    for field, value in actuator_of(axis).feed_forward(axis).items():
        record[field] = value
    rigid = axis.choices["transmission.type"] == "rigid"
    record["compliance"] = 0.0 if rigid else 1.0 / axis.value("transmission.stiffness")
    record["drive_damping"] = 0.0 if rigid else axis.value("transmission.damping")
    for contact in ("actuator", "guideway"):
        packed = packed_contact(axis, contact)
        record[f"has_{contact}"] = 0 if packed is None else 1
        if packed is not None:
            record[contact] = packed


@compiled(makes_arrays=False)
def friction_along(law, blocks, velocity, period, factor):
    """Friction after a period at the constant ``velocity``; moves the block states by exactly velocity x period.

    Units of the law; ``factor`` scales its limits. This is the law's `stretch`, to the bit, at one speed: limit and
    fading are then the same for every block that slips, and a block that begins to slip goes on at its limit.
    """
    n = int(law[COUNT])
    total = 0.0
    if velocity == 0.0:
        for i in range(n):
            total += blocks[i]
        return total
    direction, speed = (1.0 if velocity > 0.0 else -1.0), abs(velocity)
    limit = sliding_limit(law, direction, speed, factor)
    exponent = law[STIFFNESS + 2 * n] * period * (1.0 / limit)
    fading = -math.expm1(-exponent) if exponent >= 1e-9 else exponent
    for i in range(n):
        own = law[STIFFNESS + n + i] * limit
        force = direction * blocks[i]  # along the motion
        loaded = force + law[STIFFNESS + i] * speed * period
        if blocks[n + i] == direction or force >= own:
            force = own + (force - own) * (1.0 - fading)
            blocks[n + i] = direction
        elif loaded > own:
            force = own
            blocks[n + i] = direction
        else:
            force = loaded
            blocks[n + i] = 0.0
        blocks[i] = direction * force
        total += blocks[i]
    return total + viscous_force(law, velocity)


@compiled
def feedforward_reset(s, reference):
    """Forget the friction memory; rest at ``reference`` [m]."""
    s.reference = reference
    s.velocity = 0.0
    s.screw = reference
    s.screw_velocity = 0.0
    s.screw_acceleration = 0.0
    s.offset_speed = 0.0
    s.friction = 0.0
    s.actuator_friction = 0.0
    s.guideway_friction = 0.0
    for j in range(BLOCK_STATE):
        s.actuator[j] = 0.0
        s.guideway[j] = 0.0


@compiled
def feedforward_step(
    p, s, period, reference, actuator_level, guideway_level, offset_speed, inertia, swing=1.0, softness=1.0
):
    """Feed-forward voltage [V] for the new reference sample [m]; levels scale the friction limits [1].

    ``offset_speed`` [m/s]: what the motor is to go faster than the stage; ``inertia`` [1]: of all that moves, over the
    file's; ``swing`` m/K and ``softness`` 1/K of the drive train over the file's [1].
    """
    velocity = min(max((reference - s.reference) / period, -p.top_speed), p.top_speed)
    acceleration = (velocity - s.velocity) / period
    if p.has_guideway != 0:
        s.guideway_friction = friction_along(p.guideway, s.guideway, velocity, period, guideway_level)
    load = s.guideway_friction + p.offset_force
    screw = reference + (softness * load + swing * p.mass * acceleration) * p.compliance
    screw_velocity = (screw - s.screw) / period + offset_speed
    screw_velocity = min(max(screw_velocity, -p.top_speed), p.top_speed)
    s.screw_acceleration = (screw_velocity - s.screw_velocity) / period
    if p.has_actuator != 0:
        s.actuator_friction = friction_along(
            p.actuator, s.actuator, screw_velocity / p.screw_ratio, period, actuator_level
        )
    s.reference = reference
    s.velocity = velocity
    s.screw = screw
    s.screw_velocity = screw_velocity
    friction = p.volts_per_torque * s.actuator_friction + p.volts_per_force * (s.guideway_friction + p.offset_force)
    motion = inertia * (p.volts_per_force * p.mass + p.rotor) * acceleration + p.volts_per_velocity * velocity
    motion += inertia * p.rotor * (offset_speed - s.offset_speed) / period + p.volts_per_velocity * offset_speed
    s.offset_speed = offset_speed
    s.friction = friction
    return p.friction_share * friction + p.motion_share * motion + p.volts_per_position * screw
