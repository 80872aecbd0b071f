"""Trials: the two experiments of the paper's sections 5.4 and 6, simulated, and what is read off them.

``gains``: {name: number in the unit of its `control.gains.Gain`}. Seeds are integers [1]; a sine has an ``amplitude``
[m], a ``frequency`` [Hz] and ``cycles`` [1].
"""

from typing import NamedTuple

import numpy as np

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.runs.closed_loop import TRACE, run_loop
from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.control.trajectories.profiles import sine
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work, usual_start

COUNT = 25e-9  # m, one count: what settled means


class SineTrial(NamedTuple):
    """Tracking of a sine, without its first quarter of a cycle."""

    peak: float  # m, largest |true position - reference|
    rms: float  # m
    columns: dict


class StepTrial(NamedTuple):
    """Repeated moves over one distance and back; one figure per forward move.

    True position and interferometer are read once, at the end of the dwell.
    """

    errors: np.ndarray  # m, true position - target
    interferometer: np.ndarray  # m
    settling: np.ndarray  # s, from the start of the move until within one count for good; NaN: never
    overshoot: np.ndarray  # m, beyond the target
    rest: np.ndarray  # m, peak to peak of the true position over the last 100 ms
    columns: dict


def trial(axis, kind, gains, program, seed, **conditions):
    """Columns of a run {name: (rows,)}; ``seed`` [1]; ``conditions``: noise, effects, period_s of a `Run`."""
    return simulate(axis, Run(controller={"type": kind, **gains}, program=program, **conditions), seed)


def sine_trial(axis, kind, gains, amplitude, frequency, seed, cycles=1.25, **conditions):
    """`SineTrial` of a sine of ``amplitude`` [m] at ``frequency`` [Hz]; ``cycles`` and ``seed`` [1]."""
    program = [{"sine": {"amplitude_m": amplitude, "frequency_hz": frequency, "cycles": cycles}}]
    columns = trial(axis, kind, gains, program, seed, **conditions)
    error = (columns["stage_m"] - columns["reference_m"])[int(0.25 / cycles * len(columns["t_s"])) :]
    return SineTrial(float(np.abs(error).max()), float(np.sqrt(np.mean(error**2))), columns)


def cycle_peaks(trial, frequency):
    """Largest |true position - reference| [m] in each full cycle of a `SineTrial` after its first quarter, shape
    (n,)."""
    columns = trial.columns
    rows = round(1.0 / frequency / columns["t_s"][1])
    error = np.abs(columns["stage_m"] - columns["reference_m"])[rows // 4 :]
    return error[: len(error) // rows * rows].reshape(-1, rows).max(axis=1)


def step_trial(axis, kind, gains, distance, seed, moves=10, dwell=0.4, **conditions):
    """`StepTrial` of ``moves`` [1] from 0 to ``distance`` [m] and back, each with a ``dwell`` [s]; ``seed`` [1]."""
    program = [{"move_to_m": place, "dwell_s": dwell} for _ in range(moves) for place in (distance, 0.0)]
    columns = trial(axis, kind, gains, program, seed, **conditions)
    rows = len(columns["t_s"]) // (2 * moves)
    period = columns["t_s"][1]
    parts = [slice(2 * k * rows, (2 * k + 1) * rows) for k in range(moves)]
    last = min(round(0.1 / period), rows)
    figures = [_figures(columns, part, distance, period, last) for part in parts]
    errors, interferometer, settling, overshoot, rest = map(np.array, zip(*figures))
    return StepTrial(errors, interferometer, settling, overshoot, rest, columns)


def _figures(columns, part, distance, period, last):
    stage = columns["stage_m"][part] - distance
    outside = np.flatnonzero(np.abs(stage) > COUNT)
    settled = (outside[-1] + 1) * period if len(outside) else 0.0
    if len(outside) and outside[-1] == len(stage) - 1:
        settled = np.nan
    interferometer = columns["interferometer_m"][part][-1] - distance
    return stage[-1], interferometer, settled, max(stage.max(), 0.0), np.ptp(stage[-last:])


def gain_jump_trial(axis, kind, factor, seed, amplitude=1e-5, frequency=0.1, at=4.0):
    """The amplifier's gain becomes ``factor`` times what it was, ``at`` [s] into 1.25 cycles of a sine; ``seed`` [1].

    Returns (largest |true position - reference| after the jump, the same over the last fifth) [m].
    """
    def jump(plant):
        plant["gain"] *= factor

    period = axis.value("period")
    reference = sine(0.0, amplitude, frequency, 1.25, period)
    trace = jump_trace(axis, kind, seed, reference, round(at / period), jump)
    error = np.abs(trace[:, TRACE.index("stage_m")] - reference)
    return float(error[round(at / period) :].max()), float(error[-len(error) // 5 :].max())


def jump_trace(axis, kind, seed, reference, row, jump):
    """Trace (rows, len(TRACE)) of a run along ``reference`` [m] on an axis that ``jump(plant)`` changes before
    ``row`` [1]; ``seed`` [1]."""
    plant, readings = make_plant(axis.machine or axis, NoiseSpec()), new_readings()
    state, work, controller = (
        new_state(plant, seed=seed, friction=usual_start(plant)),
        new_work(plant),
        make_controller(kind, axis),
    )
    trace = np.empty((len(reference), len(TRACE)))
    for part in (slice(0, row), slice(row, None)):
        none = np.zeros_like(reference[part])
        run_loop(
            plant,
            state,
            work,
            readings,
            controller.parameters,
            controller.memory,
            reference[part],
            none,
            none,
            trace[part],
        )
        jump(plant)
    return trace
