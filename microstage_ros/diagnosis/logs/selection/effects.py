"""How each effect of the catalogue would show in a log: columns per channel, and what else carries its trace.

A column is what the channel's signal changes by, in the channel's unit, for one unit of the effect's size; sizes are
relative to the channel's scale (the friction level F, the error's rms E), so a column in the effort is F times a pure
number.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.logs.preprocessing.channels import FLUCTUATION, high_pass, low_pass, through_loop
from microstage_ros.diagnosis.logs.preprocessing.motion import STATES

WAVES = 4               # half waves of friction along the stroke
BUMPS = 8               # hat functions for what is local
START, BRAKE = STATES.index("start"), STATES.index("brake")
DWELL = 0.05            # s, at which rising static friction begins to grow (default of the effect)


@dataclasses.dataclass(frozen=True)
class Signature:
    """One effect. ``effort``, ``error``, ``voltage``: names of columns that it moves there (those of the error where no
    effort is logged); ``amplitudes``: kinds of amplitude coordinates by channel. ``kinds``: efforts in which it can be,
    empty for all."""

    effort: tuple = ()
    error: tuple = ()
    voltage: tuple = ()
    amplitudes: tuple = ()
    kinds: tuple = ()


#: id → where it shows. What stands under ``error`` beside ``effort`` is for logs without an effort.
SIGNATURES = {
    "friction_level_change": Signature(effort=("level",), error=("friction in error",)),
    "viscous_change": Signature(effort=("viscous",), error=("viscous in error",)),
    "nonlinear_viscous": Signature(effort=("quadratic",), error=("quadratic in error",)),
    "direction_asymmetry": Signature(effort=("moving",), error=("asymmetry in error",)),
    "gravity_tilt": Signature(effort=("constant",), error=("constant in error",)),
    "cable_spring": Signature(effort=("spring",), error=("spring in error",)),
    "position_dependent_friction": Signature(effort=("waves",), error=("waves in error",)),
    "torque_ripple": Signature(amplitudes=(("effort", "ripple"), ("effort", "ripple high"))),
    "payload_change": Signature(effort=("inertia",), error=("inertia in error",)),
    "rising_static_friction": Signature(effort=("breakaway",), error=("breakaway",)),
    "backlash": Signature(error=("lost motion",)),
    "drive_compliance": Signature(error=("load",)),
    "screw_pitch_error": Signature(amplitudes=(("error", "ripple"),)),
    "transport_delay": Signature(error=("speed",)),
    "actuator_lag": Signature(error=("acceleration",)),
    "scale_error": Signature(error=("place",)),
    "presliding_creep": Signature(error=("creep",)),
    "floor_vibration": Signature(amplitudes=(("error", "rough 0"), ("error", "rough moving"))),
    "sampling_jitter": Signature(amplitudes=(("error", "rough moving"),)),
    "amplifier_gain": Signature(effort=("gain",), error=("gain",), voltage=("gain",)),
    "amplifier_offset": Signature(effort=("constant",), voltage=("constant",), kinds=("voltage",)),
    "amplifier_deadband": Signature(effort=("dead zone",), voltage=("dead zone",), kinds=("voltage",)),
    "resistance_rise": Signature(effort=("resistive",), voltage=("resistive",), kinds=("voltage",)),
}
#: Effects of the catalogue that no log of these signals shows, and what would show them.
NEVER = {
    "frictional_lag": "position and effort at 1 kHz or more through slow reversals",
    "encoder_sde": "a second, independent reading of the position",
    "thermal_drift": "a second, independent reading of the position",
    "refractive_index": "an interferometer beside the encoder, with air temperature and pressure",
}
#: What the transmission does shows only where the position is read behind it.
BEHIND = ("backlash", "drive_compliance", "screw_pitch_error")
BEHIND_NEED = "the position read at the moved part; here it is read at the motor"
#: What separates two names, for a person: signal or move.
SEPARATE = {
    frozenset(("friction_level_change", "viscous_change")): "the same move at two speeds, at least a factor 3 apart",
    frozenset(("friction_level_change", "nonlinear_viscous")): "the same move at three speeds",
    frozenset(("viscous_change", "nonlinear_viscous")): "the same move at three speeds",
    frozenset(
        ("gravity_tilt", "direction_asymmetry")
    ): "the effort at rest with the brake off, reached from both sides: a constant force is "
    "there at rest too, friction that differs between directions is not",
    frozenset(
        ("friction_level_change", "gravity_tilt")
    ): "the sign of the current: friction turns round with the motion, a constant force does not",
    frozenset(("friction_level_change", "direction_asymmetry")): "the sign of the current",
    frozenset(
        ("friction_level_change", "amplifier_gain")
    ): "the same move at twice the acceleration: a gain scales inertia and friction alike",
    frozenset(
        ("payload_change", "rising_static_friction")
    ): "the same move after dwells of 0.1 s, 1 s and 10 s: mass does not know the dwell",
    frozenset(
        ("torque_ripple", "rising_static_friction")
    ): "the same move after dwells of 0.1 s, 1 s and 10 s: ripple does not know the dwell",
    frozenset(
        ("torque_ripple", "screw_pitch_error")
    ): "set point, motor current and the motor's own position together: a force shows in the current, an "
    "uneven lead in the difference of the positions",
    frozenset(("payload_change", "drive_compliance")): "the set point, or the motor's own position beside the load's",
    frozenset(("payload_change", "backlash")): "the set point, or the motor's own position beside the load's",
    frozenset(
        ("payload_change", "cable_spring")
    ): "the same stroke at half the speed: inertia needs a quarter, a spring as much as before",
    frozenset(("friction_level_change", "amplifier_deadband")): "the motor's current beside its voltage",
    frozenset(
        ("torque_ripple", "floor_vibration")
    ): "a log of ten rows or more per turn, and some seconds at rest with the motor off: what ripples with "
    "the turn stops with it, what comes from outside does not",
    frozenset(
        ("backlash", "friction_level_change")
    ): "the drive's current: friction needs more of it, lost motion does not",
    frozenset(
        ("backlash", "drive_compliance")
    ): "the same reversal under two loads: a gap is of one width, a soft drive gives in proportion",
    frozenset(
        ("transport_delay", "viscous_change")
    ): "the drive's current: viscous friction needs more of it, a delay does not",
    frozenset(
        ("cable_spring", "position_dependent_friction")
    ): "the same stroke in both directions: a spring does not turn round with the motion",
    frozenset(("amplifier_offset", "gravity_tilt")): "voltage and current at rest with the axis unclamped",
    frozenset(
        ("transport_delay", "amplifier_gain")
    ): "the drive's current: an amplifier that gives less makes the controller ask for more, a delay does not",
    frozenset(("resistance_rise", "friction_level_change")): "the motor's current beside its voltage",
}
#: Columns of the error that a changed force moves, whatever the loop: free where the effort has changed.
FORCED = (
    "level",
    "level transient",
    "viscous",
    "speed transient",
    "force in error",
    "inertia",
    "start",
    "brake",
    "waves",
    "spring",
)
#: Effects on the error that a changed effort brings with it and that are therefore not looked for beside one.
FOLLOWING = (
    "backlash",
    "floor_vibration",
    "drive_compliance",
    "sampling_jitter",
    "screw_pitch_error",
    "presliding_creep",
    "actuator_lag",
)
#: What a trace in the error beside an unchanged effort may as well be, although the effort does not prove it.
ALSO = {
    "torque_ripple+": ("floor_vibration",),
    "actuator_lag": ("payload_change",),
    "drive_compliance": ("backlash",),
    "backlash": ("drive_compliance",),     # a constant friction winds a soft drive up as far after every reversal
    "presliding_creep": ("backlash",),
    "rising_static_friction": ("torque_ripple",),
}
#: The same where no effort is logged, and where the motion itself is known from the reading alone. A loop whose
#: amplifier gives less follows later, and yields more to the same friction: the error alone does not tell which.
WITHOUT_EFFORT = {
    "torque_ripple": ("screw_pitch_error",),
    "screw_pitch_error": ("torque_ripple",),
    "transport_delay": ("amplifier_gain",),
    "friction_level_change": ("amplifier_gain",),
}
FROM_READING = {
    "payload_change": ("drive_compliance", "backlash"),
    "torque_ripple": ("screw_pitch_error", "sampling_jitter"),
    "rising_static_friction": ("presliding_creep", "backlash"),
}
#: How much rarer than the commonest causes an effect is taken to be, as log odds: what decides between names that fit
#: alike. An opinion, not a measurement: frequencies of causes differ between shops.
RARER = {
    "viscous_change": 1.0,
    "nonlinear_viscous": 1.5,
    "amplifier_gain": 2.0,
    "cable_spring": 1.0,
    "presliding_creep": 2.0,
    "actuator_lag": 2.0,
    "drive_compliance": 1.5,
    "scale_error": 1.0,
    "sampling_jitter": 1.5,
    "screw_pitch_error": 1.0,
    "rising_static_friction": 1.0,
    "direction_asymmetry": 0.3,
    "amplifier_deadband": 1.0,
    "resistance_rise": 0.5,
    "amplifier_offset": 0.5,
}
GENERAL = "the same move at a slow and a fast speed, in both directions, with a rest of some seconds at each end"


def separation(ids):
    """Signal or move that separates these effects, in words."""
    ids = list(ids)
    said = [
        SEPARATE[pair]
        for k, a in enumerate(ids)
        for b in ids[k + 1 :]
        for pair in [frozenset((a, b))]
        if pair in SEPARATE
    ]
    return "; ".join(dict.fromkeys(said)) or GENERAL


def columns_of(stroke, turn=0.0):
    """Function (channel, rows) → {column name: (n, k)} in the channel's unit, for logs over ``stroke``,
    (lowest, highest) in the unit of the position; ``turn``: length of a turn in the unit of the position, or 0."""
    low, high = stroke

    def columns(channel, rows):
        if channel.name == "voltage":
            return _of_voltage(channel, rows)
        if channel.kind == FLUCTUATION:
            return {}
        m = rows.motion
        along = np.clip((m.x - low) / max(high - low, 1e-300), 0.0, 1.0) if m.absolute else None
        found = {**_of_forces(channel, rows), **_of_place(channel, rows, along), **_of_turn(channel, rows, turn)}
        found["gain"] = channel.predicted(rows)[:, None]
        own = _of_effort(channel, rows) if channel.name == "effort" else _of_error(channel, rows, along)
        return {**found, **own}

    return columns


def _scale(channel, rows):
    """Scale of the channel in every row (n,), in its unit."""
    scale = np.zeros(len(rows.log))
    for code, value in channel.scale.items():
        scale[rows.condition == code] = value
    return scale


def _moving(rows):
    """1 in motion, 0 at rest (n,)."""
    return (rows.motion.direction != 0.0).astype(float)


def _relative(rows):
    """(speed, acceleration) over the largest of the move (n,)."""
    m = rows.motion
    return m.speed / max(m.top_speed, 1e-300), m.acceleration / max(m.top_acceleration, 1e-300)


def _model(channel, rows, count):
    """The baseline's ``count`` coefficients of the condition of every row, (n, count)."""
    table = [channel.models.get(int(c), np.zeros(count)) for c in range(int(rows.condition.max()) + 1)]
    return np.array(table)[np.maximum(rows.condition, 0)]


def _cosines(weight, along, first=1):
    """Half waves along the stroke of ``along`` (0 … 1), from number ``first`` [1] on, times ``weight``: (n, k)."""
    return np.stack([weight * np.cos(np.pi * k * along) for k in range(first, WAVES + 1)], axis=1)


def _of_voltage(channel, rows):
    scale = _scale(channel, rows)
    ohmic = np.nan_to_num(rows.log.signals["current"]) * _model(channel, rows, 3)[:, 1]
    return {
        "gain": channel.predicted(rows)[:, None],
        "constant": scale[:, None],
        "dead zone": (scale * np.sign(ohmic))[:, None],
        "resistive": ohmic[:, None],
    }


def _of_forces(channel, rows):
    """What a force in proportion to direction, speed or acceleration moves in effort and error."""
    m, moving, scale = rows.motion, _moving(rows), _scale(channel, rows)
    turned = channel.orientation(rows)
    unit, (speed, acceleration) = scale * turned, _relative(rows)
    return {
        "level": (turned * _friction(channel, rows, scale))[:, None],
        "viscous": (unit * speed * moving)[:, None],
        "quadratic": (unit * speed * np.abs(speed) * moving)[:, None],
        "moving": (unit * moving)[:, None],
        "constant": (unit * (1.0 if channel.signed else moving))[:, None],
        "inertia": (unit * acceleration * moving)[:, None],
        "start": (unit * m.direction * (m.state == START))[:, None],
        "brake": (unit * m.direction * (m.state == BRAKE))[:, None],
    }


def _of_place(channel, rows, along):
    """What belongs to a place ``along`` (0 … 1) the stroke; nothing where places are not known (None)."""
    if along is None:
        return {}
    moving, scale = _moving(rows), _scale(channel, rows)
    unit = scale * channel.orientation(rows)
    friction = unit * rows.motion.direction
    hats = [friction * np.clip(1.0 - np.abs(along * BUMPS - k), 0.0, 1.0) for k in range(BUMPS + 1)]
    return {
        "spring": (unit * (2.0 * along - 1.0) * (1.0 if channel.signed else moving))[:, None],
        "waves": _cosines(friction, along),
        "bumps": np.stack(hats, axis=1),
        "waves of force": _cosines(unit * moving, along, first=2),
        "place": (scale * (2.0 * along - 1.0))[:, None],
    }


def _of_turn(channel, rows, turn):
    """Force and friction that repeat with every ``turn`` (in the unit of the position; 0: no turn is known)."""
    if not turn:
        return {}
    phase = 2.0 * np.pi * rows.motion.x / turn
    unit = _scale(channel, rows) * channel.orientation(rows) * _moving(rows)
    waves = np.stack([unit * w for k in (1, 2) for w in (np.cos(k * phase), np.sin(k * phase))], axis=1)
    return {"turn": waves, "turn of friction": waves * rows.motion.direction[:, None]}


def _of_effort(channel, rows):
    m, turned = rows.motion, channel.orientation(rows)
    electric = channel.predicted(rows) - turned * m.speed * _moving(rows) * _model(channel, rows, 7)[:, 2]
    return {
        "dead zone": (_scale(channel, rows) * turned * m.direction)[:, None],
        "resistive": electric[:, None],
    }


def _of_error(channel, rows, along):
    """What moves the following error alone, and what forces leave there behind the loop."""
    m, moving, scale, (speed, acceleration) = rows.motion, _moving(rows), _scale(channel, rows), _relative(rows)
    return {
        **_transients(channel, rows),
        **_through_loop(channel, rows, along),
        "lost motion": (scale * m.last)[:, None],
        "speed": (scale * speed * moving)[:, None],
        "acceleration": (scale * acceleration)[:, None],
        "creep": (scale * (1.0 - moving) * m.last * np.log1p(m.since / DWELL))[:, None],
        "load": (scale * (m.direction + acceleration))[:, None],
        "offset": scale[:, None],
    }


def _transients(channel, rows):
    """What an integrator takes back: direction, speed and motion behind the loop's lag and its memory."""
    moving, scale = _moving(rows), _scale(channel, rows)

    def passed(signal):
        return high_pass(low_pass(signal, channel.lag, rows.log.period), channel.memory, rows.log.period)

    return {
        "level transient": (scale * passed(rows.motion.direction))[:, None],
        "speed transient": (scale * passed(_relative(rows)[0]))[:, None],
        "force in error": np.stack([scale * moving, scale * passed(moving)], axis=1),
    }


def _through_loop(channel, rows, along):
    """What a changed force adds to the error, through the loop's own response: columns "… in error"."""
    s, moving, (speed, acceleration) = rows.motion.direction, _moving(rows), _relative(rows)
    forces = {
        "friction": s,
        "viscous": speed * moving,
        "quadratic": speed * np.abs(speed),
        "asymmetry": moving,
        "constant": np.ones(len(s)),
        "inertia": acceleration * moving,
    }
    if along is not None:
        forces["spring"] = 2.0 * along - 1.0
    found = {f"{name} in error": through_loop(channel, rows, force)[:, None] for name, force in forces.items()}
    found["constant in error"] *= moving[:, None]       # at rest friction may hold it
    if along is not None:
        waves = _cosines(s, along).T
        found["waves in error"] = np.stack([through_loop(channel, rows, wave) for wave in waves], axis=1)
    return found


def _friction(channel, rows, scale):
    """The baseline's friction along the motion, F sgn v + B v: what a change of the level scales. Where levels were
    shifted, its scale."""
    m = rows.motion
    out = scale * m.direction
    if channel.name != "effort" or rows.log.shift is not None:
        return out
    for code, model in channel.models.items():
        own = (rows.condition == code) & (m.direction != 0.0)
        friction = model[1] * m.direction[own] + model[2] * m.speed[own]
        if own.any() and np.mean(friction * m.direction[own]) > 0.3 * channel.scale[code]:
            out[own] = friction
    return out
