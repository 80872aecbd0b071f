"""Records of a simulated axis with something hidden in it: what the tests and the campaign are made of.

One case is four records of one axis: two to learn from, one held out, one healthy baseline, each of
20–30 s of scans out and back, moves, steps, sines, dwells, ten-tone dither and a second with the motor
off, under a fixed PID whose gains the analysis does not get. What is hidden is an entry of the
``effects`` section, or a function that changes the plant every few milliseconds, so that forms can
differ from those that the analysis knows.
"""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.runs.closed_loop import TRACE, run_pieces, surroundings
from microstage_ros.control.trajectories import profiles
from microstage_ros.records import Record
from microstage_ros.solver.period import as_array
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work

OFF_TIME = 1.3          # s with the motor off
CHUNK = 10              # periods between two calls of ``change``
SCAN_SPEEDS = (1.0e-4, 4.0e-4, 8.0e-4, 2.1e-3)
NAMES = ("rec1", "rec2", "hold", "base")
SEEN = ("encoder_m", "voltage_V", "current_A", "interferometer_m")


@dataclasses.dataclass(frozen=True)
class Hidden:
    """What a case hides.

    Attributes
    ----------
    name : for tables.
    ids : effects that must be named, empty if healthy or outside the catalogue.
    effects : entries of the ``effects`` section.
    change : ``change(plant, state, time)``, called every `CHUNK` periods, may write into the plant; or None.
    after : ``after(columns, generator)`` changes the finished columns in place; or None.
    outside : True if the cause is none of the catalogue.
    """

    name: str
    ids: tuple = ()
    effects: dict = dataclasses.field(default_factory=dict)
    change: Callable | None = None
    after: Callable | None = None
    outside: bool = False


def make_case(axis, hidden, seed, friction=0.04):
    """Four records of one case: ``([rec1, rec2], [hold], [base])``.

    ``friction`` is the standard deviation of the random friction [1]; every record has its own seed, made of ``seed``
    [1].
    """
    records = []
    for number, name in enumerate(NAMES):
        what = hidden if name != "base" else Hidden("healthy")
        records.append(_record(axis, what, friction, [seed, number], name))
    return records[:2], records[2:3], records[3:]


def make_twin(axis, hidden, seed, friction=0.04, draws=1):
    """The held-out record of `make_case` as the same axis makes it with nothing ``hidden`` in it.

    A list of ``draws`` [1] `Record` of the same programme and ``friction`` [1], the first with the same noise by
    ``seed`` [1], the others with other noise, their random friction included."""
    number = NAMES.index("hold")
    return [_record(axis, Hidden("healthy"), friction, [seed, number], NAMES[number], draw) for draw in range(draws)]


def noise_seed(generator, draw):
    """Seed of a simulated record's noise [1], of 31 bits; ``draw`` [1]: 0 is the case's own, others are others."""
    own = int(generator.integers(2**31))
    return own if draw == 0 else int(np.random.default_rng([own, draw]).integers(2**31))


def _record(axis, hidden, friction, seed, name, draw=0):
    generator = np.random.default_rng(seed)
    period = axis.value("period")
    home = generator.uniform(-2.0e-3, 1.0e-3)
    reference, off = _program(generator, home, period)
    plant = make_plant(axis, noise=NoiseSpec(friction_relative=friction), effects=hidden.effects)
    state = new_state(plant, seed=noise_seed(generator, draw), position=float(reference[0]), friction="random")
    controller, idle = _pid(axis, generator), make_controller("none", axis)
    axis_arrays = [as_array(record) for record in (plant, state, new_work(plant), new_readings())]
    trace = np.empty((len(reference), len(TRACE)))
    zero = np.zeros(len(reference))
    for start, stop, still in _pieces(off, len(reference), CHUNK if hidden.change else len(reference)):
        if hidden.change:
            hidden.change(plant, state, start * period)
        used = idle if still else controller
        part = slice(start, stop)
        run_pieces(*axis_arrays, *used.arrays, reference[part], zero[part], zero[part], trace[part])
    columns = {"t_s": np.arange(len(reference)) * period, "reference_m": reference}
    columns |= {key: trace[:, TRACE.index(key)].copy() for key in SEEN}
    columns |= surroundings(trace)
    if hidden.after:
        hidden.after(columns, generator)
    return Record(period, columns, f"{hidden.name}/{name}", {"seed": seed})


def _pid(axis, generator):
    """A stable fixed PID of some strength."""
    return make_controller("pid", axis, proportional=float(np.exp(generator.uniform(*np.log([8.0e4, 3.5e5])))),
                           integral_time=generator.uniform(0.05, 0.1), derivative_time=generator.uniform(8e-4, 1e-3),
                           filter_time=3.0e-4)


def _pieces(off, rows, chunk):
    """(start, stop, motor off) that cover the rows in chunks and split at the ends of the off time."""
    edges = sorted({0, rows, *off, *range(0, rows, chunk)})
    return [(a, b, off[0] <= a < off[1]) for a, b in zip(edges, edges[1:])]


def _program(generator, home, period):
    """Reference [m] of one record, and the rows (start, stop) where the motor is off."""
    parts: list[Callable[[float], np.ndarray]]
    parts = [functools.partial(_out_and_back, generator=generator, speed=speed, period=period) for speed in SCAN_SPEEDS]
    parts += [lambda at: _there_and_back(at, 1.0e-3, 0.7, generator, period)]
    parts += [lambda at: _there_and_back(at, 1.5e-4, 0.5, generator, period) for _ in range(2)]
    parts += [lambda at: _steps(at, generator, period), lambda at: _dither(at, generator, period)]
    parts += [lambda at: _sine(at, 1.0e-5, 0.5, 2, period), lambda at: _dwell(at, OFF_TIME, period)]
    order = generator.permutation(len(parts))
    reference, off = [_dwell(home, 0.3, period)], (0, 0)
    for number in order:
        piece = parts[number](home)
        if number == len(parts) - 1:
            start = sum(map(len, reference))
            off = (start, start + len(piece))
        reference += [piece, _dwell(home, generator.uniform(0.1, 0.9), period)]
    return np.concatenate(reference), off


def _dwell(at, duration, period):
    return np.full(int(duration / period), at)


def _out_and_back(at, generator, speed, period):
    length = min(speed * generator.uniform(1.2, 2.2), 5.0e-3) * generator.uniform(0.8, 1.0)
    there = profiles.scan(at, at + length, speed, period)
    return np.concatenate([there, profiles.scan(at + length, at, speed, period)])


def _there_and_back(at, length, pause, generator, period):
    far = at + length * generator.choice([-1.0, 1.0])
    wait = _dwell(far, pause * generator.uniform(0.5, 1.5), period)
    return np.concatenate(
        [profiles.jerk_limited_move(at, far, period), wait, profiles.jerk_limited_move(far, at, period)]
    )


def _steps(at, generator, period):
    sizes = (2e-6, 1e-5, 3e-5, 5e-6, 0.0)
    moves, here = [], at
    for size in sizes:
        moves += [
            profiles.jerk_limited_move(here, at + size, period),
            _dwell(at + size, generator.uniform(0.15, 0.6), period),
        ]
        here = at + size
    return np.concatenate(moves)


def _sine(at, amplitude, frequency, cycles, period):
    return profiles.sine(at, amplitude, frequency, cycles, period)


def _dither(at, generator, period):
    """Ten tones at rest, while going out and while coming back."""
    rows = int(0.7 / period)
    t = np.arange(rows) * period
    tones = np.geomspace(50.0, 450.0, 10) * generator.uniform(0.97, 1.03, 10)
    phase = generator.uniform(0.0, 2.0 * np.pi, 10)
    sound = 5.0e-8 * np.sin(2.0 * np.pi * tones * t[:, None] + phase).sum(axis=1)
    sound *= np.minimum(1.0, np.minimum(t, t[::-1]) / 0.02)
    out = profiles.scan(at, at + 2.5e-4, 4.0e-4, period)
    base = [_dwell(at, 0.7, period), out, profiles.scan(at + 2.5e-4, at, 4.0e-4, period)]
    return np.concatenate([part + np.resize(sound, len(part)) for part in base])
