"""What a campaign hides in an axis: every effect of the catalogue, drawn with its own seed, and things outside it.

Sizes are those that a person would call clearly visible on the paper's axis; ``strength`` scales them.
Where an effect is a function (of position, of time), a random smooth function is drawn and not the one
that the analysis fits; periods, harmonics, damping and the course of a drift are drawn as well.
"""

import numpy as np
from scipy.signal import lfilter

from microstage_ros.diagnosis.validation.simulated_records import Hidden


def _either_sign(generator, low, high):
    return float(generator.uniform(low, high) * generator.choice([-1.0, 1.0]))


def _smooth_profile(generator, relative):
    """Friction factors over ±6 mm: a smooth random function of the given standard deviation."""
    x = np.linspace(-6e-3, 6e-3, 41)
    wave = sum(generator.normal() * np.sin(2 * np.pi * x / length + generator.uniform(0, 2 * np.pi))
               for length in generator.uniform(0.8e-3, 6e-3, 6))
    wave *= relative / wave.std()
    return {"positions_m": x.tolist(), "factors": np.clip(1.0 + wave, 0.3, 2.0).tolist()}


def _ripple(generator, strength):
    """One to three terms, whole or half cycles per turn, the first the largest."""
    count = int(generator.integers(1, 4))
    cycles = generator.choice(np.concatenate([np.arange(1, 13), [0.5, 1.5, 2.5, 14, 16, 18, 24]]), count, replace=False)
    sizes = generator.uniform(8e-6, 3e-5) * strength * np.array([1.0, 0.5, 0.3])[:count]
    return {"amplitude_Nm": sizes.tolist(), "cycles_per_turn": cycles.tolist(),
            "phase_rad": generator.uniform(0, 6.28, count).tolist()}


def _signal(generator, strength):
    """A usual signal period, or any."""
    period = float(generator.choice([20e-6, 10e-6, 4e-6, 2e-6]) if generator.uniform() < 0.5 else np.exp(
        generator.uniform(*np.log([0.8e-6, 4e-5]))))
    return {"period_m": period, "amplitude1_m": generator.uniform(1e-8, 5e-8) * strength, "phase1_rad": generator.uniform(0, 6.28),
            "amplitude2_m": generator.uniform(0, 1e-8) * strength}


def _drift(generator, strength):
    """An exponential that every record repeats, or a smooth course of every record's own."""
    if generator.uniform() < 0.5:
        return {"amplitude_m": _either_sign(generator, 1e-7 * strength, 6e-7 * strength), "time_s": generator.uniform(3.0, 15.0)}
    size = generator.uniform(8e-8, 4e-7) * strength

    def after(columns, records):
        t = columns["t_s"]
        for _ in range(4):
            wave = np.sin(2 * np.pi * t / records.uniform(9.0, 40.0) + records.uniform(0, 2 * np.pi))
            columns["interferometer_m"] += 0.7 * size * records.normal() * wave

    return after


def _asymmetry(generator, strength):
    """Of the friction that sliding needs, and in every third case of the viscous part too."""
    found = {"asymmetry": _either_sign(generator, 0.1 * strength, 0.25 * strength)}
    if generator.uniform() < 0.33:
        found["viscous_asymmetry"] = _either_sign(generator, 0.1 * strength, 0.3 * strength)
    return found


def _nonlinear(generator, strength):
    """A power of the speed, or in every third case a growth that ends."""
    if generator.uniform() < 0.67:
        return {"coefficient": generator.uniform(1.5e-5, 4e-5) * strength, "exponent": generator.uniform(1.7, 2.3)}
    return {"coefficient": generator.uniform(2e-4, 6e-4) * strength, "exponent": 1.0, "saturation_speed": generator.uniform(0.8, 3.0)}


#: id: function (generator, strength) → the effect's section, or ``after(columns, generator)`` of `cases.Hidden`.
DRAWS = {
    "direction_asymmetry": _asymmetry,
    "position_dependent_friction": lambda g, s: _smooth_profile(g, g.uniform(0.08, 0.2) * s),
    "rising_static_friction": lambda g, s: {"rate_per_decade": g.uniform(0.1, 0.3) * s},
    "frictional_lag": lambda g, s: {"time_s": g.uniform(0.01, 0.05) * s},
    "presliding_creep": lambda g, s: {"amplitude_m": g.uniform(2e-8, 1e-7) * s, "time_s": g.uniform(0.02, 0.1)},
    "viscous_change": lambda g, s: {"factor": 1.0 + g.uniform(0.4, 2.0) * s},
    "nonlinear_viscous": _nonlinear,
    "friction_level_change": lambda g, s: {"factor": 1.0 + _either_sign(g, 0.12 * s, 0.3 * s)},
    "backlash": lambda g, s: {"width_rad": g.uniform(0.006, 0.03) * s},
    "drive_compliance": lambda g, s: {"stiffness_factor": 1.0 / (1.0 + g.uniform(4.0, 30.0) * s),
                                      "damping_factor": float(np.exp(g.uniform(-0.7, 0.7)))},
    "screw_pitch_error": lambda g, s: {"amplitude_m": g.uniform(1e-6, 4e-6) * s, "phase_rad": g.uniform(0, 6.28)},
    "torque_ripple": _ripple,
    "payload_change": lambda g, s: {"mass_kg": g.uniform(2.0, 6.0) * s},
    "gravity_tilt": lambda g, s: {"angle_rad": _either_sign(g, 0.03 * s, 0.12 * s)},
    "cable_spring": lambda g, s: {"stiffness_N_m": g.uniform(250.0, 1500.0) * s, "anchor_m": _either_sign(g, 0, 2e-3)},
    "amplifier_offset": lambda g, s: {"offset_V": _either_sign(g, 0.015 * s, 0.05 * s)},
    "amplifier_deadband": lambda g, s: {"half_width_V": g.uniform(0.01, 0.05) * s},
    "amplifier_gain": lambda g, s: {"factor": 1.0 + _either_sign(g, 0.05 * s, 0.15 * s)},
    "resistance_rise": lambda g, s: {"rise_per_joule": g.uniform(0.05, 0.2) * s, "time_s": g.uniform(5.0, 30.0)},
    "transport_delay": lambda g, s: {"delay_s": g.uniform(1.5e-4, 5e-4) * s},
    "actuator_lag": lambda g, s: {"time_s": g.uniform(1.5e-4, 6e-4) * s},
    "sampling_jitter": lambda g, s: {"late_s": g.uniform(2e-4, 6e-4) * s, "lost_fraction": g.uniform(0.0, 0.02)},
    "encoder_sde": _signal,
    "scale_error": lambda g, s: {"relative": _either_sign(g, 5e-5 * s, 3e-4 * s)},
    "thermal_drift": _drift,
    "refractive_index": lambda g, s: {"path_m": g.uniform(0.2, 0.6), "temperature_swing_K": g.uniform(0.5, 2.0) * s,
                                      "pressure_swing_Pa": g.uniform(50.0, 300.0) * s},
    "floor_vibration": lambda g, s: {"frequencies_hz": [g.uniform(15, 90)], "amplitudes_m": [g.uniform(4e-8, 2e-7) * s]},
}


def one(name, generator, strength=1.0):
    """`Hidden` with one effect of the catalogue."""
    return two((name,), generator, strength)


def two(names, generator, strength=1.0):
    """`Hidden` with some effects at once."""
    drawn = {name: DRAWS[name](generator, strength) for name in names}
    effects = {name: section for name, section in drawn.items() if isinstance(section, dict)}
    courses = [section for section in drawn.values() if callable(section)]
    return Hidden("+".join(names), tuple(names), effects, after=courses[0] if courses else None)


def outside(kind, generator, strength=1.0):
    """`Hidden` with something that the catalogue does not hold."""
    return OUTSIDE[kind](generator, strength)


def _friction_bursts(generator, strength):
    """Friction that jumps up for some tenths of a second now and then (dirt)."""
    times = np.sort(generator.uniform(0.0, 30.0, 25))
    height = generator.uniform(0.3, 0.6) * strength
    state = {"level": None}

    def change(plant, _, time):
        if state["level"] is None:
            state["level"] = float(plant["actuator"]["level"])
        burst = bool(np.any((time >= times) & (time < times + 0.25)))
        plant["actuator"]["level"] = state["level"] * (1.0 + height * burst)

    return Hidden("friction bursts", change=change, outside=True)


def _swinging_force(generator, strength):
    """A force on the stage that swings in time (a hose, an air flow)."""
    size, frequency = generator.uniform(0.5, 1.5) * strength, generator.uniform(0.6, 1.7)

    def change(plant, _, time):
        plant["push"] = size * np.sin(2 * np.pi * frequency * time)

    return Hidden("swinging force", change=change, outside=True)


def _supply_sag(generator, strength):
    """An amplifier whose gain breathes with a slow supply."""
    size, frequency = generator.uniform(0.08, 0.2) * strength, generator.uniform(0.2, 0.6)
    state = {"gain": None}

    def change(plant, _, time):
        if state["gain"] is None:
            state["gain"] = float(plant["gain"])
        plant["gain"] = state["gain"] * (1.0 + size * np.sin(2 * np.pi * frequency * time))

    return Hidden("supply that breathes", change=change, outside=True)


def _hysteresis_of_readings(generator, strength):
    """One position reading hangs behind the other by some travel (a loose reading head)."""
    size, travel = generator.uniform(5e-8, 2e-7) * strength, generator.uniform(1e-6, 5e-6)

    def after(columns, _):
        where = columns["encoder_m"]
        behind, hang = np.empty(len(where)), where[0]
        for n, x in enumerate(where):
            hang = min(max(hang, x - travel), x + travel)
            behind[n] = (x - hang) / travel
        columns["interferometer_m"] += size * behind

    return Hidden("hysteresis of readings", after=after, outside=True)


def _turbulent_air(generator, strength):
    """A random walk of the interferometer within tenths of a second."""
    size, time = generator.uniform(4e-8, 1e-7) * strength, generator.uniform(0.1, 0.5)

    def after(columns, records):
        keep = np.exp(-(columns["t_s"][1] - columns["t_s"][0]) / time)
        drive = records.normal(size=len(columns["t_s"])) * np.sqrt(1.0 - keep**2)
        columns["interferometer_m"] += size * lfilter([1.0], [1.0, -keep], drive)

    return Hidden("turbulent air", after=after, outside=True)


def _warming_friction(generator, strength):
    """Friction that falls in time as the grease warms."""
    size, time = generator.uniform(0.3, 0.6) * strength, generator.uniform(4.0, 10.0)
    state = {}

    def change(plant, _, now):
        level = state.setdefault("level", float(plant["actuator"]["level"]))
        plant["actuator"]["level"] = level * (1.0 + size * np.exp(-now / time))

    return Hidden("warming friction", change=change, outside=True)


def _wavy_force(generator, strength):
    """A force that waves along the stroke (a magnet, a seal with teeth)."""
    size, period = generator.uniform(0.3, 1.0) * strength, generator.uniform(3e-4, 6e-4)

    def change(plant, state, _):
        plant["push"] = -size * np.sin(2.0 * np.pi * float(state["x"]) / period)
        plant["smooth"] = 1

    return Hidden("wavy force", change=change, outside=True)


OUTSIDE = {"friction bursts": _friction_bursts, "swinging force": _swinging_force, "supply that breathes": _supply_sag,
           "hysteresis of readings": _hysteresis_of_readings, "turbulent air": _turbulent_air,
           "warming friction": _warming_friction, "wavy force": _wavy_force}
