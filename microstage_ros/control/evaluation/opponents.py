"""Opponents searched as hard as the shipped law was: fixed laws by differential evolution, one program, seeds apart.

Every law of `OPPONENTS` is searched over the logarithms of its gains by SciPy's differential evolution (R. Storn and
K. Price, Journal of Global Optimization 11, 1997), within a factor of `REACH` of its shipped ones, on the seeds
`SEARCH_SEEDS`. Cost of a run of `PROGRAM`:

    ln(rms error in the sine) + mean over the moves of [ln(rms error of a move with its dwell)
                                                        + ln(1 nm + error at its end)]

Iterative learning and repetitive control (`repetition`) are searched after the fixed laws, beside the PID with
feed-forward that its own search found, and judged in their last trial, on a machine on which they learned. The linear
quadratic law is given current and voltage as the observer law is.

Nothing is asked of margins, since the observer law's own at the amplifier is 1 dB (docs/evidence/control.md): a search
with margins could only do worse. All laws are then judged on seeds that no search saw, on machines that no search had.

``gains``: {name: number in the unit of its `control.gains.Gain`}. ``seed``, ``seeds`` (k,), ``evaluations`` are counts
[1]; a cost is the sum of logarithms above [1].
"""

import functools
import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from microstage_ros.control.evaluation import repetition
from microstage_ros.control.laws.controller import controller_parameters, make_controller
from microstage_ros.control.laws.registry import law
from microstage_ros.control.robustness.conditions import conditions
from microstage_ros.control.runs.closed_loop import TRACE, run_loop
from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.trajectories.lead_in import lead_in
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work, usual_start

FIXED = ("proportional", "integral_time", "derivative_time", "filter_time")
OPPONENTS = {
    "pid": (*FIXED, "derivative_on_reference"),
    "pid_feedforward": (*FIXED, "friction_share", "motion_share"),
    "nctf": ("beta", "velocity_proportional", "velocity_integral", "filter_time"),
    "cascade_disturbance": ("position_rate", "velocity_rate", "disturbance_rate", "inertia_share", "filter_time"),
    "disturbance_rejection": ("controller_rate", "observer_rate", "inertia_share"),
    "sliding_mode": ("surface_rate", "switching", "layer", "filter_time"),
    "linear_quadratic": ("regulator_rate", "encoder_noise", "voltage_noise", "acceleration_noise", "friction_drift"),
}
NOT_SEARCHED = ("self_tuning", "self_tuning_observer")
REACH = 6.0
SHARES = {"derivative_on_reference": 1.0, "friction_share": 1.5, "motion_share": 1.5}  # their highest value
SEARCH_SEEDS, JUDGED_SEEDS = (0, 1), tuple(range(700, 710))
SINE_ROWS = 2.0  # s
TARGETS = (1e-6, 0.0, 1e-5, 0.0, 1e-4, 0.0, 1e-3, 0.0)  # m
PROGRAM = [
    {"sine": {"amplitude_m": 1e-5, "frequency_hz": 0.5, "cycles": 1.0}, "dwell_s": 0.1},
    *[{"move_to_m": target, "dwell_s": 0.2} for target in TARGETS],
]
JUDGED = (
    "nominal",
    "mass x 3",
    "stiffness x 0.5",
    "friction x 0.5",
    "friction x 2",
    "motor constant x 1.2",
    "delay 0.3 ms",
    "backlash 0.25 deg",
    "current noise 5 mA",
)


class Opponent(NamedTuple):
    """A law with its gains, and how they were found."""

    kind: str
    gains: dict
    cost: float
    evaluations: int


def read_opponents(path: str, option: str) -> list[Opponent]:
    """`Opponent` list of the laws that a search found, from its opponents.json.

    Raises
    ------
    InputError : the file of ``option`` is no such file.
    """
    try:
        listed = json.loads(Path(path).read_text(encoding="utf-8"))["opponents"]
        return [Opponent(**entry) for entry in listed if entry["evaluations"]]
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(option, path, "an opponents.json of an earlier compare --opponents") from None


class Figures(NamedTuple):
    """Worst over the seeds, true position [m]: peak in the sine, largest error in a move, error at a move's end."""

    sine: float
    moving: float
    settled: float


@functools.lru_cache(maxsize=8)
def _path(period, resolution):
    """(reference [m] with its lead-in, rows of the lead-in, rows at which the moves start, without it) of `PROGRAM`."""
    reference = Run(program=PROGRAM).tables(period)["reference"]
    before = lead_in(reference, resolution)
    moving = np.flatnonzero(np.diff(reference) != 0.0)
    starts = moving[np.flatnonzero(np.diff(moving, prepend=-10) > 0.05 / period)]
    return np.concatenate([before, reference]), len(before), starts[starts > SINE_ROWS / period]


class _Cell:
    """One machine with one law, which go on from call to call: see `repetition.run_trials`."""

    def __init__(self, axis, kind, gains, seed, condition, first):
        machine, noise = (condition.machine(axis), condition.noise) if condition else (axis, {})
        self.plant, self.controller = make_plant(machine, NoiseSpec(**noise)), make_controller(kind, axis, **gains)
        self.state = new_state(self.plant, seed, first, usual_start(self.plant))
        self.work, self.readings = new_work(self.plant), new_readings()
        self.limit = float(self.controller.parameters["voltage_limit"])

    def __call__(self, reference, added, anew):
        """(encoder [m], stage [m]) along the reference [m] with an added voltage [V]; the law starts anew or goes
        on."""
        if anew:
            self.controller.reset()
        trace, none = np.empty((len(reference), len(TRACE))), np.zeros(len(reference))
        run_loop(
            self.plant,
            self.state,
            self.work,
            self.readings,
            self.controller.parameters,
            self.controller.memory,
            reference,
            added,
            none,
            trace,
        )
        return trace[:, TRACE.index("encoder_m")], trace[:, TRACE.index("stage_m")]


def run_program(axis, kind, gains, seed, condition=None):
    """(error [m], first rows of the moves, control period [s]) of `PROGRAM`.

    As `runs.simulate` does it, without the columns that nobody asks for here.
    """
    period = float(axis.value("period"))
    reference, led, starts = _path(period, axis.value("sensors.encoder.resolution"))
    repeats = kind in repetition.KINDS
    own = {name: value for name, value in gains.items() if name not in repetition.BOUNDS}
    cell = _Cell(axis, repetition.BASE if repeats else kind, own, seed, condition, float(reference[0]))
    if repeats:
        return repetition.run_trials(kind, cell, reference, led, gains, period), starts, period
    _, stage = cell(reference, np.zeros(len(reference)), True)
    return (stage - reference)[led:], starts, period


def cost(axis, kind, gains, seeds=SEARCH_SEEDS):
    """Mean over the seeds of the cost of this module's docstring [1]."""
    found = []
    for seed in seeds:
        error, starts, period = run_program(axis, kind, gains, seed)
        sine = error[round(0.25 * SINE_ROWS / period) : round(SINE_ROWS / period)]
        parts = np.split(error, starts)[1:]
        moves = [math.log(_rms(part)) + math.log(1e-9 + abs(part[-1])) for part in parts]
        found.append(math.log(_rms(sine)) + float(np.mean(moves)))
    return float(np.mean(found))


def _rms(values):
    return float(np.sqrt(np.mean(np.square(values)))) + 1e-12


def bounds_of(axis, kind):
    """(names, [(low, high)]) of a search: logarithms of gains about the shipped ones, shares as they are."""
    if kind in repetition.KINDS:
        return tuple(repetition.BOUNDS), [(math.log(low), math.log(high)) for low, high in repetition.BOUNDS.values()]
    record = controller_parameters(kind, axis, {})
    bounds = []
    for name in OPPONENTS[kind]:
        if name in SHARES:
            bounds.append((0.0, SHARES[name]))
            continue
        part, gain = next(
            (part, gain) for part, entry in law(kind).parts.items() for gain in entry.gains if gain.name == name
        )
        value = math.log(float(record[part][name]))
        low, high = math.log(max(gain.minimum, 1e-12)), math.log(gain.maximum)
        bounds.append((max(value - math.log(REACH), low), min(value + math.log(REACH), high)))
    return OPPONENTS[kind], bounds


def searched(axis, kind, evaluations=2000, seed=0, base=None):
    """`Opponent` found by at least ``evaluations`` runs of `cost`, with the gains of ``base`` {name: value} as they
    are."""
    from scipy.optimize import differential_evolution  # half a second to load

    names, bounds = bounds_of(axis, kind)

    def gains_of(place):
        found = {name: float(x if name in SHARES else math.exp(x)) for name, x in zip(names, place)}
        return {**(base or {}), **found}

    population = 8 * len(names)
    found = differential_evolution(
        lambda place: cost(axis, kind, gains_of(place)),
        bounds,
        popsize=8,
        tol=0.0,
        polish=False,
        maxiter=max(math.ceil(evaluations / population) - 1, 1),
        rng=np.random.default_rng(seed),
    )
    return Opponent(kind, gains_of(found.x), float(found.fun), int(found.nfev))


def judged(axis, opponent, condition, seeds=JUDGED_SEEDS):
    """`Figures` of an opponent under a condition."""
    sine, moving, settled = [], [], []
    for seed in seeds:
        error, starts, period = run_program(axis, opponent.kind, opponent.gains, seed, condition)
        sine.append(np.abs(error[round(0.25 * SINE_ROWS / period) : round(SINE_ROWS / period)]).max())
        parts = np.split(error, starts)[1:]
        moving.append(max(np.abs(part).max() for part in parts))
        settled.append(max(abs(part[-1]) for part in parts))
    return Figures(float(max(sine)), float(max(moving)), float(max(settled)))


def budget(kind, evaluations):
    """Runs of `cost` for a law; what repeats gets an eighth, since each goes through the program `repetition.TRIALS`
    times."""
    return evaluations // 8 if kind in repetition.KINDS else evaluations


def contest(axis, evaluations=2000, seed=0, progress=lambda words: None, known=()):
    """(opponents [list of `Opponent`], {condition: {kind: `Figures`}}) of all laws.

    ``known`` : `Opponent` list of an earlier search, which are not searched again.
    """
    by_kind = {opponent.kind: opponent for opponent in known}
    for kind in (*OPPONENTS, *repetition.KINDS):
        progress(f"searching {kind}")
        if kind not in by_kind:
            base = by_kind[repetition.BASE].gains if kind in repetition.KINDS else None
            by_kind[kind] = searched(axis, kind, budget(kind, evaluations), seed, base)
    found = [by_kind[kind] for kind in (*OPPONENTS, *repetition.KINDS)]
    found += [Opponent(kind, {}, cost(axis, kind, {}), 0) for kind in NOT_SEARCHED]
    table = {}
    for condition in conditions(axis):
        if condition.name in JUDGED:
            progress(f"judging: {condition.name}")
            table[condition.name] = {opponent.kind: judged(axis, opponent, condition) for opponent in found}
    return found, table


def contest_tables(found, table, ours="self_tuning_observer"):
    """Two tables for a document, (title, heads, rows): gains that were found, and all laws under every condition."""
    gains = [
        [
            o.kind,
            str(o.evaluations) if o.evaluations else "shipped",
            f"{o.cost:.2f}",
            ", ".join(f"{name} {value:.3g}" for name, value in o.gains.items()) or "–",
        ]
        for o in found
    ]
    rows = []
    for name, by_law in table.items():
        cells = [f"{f.sine * 1e9:.0f}, {f.moving * 1e9:.0f}, {f.settled * 1e9:.0f}" for f in by_law.values()]
        best = [min(getattr(f, field) for kind, f in by_law.items() if kind != ours) for field in Figures._fields]
        lost = [field for field, least in zip(Figures._fields, best) if getattr(by_law[ours], field) > least]
        rows.append([name, *cells, ", ".join(lost) or "–"])
    heads = ["condition", *[o.kind for o in found], f"{ours} loses in"]
    remark = (
        f"Worst of {len(JUDGED_SEEDS)} seeds that no search saw: peak in the sine, largest error in a move, "
        "error at the end of a move's dwell. The searches had the nominal machine alone."
    )
    return [
        ("Opponents: what the searches found", ["law", "evaluations", "cost", "gains"], gains, ""),
        ("Opponents: sine, move, end of a move (nm), worst of the seeds", heads, rows, remark),
    ]
