"""What an examination of the diagnosis by re-simulation draws: an axis, its motion, its noise and effects to hide.

Effects of force drives are scaled to the axis, so that each is clearly visible; those of one kind of drive or sensor
draw their sizes themselves (`Effect.draw`).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.effects import REGISTRY
from microstage_ros.model.effects.drive import GRAVITY
from microstage_ros.places import config_file

TOP_SPEED = (0.05, 0.15)       # m/s, range of the fastest stroke of a force drive
RAMP = 0.08                    # s, of every change of its speed


class Drive(NamedTuple):
    """One kind of axis.

    Attributes
    ----------
    file : axis file in ``config``. own : numbers of it that are drawn, within a ``factor`` [1] of what it gives.
    program : ``program(generator, axis, repeats)`` → program of a run file.
    sizes : ``sizes(axis, generator)`` → {id: parameters} of all effects that may be hidden.
    noise : ``noise(generator)`` → noise of a run file.
    seen : columns that the diagnosis is given; all that are measured where it is empty.
    """

    file: str
    own: tuple
    factor: float
    program: Callable
    sizes: Callable
    noise: Callable = lambda generator: {}
    seen: tuple = ()


def drawn_axis(drive, generator):
    """`Axis` of a `Drive`'s file with numbers of its own, by a ``generator``."""
    axis = load_axis(config_file(drive.file))
    return axis.with_values({
        key: axis.value(key) * drive.factor ** float(generator.uniform(-1.0, 1.0)) for key in drive.own
    })


def motion(generator, period, repeats):
    """Reference [m] every ``period`` [s]: strokes of several speeds there and back with rests between, ``repeats`` [1]
    times over, or three such pairs of strokes, each with speeds of its own, where nothing repeats."""
    speeds = []
    for _ in range(3 if repeats == 1 else 1):
        top = float(np.exp(generator.uniform(*np.log(TOP_SPEED))))
        way = top * float(generator.uniform(0.4, 0.7))
        for part in (generator.dirichlet((3.0, 3.0)), -generator.dirichlet((3.0, 3.0))):
            for share, speed in zip(part, (0.4 * top, top)):
                speeds += [np.full(int(abs(share) * way / speed / period), math.copysign(speed, share))]
            speeds += [np.zeros(int(float(generator.uniform(0.05, 0.3)) / period))]
    course = np.tile(np.concatenate(speeds), repeats)
    ramp = np.ones(int(RAMP / period)) / int(RAMP / period)
    return np.cumsum(np.convolve(course, ramp)[:len(course)]) * period


def _moves(generator, axis, repeats):
    """Two more targets than ``repeats`` over nine tenths of the travel, with rests."""
    low, high = 0.9 * axis.value("travel.minimum"), 0.9 * axis.value("travel.maximum")
    return [{"move_to_m": float(generator.uniform(low, high)), "dwell_s": float(generator.uniform(0.2, 0.8))}
            for _ in range(repeats + 2)]


def _scans(way, speed):
    """``program`` of `Drive`: there and back, by a distance in the range ``way`` [m] at a speed in the range ``speed``
    [m/s] each time, with one more way than ``repeats``."""
    def program(generator, axis, repeats):
        drawn = [generator.uniform(*zip(way, speed, (0.05, 0.3))) for _ in range(repeats + 1)]
        return [{"scan": {"to_m": (-1.0)**k * float(to), "speed_m_s": float(fast)}, "dwell_s": float(rest)}
                for k, (to, fast, rest) in enumerate(drawn)]
    return program


def _signed(generator, low, high):
    return float(generator.uniform(low, high) * generator.choice((-1.0, 1.0)))


def _of_force(axis, generator):
    coulomb, mass, gain, period, pitch = (axis.value(key) for key in (
        "contacts.guideway.coulomb", "stage.mass", "drive.gain", "period", "transmission.pitch"))

    def signed(low, high):
        return _signed(generator, low, high)

    phase = float(generator.uniform(-math.pi, math.pi))
    exponent = float(generator.choice((0.5, 1.5, 2.0)))
    return {
        "payload_change": {"mass_kg": signed(0.1, 0.3) * mass},
        "gravity_tilt": {"angle_rad": math.asin(signed(0.2, 0.6) * coulomb / mass / GRAVITY)},
        "amplifier_offset": {"offset_V": signed(0.2, 0.6) * coulomb / gain},
        "amplifier_gain": {"factor": 1.0 + signed(0.05, 0.2)},
        "viscous_change": {"contact": "guideway", "factor": math.exp(signed(0.3, 0.7))},
        "friction_level_change": {"contact": "guideway", "factor": math.exp(signed(0.1, 0.3))},
        "direction_asymmetry": {"contact": "guideway", "asymmetry": signed(0.05, 0.3),
                                "viscous_asymmetry": signed(0.1, 0.4)},
        "nonlinear_viscous": {"contact": "guideway", "exponent": exponent,
                              "coefficient": abs(signed(0.2, 0.6)) * coulomb / TOP_SPEED[0]**exponent},
        "position_dependent_friction": {"contact": "guideway", "amplitude": abs(signed(0.05, 0.2)), "period_m": pitch,
                                        "phase_rad": phase, "positions_m": [0.0], "factors": [1.0]},
        "torque_ripple": {"amplitude_Nm": [abs(signed(0.05, 0.15)) * coulomb * pitch / (2.0 * math.pi)],
                          "cycles_per_turn": [1.0], "phase_rad": [phase]},
        "cable_spring": {"stiffness_N_m": abs(signed(0.3, 1.0)) * coulomb / TOP_SPEED[0], "anchor_m": 0.02},
        "amplifier_deadband": {"half_width_V": abs(signed(0.1, 0.4)) * coulomb / gain},
        "actuator_lag": {"time_s": abs(signed(0.5, 3.0)) * period},
        "transport_delay": {"delay_s": abs(signed(0.5, 3.0)) * period},
        "sampling_jitter": {"late_s": abs(signed(0.5, 1.0)) * period},
    }


def _of_position(*own):
    """``sizes`` of `Drive`: effects of the kind of drive and sensor, and a command that comes late."""
    def sizes(axis, generator):
        period = axis.value("period")
        found = {name: REGISTRY[name].draw(generator, 1.0) for name in own}
        return found | {"actuator_lag": {"time_s": float(generator.uniform(1.0, 5.0)) * period},
                        "transport_delay": {"delay_s": float(generator.uniform(1.0, 5.0)) * period}}
    return sizes


def _of_voice_coil(axis, generator):
    coulomb, mass = axis.value("contacts.guideway.coulomb"), axis.value("stage.mass")
    # a tilt that friction holds, and a cable that over 5 mm of stroke pulls as much as friction
    tilt = math.asin(_signed(generator, 0.3, 0.8) * coulomb / mass / GRAVITY)
    asymmetry, viscous = _signed(generator, 0.1, 0.4), _signed(generator, 0.1, 0.4)
    return _of_position("force_constant_droop")(axis, generator) | {
        "payload_change": {"mass_kg": _signed(generator, 0.1, 0.3) * mass},
        "viscous_change": {"contact": "guideway", "factor": math.exp(_signed(generator, 0.3, 0.7))},
        "friction_level_change": {"contact": "guideway", "factor": math.exp(_signed(generator, 0.2, 0.5))},
        "gravity_tilt": {"angle_rad": tilt},
        "direction_asymmetry": {"contact": "guideway", "asymmetry": asymmetry, "viscous_asymmetry": viscous},
        "cable_spring": {"stiffness_N_m": float(generator.uniform(0.3, 1.0)) * coulomb / 5e-3, "anchor_m": 0.0},
    }


def _noise_of_force(generator):
    return {"encoder_m": float(generator.uniform(1e-8, 4e-8)), "voltage_V": float(generator.uniform(1e-3, 4e-3)),
            "current_A": 0.0, "interferometer_m": 0.0, "friction_relative": float(generator.uniform(0.005, 0.03))}


DRIVES = {
    "force": Drive(
        "emps.yaml", ("stage.mass", "contacts.guideway.coulomb", "contacts.guideway.viscous"), 2.0,
        lambda generator, axis, repeats: [{"reference": motion(generator, axis.value("period"), repeats)}],
        _of_force, _noise_of_force, ("encoder_m", "reference_m", "voltage_V"),
    ),
    "piezo": Drive(
        "axes/piezo.yaml", ("drive.stack_stiffness", "drive.displacement_per_volt", "stage.mass"), 1.5, _moves,
        _of_position("piezo_creep", "piezo_hysteresis", "piezo_gain", "sensor_drift"),
    ),
    "stepper": Drive(
        "axes/stepper.yaml", ("stage.mass", "contacts.guideway.coulomb", "drive.detent_torque"), 1.5,
        _scans((2e-4, 2e-3), (1e-3, 4e-3)),
        _of_position("lost_steps", "detent_torque", "lvdt_nonlinearity", "sensor_drift"),
    ),
    "voice_coil": Drive(
        "axes/voice_coil.yaml",
        ("stage.mass", "contacts.guideway.coulomb", "contacts.guideway.viscous", "drive.force_constant"), 1.5,
        _scans((3e-3, 9e-3), (0.02, 0.12)), _of_voice_coil,
    ),
}
"""Kinds of axes to examine, by name."""
