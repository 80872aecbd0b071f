"""What a campaign hides in an axis: every effect of the catalogue, drawn with its own seed, and things outside it.

Sizes are those that a person would call clearly visible on the paper's axis; ``strength`` scales them.
Where an effect is a function (of position, of time), a random smooth function is drawn and not the one
that the analysis fits; periods, harmonics, damping and the course of a drift are drawn as well.
"""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from microstage_ros.diagnosis.validation.simulated_records import Hidden
from microstage_ros.model.effects import REGISTRY

LATE = "sampling_jitter"
JITTER = (1.0e-5, 5.0e-5)      # s, range of the random lateness that half of the late readings have
HALF = 0.5


def one(name, generator, strength=1.0):
    """`Hidden` with one effect of the catalogue, ``strength`` [1] times the usual."""
    return two((name,), generator, strength)


def two(names, generator, strength=1.0):
    """`Hidden` with some effects at once, ``strength`` [1] times the usual."""
    drawn = {name: REGISTRY[name].draw(generator, strength) for name in names}
    effects = {name: section for name, section in drawn.items() if isinstance(section, dict)}
    if LATE in effects:      # its own draw has no random part
        jitter = generator.uniform(*JITTER) * strength if generator.uniform() < HALF else 0.0
        effects[LATE] = effects[LATE] | {"jitter_s": jitter}
    courses = [section for section in drawn.values() if callable(section)]
    return Hidden("+".join(names), tuple(names), effects, after=courses[0] if courses else None)


def rms_along(hidden, found):
    """Standard deviation [1] of a hidden profile of friction where another one was found.

    ``hidden``, ``found``: ``positions_m`` [m] and ``factors`` [1], k and n of each; beyond what records visited, what
    was found is constant.
    """
    at, factors = np.array(found["positions_m"]), np.array(found["factors"])
    changes = np.flatnonzero(np.diff(factors))
    visited = at[changes[0]:changes[-1] + 2] if len(changes) else at
    return float(np.std(CubicSpline(hidden["positions_m"], hidden["factors"])(visited)))


def outside(kind, generator, strength=1.0):
    """`Hidden` with something that the catalogue does not hold, ``strength`` [1] times the usual."""
    return OUTSIDE[kind](generator, strength)


def _friction_bursts(generator, strength):
    """Friction that jumps up for some tenths of a second now and then (dirt)."""
    times = np.sort(generator.uniform(0.0, 30.0, 25))
    height = generator.uniform(0.3, 0.6) * strength
    state: dict[str, float] = {}

    def change(plant, _, time):
        level = state.setdefault("level", float(plant["actuator"]["level"]))
        burst = bool(np.any((time >= times) & (time < times + 0.25)))
        plant["actuator"]["level"] = level * (1.0 + height * burst)

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
    state: dict[str, float] = {}

    def change(plant, _, time):
        gain = state.setdefault("gain", float(plant["gain"]))
        plant["gain"] = gain * (1.0 + size * np.sin(2 * np.pi * frequency * time))

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
