"""A second world for the campaign, so that no figure rests on one simulator's habits.

Same machine, same effects, everything else other than in `simulated_records`: programmes (raised-cosine journeys,
staircases, chirps, noise in place of tones, long rests), controllers (PID of other strength, PID with feed-forward, the
self-tuning law and the shipped one), encoders and noise levels, what scales the friction (a fixed wavy profile of the
place that every record repeats, and jumps in time, neither of them Gaussian), and the friction law of the machine
itself: the diagnosis is given the axis file with its generalised Maxwell-slip law while the machine may be one of
Leuven's or of LuGre's law, with the stiffness, limit and Stribeck curve of the file.
"""

import dataclasses
import math

import numpy as np

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.runs.closed_loop import TRACE, run_loop, surroundings
from microstage_ros.control.trajectories import profiles
from microstage_ros.diagnosis.validation.simulated_records import CHUNK, NAMES, SEEN, Hidden, noise_seed
from microstage_ros.model.axis_file import axis_from_dict
from microstage_ros.model.effects import REGISTRY
from microstage_ros.model.effects.effect import BLOCKS, STRIBECK
from microstage_ros.model.friction.contact import blocks_of
from microstage_ros.numerics.compiled import compiled
from microstage_ros.records import Record
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work

LAWS = ("generalised_maxwell_slip", "leuven", "lugre")
LAW_SHARES = (0.5, 0.3, 0.2)
CONTROLLERS = ("pid", "pid_feedforward", "self_tuning", "self_tuning_observer")
#: Those that find their gains themselves.
SELF_TUNED = CONTROLLERS[2:]


@dataclasses.dataclass(frozen=True)
class Habits:
    """What one machine of this world is like, in all of its records."""

    law: str
    controller: str
    proportional: float
    encoder_resolution: float
    noise: NoiseSpec
    friction: float
    profile: tuple          # ((wave number [rad/m], phase [rad], relative amplitude), …)
    jump_every: float       # s, mean time between jumps of the friction
    jump: float             # relative size of one


def habits(generator, friction):
    """`Habits` drawn for one machine whose friction varies by ``friction`` (relative standard deviation)."""
    share = generator.uniform(0.2, 0.9)     # of the variance that goes with the place
    waves = tuple((2.0 * np.pi / length, generator.uniform(0.0, 2.0 * np.pi), friction * np.sqrt(2.0 * share / 5.0))
                  for length in np.exp(generator.uniform(*np.log([6.0e-5, 9.0e-4]), 5)))
    return Habits(
        law=str(generator.choice(LAWS, p=LAW_SHARES)),
        controller=str(generator.choice(CONTROLLERS)),
        proportional=float(np.exp(generator.uniform(*np.log([1.0e5, 4.0e5])))),
        encoder_resolution=float(generator.choice([5.0e-9, 10.0e-9, 25.0e-9, 50.0e-9])),
        noise=NoiseSpec(
            encoder_m=generator.uniform(2.0e-9, 1.2e-8),
            voltage_V=generator.uniform(3.0e-4, 2.0e-3),
            current_A=None,     # the file's: a law that feeds back the current passes its noise on to the voltage
            interferometer_m=generator.uniform(3.0e-9, 1.5e-8),
            friction_relative=0.0,
        ),
        friction=friction,
        profile=waves,
        jump_every=float(generator.uniform(0.5, 4.0)),
        jump=float(friction * np.sqrt(1.0 - share)),
    )


def make_case(axis, hidden, seed, friction=0.04, law=None):
    """Four records of one case as `simulated_records.make_case` gives them: ``([rec1, rec2], [hold], [base])``.

    Parameters
    ----------
    axis : the `Axis` that the diagnosis is given.
    hidden : `simulated_records.Hidden`.
    seed : of everything drawn [1].
    friction : relative standard deviation of the friction's variation.
    law : friction law of the machine's actuator, one of `LAWS`; None draws one (the first where an effect is hidden
        that needs its blocks).
    """
    own = _habits_of(hidden, seed, friction, law)
    machine = machine_of(axis, own)
    records = [_record(machine, hidden if name != "base" else Hidden("healthy"), own, [seed, 78, number], name)
               for number, name in enumerate(NAMES)]
    return records[:2], records[2:3], records[3:]


def make_twin(axis, hidden, seed, friction=0.04, draws=1):
    """The held-out record of `make_case` as the same machine makes it with nothing ``hidden`` in it.

    A list of ``draws`` [1] `Record` of the same programme and the same variation of the ``friction`` [1], the first
    with the same noise by ``seed`` [1], the others with other noise."""
    own = _habits_of(hidden, seed, friction, None)
    number = NAMES.index("hold")
    return [_record(machine_of(axis, own), Hidden("healthy"), own, [seed, 78, number], NAMES[number], draw)
            for draw in range(draws)]


def law_of(hidden, seed, friction):
    """Name of the friction law of the machine in which this is ``hidden``; ``seed``, ``friction``: of `make_case`
    [1]."""
    return _habits_of(hidden, seed, friction, None).law


def _habits_of(hidden, seed, friction, law):
    """`Habits` of a case; every law but the first has no blocks, which some effects need."""
    own = habits(np.random.default_rng([seed, 77]), friction)
    if law is None and any(REGISTRY[effect].needs in (BLOCKS, STRIBECK) for effect in hidden.effects):
        law = LAWS[0]
    return own if law is None else dataclasses.replace(own, law=law)


def machine_of(axis, own):
    """The machine behind an axis file: its encoder, and its actuator's friction law with the file's stiffness and
    limits; ``own``: its `Habits`."""
    tree = axis.with_values({"sensors.encoder.resolution": own.encoder_resolution}).as_dict()
    if own.law != axis.law("actuator"):
        stiffness, weight = blocks_of(axis, "actuator")
        old, new = tree["contacts"]["actuator"], {"law": own.law}
        for leaf in ("static", "coulomb", "stribeck_velocity", "stribeck_exponent", "viscous"):
            new[leaf] = old[leaf]
        # one bristle: the stiffness at which half of the limit is reached as with the blocks
        if own.law == "lugre":
            limit = axis.value("contacts.actuator.static")
            way = np.geomspace(1e-7, 1.0, 4000)
            curve = np.minimum(stiffness * way[:, None], weight * limit).sum(axis=1)
            half = float(np.interp(0.5 * limit, curve, way))
            new["stiffness"] = {"value": float(np.log(2.0) * limit / half), "unit": "N m/rad", "source": "derived"}
        else:
            new |= {leaf: old[leaf] for leaf in ("stiffness", "weight")}
            new["exponent"] = {"value": 6.0, "unit": "1", "source": "estimate"}
        tree["contacts"]["actuator"] = new
    return axis_from_dict(tree, axis.place)


def _record(axis, hidden, own, seed, name, draw=0):
    generator = np.random.default_rng(seed)
    period = axis.value("period")
    reference, off = program(generator, generator.uniform(-2.0e-3, 1.0e-3), period)
    plant = make_plant(axis, noise=own.noise, effects=hidden.effects)
    plant["varies"] = 1
    state = new_state(plant, seed=noise_seed(generator, draw), position=float(reference[0]), friction="random")
    vary = _variation(own, generator)
    gains = {} if own.controller in SELF_TUNED else {"proportional": own.proportional}
    controller, idle = make_controller(own.controller, axis, **gains), make_controller("none", axis)
    work, readings, zero = new_work(plant), new_readings(), np.zeros(len(reference))
    trace = np.empty((len(reference), len(TRACE)))
    edges = sorted({0, len(reference), *off, *(range(0, len(reference), CHUNK) if hidden.change else ())})
    for start, stop in zip(edges, edges[1:]):
        used = idle if off[0] <= start < off[1] else controller
        part = slice(start, stop)
        loop = (plant, state, work, readings, used.parameters, used.memory, reference[part], zero[part], trace[part])
        if hidden.change:      # from Python only
            _vary(plant, state, vary, start * period)
            hidden.change(plant, state, start * period)
            run_loop(*loop[:-2], zero[part], *loop[-2:])
        else:
            _run_varied(*loop, vary, start, period)
    columns = {"t_s": np.arange(len(reference)) * period, "reference_m": reference}
    columns |= {key: trace[:, TRACE.index(key)].copy() for key in SEEN}
    columns |= surroundings(trace)
    if hidden.after:
        hidden.after(columns, generator)
    return Record(period, columns, f"{hidden.name}/{name}", {"seed": seed, "machine": own.law})


def _variation(own, generator):
    """What `_run_varied` needs of the friction's variation: waves along the stroke (k, 3), moments of its jumps [s],
    their heights, and the factor that stands in the plant."""
    times = np.cumsum(generator.exponential(own.jump_every, 400))
    heights = own.jump * generator.uniform(-np.sqrt(3.0), np.sqrt(3.0), len(times) + 1)
    return np.array(own.profile), times, heights, np.ones(1)


@compiled
def _vary(plant, state, vary, time):
    """Set the friction's factor for this place and time."""
    waves, times, heights, now = vary
    x, here = state.x, 0.0
    for k in range(len(waves)):
        here += waves[k, 2] * math.sin(waves[k, 0] * x + waves[k, 1])
    factor = max(1.0 + here + heights[np.searchsorted(times, time)], 0.5)
    # relative to what stands there: what is hidden may have changed the level, too
    plant.actuator.level *= factor / now[0]
    plant.guideway.level *= factor / now[0]
    now[0] = factor


@compiled
def _run_varied(plant, state, work, readings, parameters, memory, reference, zero, trace, vary, first, period):
    """`run_loop` over rows of a record that begin at row ``first``; every `CHUNK` periods the friction's factor is set
    anew."""
    start = 0
    while start < len(reference):
        stop = min(start + CHUNK - (first + start) % CHUNK, len(reference))
        _vary(plant, state, vary, (first + start) * period)
        run_loop(
            plant,
            state,
            work,
            readings,
            parameters,
            memory,
            reference[start:stop],
            zero[start:stop],
            zero[start:stop],
            trace[start:stop],
        )
        start = stop


def program(generator, home, period):
    """Reference [m] about ``home`` [m], every ``period`` [s], of one record of 22 to 30 s, and the rows (start, stop)
    where the motor is off."""
    parts = [
        _journey(home, generator, speed, period) for speed in np.exp(generator.uniform(*np.log([8e-5, 2.2e-3]), 4))
    ]
    parts += [_stairs(home, generator, period), _chirp(home, generator, period), _shaken(home, generator, period),
              _rests(home, generator, period), _rests(home, generator, period)]
    idle = np.full(int(generator.uniform(0.8, 1.5) / period), home)
    order = generator.permutation(len(parts) + 1)
    reference, off = [np.full(int(0.3 / period), home)], (0, 0)
    for number in order:
        if number == len(parts):
            start = sum(map(len, reference))
            off = (start, start + len(idle))
            reference.append(idle)
        else:
            reference.append(parts[number])
        reference.append(np.full(int(generator.uniform(0.05, 0.5) / period), home))
    return np.concatenate(reference), off


def _cosine(a, b, duration, period):
    """Raised-cosine speed from a to b."""
    s = np.linspace(0.0, 1.0, max(int(duration / period), 2))
    return a + (b - a) * (s - np.sin(2.0 * np.pi * s) / (2.0 * np.pi))


def _journey(at, generator, speed, period):
    """Out, a rest, and back another way: constant speed one way, raised cosine the other."""
    length = min(speed * generator.uniform(1.0, 2.0), 4.5e-3) * generator.choice([-1.0, 1.0])
    out = profiles.scan(at, at + length, speed, period)
    rest = np.full(int(generator.uniform(0.05, 0.4) / period), at + length)
    return np.concatenate([out, rest, _cosine(at + length, at, abs(length) / speed * 1.4, period)])


def _stairs(at, generator, period):
    """Steps of one sign up, of another size down, with rests between."""
    here, parts = at, []
    for size in (*generator.uniform(1e-6, 2e-5, 3), *(-generator.uniform(3e-6, 3e-5, 2)), None):
        target = at if size is None else here + size
        parts += [_cosine(here, target, 0.04, period), np.full(int(generator.uniform(0.1, 0.5) / period), target)]
        here = target
    return np.concatenate(parts)


def _chirp(at, generator, period):
    """A sine whose frequency runs up from 0.5 to 6 Hz while its amplitude falls: 200 µm to 8 µm."""
    t = np.arange(int(3.0 / period)) * period
    phase = 2.0 * np.pi * 0.5 * 3.0 / np.log(12.0) * (12.0 ** (t / 3.0) - 1.0)
    window = np.minimum(1.0, np.minimum(t, t[::-1]) / 0.3)
    size = 2.0e-4 * (0.04 ** (t / 3.0)) * generator.uniform(0.7, 1.2)
    return at + window * size * np.sin(phase)


def _shaken(at, generator, period):
    """Noise of 40 to 400 Hz, some 60 nm rms, at rest and on the way."""
    rows = int(2.0 / period)
    spectrum = np.fft.rfftfreq(rows, period)
    shape = ((spectrum > 40.0) & (spectrum < 400.0)) * np.exp(2j * np.pi * generator.uniform(size=len(spectrum)))
    noise = np.fft.irfft(shape, rows)
    noise *= 6.0e-8 / noise.std() * np.minimum(1.0, np.minimum(np.arange(rows), np.arange(rows)[::-1]) * period / 0.05)
    way = np.concatenate([np.full(rows // 3, at), _cosine(at, at + 3e-4, rows * period / 3.0, period)])
    way = np.concatenate([way, _cosine(at + 3e-4, at, (rows - len(way)) * period, period)])
    return np.resize(way, rows) + noise


def _rests(at, generator, period):
    """Moves that start after rests of a tenth of a second to three seconds, out and back."""
    here, parts = at, []
    for rest in np.exp(generator.uniform(*np.log([0.1, 1.6]), 3)):
        target = at + generator.uniform(1e-4, 6e-4) * generator.choice([-1.0, 1.0])
        parts += [profiles.jerk_limited_move(here, target, period), np.full(int(rest / period), target)]
        here = target
    return np.concatenate([*parts, profiles.jerk_limited_move(here, at, period)])
