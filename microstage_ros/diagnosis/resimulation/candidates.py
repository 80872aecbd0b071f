"""What a re-simulated axis may lack: effects of the catalogue as candidates.

A candidate (`model.effects.resimulated.Candidate`) has *sizes*, which are zero where the effect is absent and enter
nearly linearly, and *shapes* (a speed, an exponent), tried on a short grid before they are fitted. Several forms of one
effect compete; effects that a re-simulation sees alike are listed as look-alikes by the judge. Effects of one kind of
drive or sensor bring their candidates along (`Effect.resimulated`); a drive that is commanded with a position has no
others but the timing: friction and loads hardly move it.
"""

import math

import numpy as np

from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.effects import REGISTRY
from microstage_ros.model.effects.drive import GRAVITY
from microstage_ros.model.effects.resimulated import Candidate, Fitted
from microstage_ros.model.transmission import motor_ratio

SPLINE_POINTS = 6              # support points of a friction profile along the stroke
HARMONICS = (1, 2, 3)          # of the screw turn


def candidates(axis, parts):
    """All candidates for an axis and its records (list of `closed_loop.Measured`)."""
    brought = [
        candidate
        for effect in REGISTRY.values()
        if effect.acts_on(axis)
        for candidate in effect.resimulated(axis, parts)
    ]
    if actuator_of(axis).holds_position:
        found = [*brought, *_timing(axis.value("period"))]
    else:
        found = [*_of_forces(axis, parts), *brought]
    return [candidate for candidate in found if candidate.id not in axis.effects]


def _of_forces(axis, parts):
    contact = "guideway" if axis.law("guideway") != "none" else "actuator"
    friction = axis.value(f"contacts.{contact}.coulomb") if axis.has(f"contacts.{contact}.coulomb") else _typical(parts)
    position = np.concatenate([part.position for part in parts])
    low, high = float(position.min()), float(position.max())
    top_speed = max(float(np.abs(np.diff(part.position)).max()) for part in parts) / axis.value("period")
    return [
        *_friction(contact, friction, top_speed), *_position(contact, low, high, axis), _cable(friction, low, high),
        *_drive(axis, friction), *_timing(axis.value("period")),
    ]


def own_candidates(axis):
    """Effects that only move a number the axis file has: mass, viscosity, level of friction, offset, gain."""
    if actuator_of(axis).holds_position:
        return []
    contact = "guideway" if axis.law("guideway") != "none" else "actuator"
    key, gain, mass = f"contacts.{contact}", actuator_of(axis).force_per_command(axis), axis.value("stage.mass")
    viscous, level = (
        (f"{key}.viscous",),
        tuple(f"{key}.{leaf}" for leaf in ("coulomb", "static") if axis.has(f"{key}.{leaf}")),
    )
    offset, change = ("stage.offset_force",), Fitted("change", "1", 0.05, -0.9, 10.0)
    level_N = axis.value(level[0]) if level else mass

    def factor(p):
        return {"contact": contact, "factor": float(1.0 + p[0])}

    found = [
        Candidate(
            "payload_change",
            "other mass",
            (Fitted("mass_kg", "kg", 0.02 * mass, -0.9 * mass, 20 * mass),),
            lambda p: {"mass_kg": float(p[0])},
            lambda p: f"The moving mass differs by {p[0]:+.3g} kg.",
            stands_for=("stage.mass",),
            of=mass,
        ),
        Candidate(
            "gravity_tilt",
            "constant force",
            (Fitted("force_N", "N", 0.05 * level_N),),
            lambda p: {"angle_rad": float(math.asin(np.clip(p[0] / mass / GRAVITY, -1, 1)))},
            lambda p: f"A constant force of {p[0]:.3g} N, as of a tilt of {1e3 * p[0] / mass / GRAVITY:.3g} mrad.",
            stands_for=offset,
            of=level_N,
        ),
        Candidate(
            "amplifier_offset",
            "constant voltage",
            (Fitted("offset_V", "V", 0.05 * level_N / gain),),
            lambda p: {"offset_V": float(p[0])},
            lambda p: f"The amplifier is off zero by {1e3 * p[0]:.3g} mV.",
            stands_for=offset,
            of=level_N / gain,
        ),
        Candidate(
            "amplifier_gain",
            "gain",
            (change,),
            lambda p: {"factor": float(1.0 + p[0])},
            lambda p: f"The drive's gain differs by {p[0]:+.1%}.",
            stands_for=("stage.mass",),  # with the mass free, the axis's own numbers together are the gain's
        ),
    ]
    if axis.has(viscous[0]) and axis.value(viscous[0]) > 0.0:
        found.append(Candidate("viscous_change", "viscosity", (change,), factor,
                               lambda p: f"Viscous friction differs by {p[0]:+.0%}.", stands_for=viscous))
    if level:
        found += [
            Candidate(
                "friction_level_change",
                "all friction scaled",
                (change,),
                factor,
                lambda p: f"All friction differs by {p[0]:+.0%}.",
                stands_for=level,
            ),
            Candidate(
                "direction_asymmetry",
                "level of friction differs between directions",
                (Fitted("asymmetry", "1", 0.05, -0.9, 0.9),),
                lambda p: {"contact": contact, "asymmetry": float(p[0])},
                lambda p: (
                    f"Friction is {abs(2 * p[0]):.0%} larger in the {'positive' if p[0] > 0 else 'negative'} direction."
                ),
                stands_for=offset,
            ),
        ]
    return [candidate for candidate in found if candidate.id not in axis.effects]


def joint_candidates(axis):
    """Effects that change a number of the axis file and more: they take the place of others, which hold a part each."""
    if actuator_of(axis).holds_position:
        return []
    contact = "guideway" if axis.law("guideway") != "none" else "actuator"
    found = [
        Candidate(
            "direction_asymmetry",
            "all friction differs between directions",
            (Fitted("asymmetry", "1", 0.05, -0.9, 0.9), Fitted("viscous_asymmetry", "1", 0.05, -0.9, 0.9)),
            lambda p: {"contact": contact, "asymmetry": float(p[0]), "viscous_asymmetry": float(p[1])},
            lambda p: (
                f"Friction that does not depend on speed is {abs(2 * p[0]):.0%} larger in the "
                f"{'positive' if p[0] > 0 else 'negative'} direction, viscous friction {abs(2 * p[1]):.0%} in the "
                f"{'positive' if p[1] > 0 else 'negative'} one."
            ),
            stands_for=("stage.offset_force",),
        )
    ]
    return [candidate for candidate in found if candidate.id not in axis.effects]


def _typical(parts):
    return float(np.median(np.abs(np.concatenate([part.force for part in parts]))))


def _friction(contact, friction, top_speed):
    def asymmetry(p):
        return {"contact": contact, "asymmetry": 0.0, "viscous_asymmetry": float(p[0])}

    def film(p):
        return {"contact": contact, "coefficient": float(p[0] / p[1]), "exponent": 1.0, "saturation_speed": float(p[1])}

    def power(p):
        return {"contact": contact, "coefficient": float(p[0] / top_speed ** p[1]), "exponent": float(p[1])}

    return [
        Candidate(
            "direction_asymmetry",
            "viscous friction differs between directions",
            (Fitted("viscous_asymmetry", "1", 0.05, -0.9, 0.9),),
            asymmetry,
            lambda p: (
                f"Viscous friction is {abs(2 * p[0]) / (1 - abs(p[0])):.0%} larger in the "
                f"{'positive' if p[0] > 0 else 'negative'} direction than in the other."
            ),
        ),
        Candidate(
            "nonlinear_viscous",
            "friction builds up with speed and levels off",
            (Fitted("rise_N", "N", 0.1 * friction, -20 * friction, 20 * friction),),
            film,
            lambda p: (
                f"Friction {'grows' if p[0] > 0 else 'falls'} by {abs(p[0]):.3g} N between standstill and about "
                f"{3e3 * p[1]:.3g} mm/s, and is linear in speed above."
            ),
            (Fitted("saturation_speed", "m/s", 0.005 * top_speed, 1e-3 * top_speed, top_speed),),
            ((0.03 * top_speed, 0.1 * top_speed, 0.3 * top_speed),),
        ),
        Candidate(
            "nonlinear_viscous",
            "friction curved in speed",
            (Fitted("at_top_speed_N", "N", 0.1 * friction, -20 * friction, 20 * friction),),
            power,
            lambda p: f"Friction at the highest speed differs from a straight line in speed by {p[0]:.3g} N.",
            (Fitted("exponent", "1", 0.1, 0.1, 4.0),),
            ((0.5, 2.0, 3.0),),
        ),
    ]


def _position(contact, low, high, axis):
    points = np.linspace(low, high, SPLINE_POINTS)
    pitch = axis.value("transmission.pitch")

    def profile(p):
        factors = np.maximum(1.0 + np.asarray(p) - np.mean(p), 0.05)
        return {"contact": contact, "positions_m": points.tolist(), "factors": [float(f) for f in factors]}

    def ripple(p):
        return {"contact": contact, "amplitude": float(math.hypot(p[0], p[1])), "period_m": float(pitch),
                "phase_rad": float(math.atan2(p[1], p[0]))}

    found = [Candidate("position_dependent_friction", "smooth along the stroke",
                       tuple(Fitted(f"factor_{k}", "1", 0.05, -0.9, 5.0) for k in range(SPLINE_POINTS - 1)),
                       lambda p: profile([*p, 0.0]),
                       lambda p: f"Friction varies along the stroke by up to {np.ptp([*p, 0.0]):.0%}.")]
    if high - low > 3 * pitch:
        found += [
            Candidate("position_dependent_friction", "once per turn of the screw",
                      (Fitted("sine", "1", 0.02, -0.9, 0.9), Fitted("cosine", "1", 0.02, -0.9, 0.9)), ripple,
                      lambda p: f"Friction varies once per turn of the screw by ±{math.hypot(*p):.1%}."),
            _ripple(axis, HARMONICS[:1]), _ripple(axis, HARMONICS),
        ]
    return found


def _ripple(axis, harmonics):
    """Force of the motor that repeats with the turn of the screw: p holds sine and cosine force by harmonic [N]."""
    ratio = motor_ratio(axis)

    def effect(p):
        pairs = np.reshape(p, (-1, 2))
        return {"amplitude_Nm": [float(a) for a in np.hypot(*pairs.T) * ratio],
                "cycles_per_turn": [float(h) / axis.value("transmission.gear_ratio") for h in harmonics],
                "phase_rad": [float(a) for a in np.arctan2(pairs[:, 1], pairs[:, 0])]}

    return Candidate(
        "torque_ripple", f"with the turn of the screw, harmonics {', '.join(map(str, harmonics))}",
        tuple(Fitted(f"{part}_{h}_N", "N", 0.3) for h in harmonics for part in ("sine", "cosine")), effect,
        lambda p: f"The drive's force ripples by ±{math.hypot(p[0], p[1]):.2g} N with every turn of the screw.")


def _cable(friction, low, high):
    middle = round(0.5 * (low + high), 4)
    return Candidate(
        "cable_spring",
        "force linear in position",
        (Fitted("stiffness_N_m", "N/m", 0.05 * friction / (high - low)),),
        lambda p: {"stiffness_N_m": float(p[0]), "anchor_m": middle},
        lambda p: (
            f"A force of {p[0]:.3g} N per metre of stroke, which does not change with direction (cable, tilt of the"
            " guide)."
        ),
    )


def _drive(axis, friction):
    found = [
        Candidate(
            "amplifier_deadband",
            "no force about zero command",
            (Fitted("half_width_V", "V", 0.02 * friction / actuator_of(axis).force_per_command(axis), 0.0, 1.0),),
            lambda p: {"half_width_V": float(p[0])},
            lambda p: f"The amplifier gives nothing within ±{1e3 * p[0]:.3g} mV of zero.",
        )
    ]
    if axis.choices["transmission.type"] != "rigid":
        found += [
            Candidate("backlash", "lost motion of the drive", (Fitted("width_rad", "rad", 1e-3, 0.0, 1.0),),
                      lambda p: {"width_rad": float(p[0])}, lambda p: f"Lost motion of {p[0]:.3g} rad at the screw."),
            Candidate("drive_compliance", "drive train softer than given", (Fitted("softening", "1", 0.2, 0.0, 100.0),),
                      lambda p: {"stiffness_factor": float(1 / (1 + p[0]))},
                      lambda p: f"The drive train is {1 + p[0]:.2g} times softer than the axis file says."),
        ]
    return found


def _timing(period):
    size = 0.3 * period
    return [
        Candidate(
            "actuator_lag",
            "drive follows with a time constant",
            (Fitted("time_s", "s", size, 0.0, 50 * period),),
            lambda p: {"time_s": float(max(p[0], 1e-9))},
            lambda p: f"The drive's force follows the command with a time constant of {1e3 * p[0]:.2g} ms.",
        ),
        Candidate(
            "transport_delay",
            "command arrives late",
            (Fitted("delay_s", "s", size, 0.0, 50 * period),),
            lambda p: {"delay_s": float(p[0])},
            lambda p: f"The command arrives {1e3 * p[0]:.2g} ms late.",
        ),
        Candidate(
            "sampling_jitter",
            "encoder read late",
            (Fitted("late_s", "s", size, 0.0, 5 * period),),
            lambda p: {"late_s": float(p[0])},
            lambda p: f"The encoder is read {1e3 * p[0]:.2g} ms after its stamp.",
        ),
    ]
