"""The paper's comparison of controllers (Fig. 10, Fig. 11, Table 4), on the simulated axis, over many seeds.

Everything is judged by the true position, which only a simulator knows, and beside it by the interferometer
that the paper has. A figure over seeds is the worst of them unless it says median.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from microstage_ros.control.evaluation.least_error import least_error
from microstage_ros.control.evaluation.limits import gap_limits, limits
from microstage_ros.control.evaluation.observer_trial import LEVEL_JUMPS, LEVEL_SINES, level_jump_trial, observer_trial
from microstage_ros.control.evaluation.reference_controllers import (
    STRESS_SINE,
    best_for_sine,
    fresh_seeds,
    stress_limits,
    weak_start,
)
from microstage_ros.control.runs.trials import cycle_peaks, gain_jump_trial, sine_trial, step_trial, trial
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import controller_margins
from microstage_ros.control.tuning.tuning import GUARDED
from microstage_ros.metrology.repeatability import repeatability

CONTROLLERS = (
    "pid", "pid_feedforward", "self_tuning", "self_tuning_feedforward", "self_tuning_observer", "nctf",
)
DISTANCES = (1e-6, 1e-5, 1e-4, 1e-3)  # m, Table 4
PAPER_4S = {1e-6: 173e-9, 1e-5: 160e-9, 1e-4: 219e-9, 1e-3: 255e-9}  # m, Table 4
PAPER_SINE = {"pid_feedforward": 500e-9, "self_tuning": 150e-9}  # m, section 5.4
TRACKING_SINE = (1e-5, 0.03)  # m, Hz: Fig. 10
SLOW_SINES = (0.25, 0.1, 0.03)  # Hz, of 10 um, from the start and after a move of `FAST_MOVE` there and back
FAST_MOVE = 1e-3  # m
SINES = tuple(  # m, Hz: 1 um ... 1 mm, 0.03 ... 1 Hz, up to 2 mm/s
    (a, f) for a in (1e-6, 1e-5, 1e-4, 1e-3) for f in (0.03, 0.1, 0.3, 1.0) if a * f < 5e-4
)
DOUBTS = (1.2e-3, 2.3e-3, 4.6e-3, 9.2e-3, 1.84e-2)  # V, in the voltage behind the observer law's back-EMF
GAIN_JUMPS = (0.4, 0.5, 0.7, 1.4, 2.0, 2.5)  # of the amplifier
STRESS: dict[str, dict] = {
    "nominal": {},
    "friction x 0.5": {"effects": {"friction_level_change": {"factor": 0.5}}},
    "friction x 2": {"effects": {"friction_level_change": {"factor": 2.0}}},
    "payload +200 %": {"effects": {"payload_change": {"mass_kg": 6.12}}},
    "drive stiffness x 0.33": {"effects": {"drive_compliance": {"stiffness_factor": 0.33}}},
    "resistance +20 %": {"effects": {"resistance_rise": {"initial": 0.2, "rise_per_joule": 0.0, "time_s": 1e5}}},
    "delay of 1 sample": {"effects": {"transport_delay": {"delay_s": 1e-4}}},
    "delay of 2 samples": {"effects": {"transport_delay": {"delay_s": 2e-4}}},
    "2 kHz": {"period_s": 5e-4},
    "1 kHz": {"period_s": 1e-3},
    "backlash 0.5 deg": {"effects": {"backlash": {"width_rad": 0.00873}}},
}


STRESS_CYCLES = 3.25  # of the sine: a first one, and what has been learned by the third


class Extent(NamedTuple):
    """How much of the comparison is run."""

    seeds: int = 20
    moves: int = 10
    searches: int = 40  # candidates of every search for the best fixed PID
    sines: tuple = SINES
    stress_searches: int = 120  # candidates of the searches under stress, and for the moves from a tenth of the gains


QUICK = Extent(3, 5, 8, ((1e-6, 1.0), (1e-5, 0.3), (1e-4, 1.0)), 4)


class Evaluation:
    """The axis, the threads and the progress of one comparison."""

    def __init__(self, axis, extent, jobs=1, progress=None, elsewhere=None):
        self.axis, self.extent, self.jobs, self.elsewhere = axis, extent, jobs, elsewhere
        self.progress = progress or (lambda text: None)

    def __getstate__(self):
        """What other computers need of it: neither the progress nor themselves."""
        return {"axis": self.axis, "extent": self.extent, "jobs": 1, "elsewhere": None, "progress": None}

    def each(self, function, items):
        """``function`` of every item, on ``jobs`` threads (the loops release the interpreter) or, with ``elsewhere``,
        on other computers, in order."""
        if self.elsewhere:
            return self.elsewhere(function, items)
        with ThreadPoolExecutor(self.jobs) as pool:
            return list(pool.map(function, items))


def compare(axis, extent=Extent(), controllers=CONTROLLERS, jobs=1, progress=None, elsewhere=None):
    """Run the whole comparison on ``jobs`` [1] threads. Returns plain data in SI, with curves of Figs. 10 and 11."""
    evaluation = Evaluation(axis, extent, jobs, progress, elsewhere)
    result = {"controllers": list(controllers), "seeds": extent.seeds, "moves": extent.moves}
    result["tracking"] = tracking(evaluation, controllers)
    result["slow_sines"] = slow_sines(evaluation)
    result["positioning"] = positioning(evaluation, controllers)
    result["rest"] = rest(evaluation, controllers)
    result["sines"] = sines(evaluation)
    result["stress"] = stress(evaluation, controllers)
    result["gain_jumps"] = gain_jumps(evaluation, controllers)
    result["trade_off"] = trade_off(evaluation)
    result["informed"] = limits(evaluation)
    result["told_gap"] = gap_limits(evaluation)
    result["weak_start"] = weak_start(evaluation)
    result["observer"] = observation(evaluation)
    result["level_jumps"] = level_jumps(evaluation)
    result["margins"] = {kind: _margins(axis, kind) for kind in controllers}
    return result


def tracking(evaluation, controllers):
    """Fig. 10: sine of 10 um at 0.03 Hz. Per controller: worst and median peak, rms, one curve."""
    found = {}
    for kind in controllers:
        evaluation.progress(f"sine, {kind}")
        trials = evaluation.each(
            lambda seed: sine_trial(evaluation.axis, kind, {}, *TRACKING_SINE, seed), range(evaluation.extent.seeds)
        )
        peaks = np.array([t.peak for t in trials])
        columns = trials[0].columns
        found[kind] = {
            "worst": float(peaks.max()),
            "median": float(np.median(peaks)),
            "rms": float(np.mean([t.rms for t in trials])),
            "curve": {
                "t": columns["t_s"],
                "error": columns["stage_m"] - columns["reference_m"],
                "reference": columns["reference_m"],
            },
        }
    return found


def slow_sines(evaluation, frequencies=SLOW_SINES):
    """Observer law: peak [m] of slow sines from the start, and once a fast move has told the encoder's interpolation.

    ``frequencies`` [Hz]. Rows {frequency, after, median, worst}; ``after``: whether a move came before.
    """
    evaluation.progress("slow sines after a fast move")
    fast = [{"move_to_m": place, "dwell_s": 0.2} for place in (FAST_MOVE, 0.0)]

    def one(job):
        frequency, after, seed = job
        sine = [{"sine": {"amplitude_m": TRACKING_SINE[0], "frequency_hz": frequency, "cycles": 1.0}}]
        columns = trial(evaluation.axis, "self_tuning_observer", {}, [*(fast if after else ()), *sine], seed)
        rows = round(0.75 / frequency / columns["t_s"][1])  # without the first quarter
        return float(np.abs(columns["stage_m"] - columns["reference_m"])[-rows:].max())

    found = []
    for frequency in frequencies:
        for after in (False, True):
            peaks = evaluation.each(one, [(frequency, after, seed) for seed in range(evaluation.extent.seeds)])
            found.append({"frequency": frequency, "after": after, "median": float(np.median(peaks)),
                          "worst": max(peaks)})
    return found


def positioning(evaluation, controllers):
    """Table 4 and Fig. 11: repeated moves over each distance. Per controller and distance: figures and a curve."""
    found = {}
    for kind in controllers:
        found[kind] = {}
        for distance in DISTANCES:
            evaluation.progress(f"moves of {distance * 1e6:g} um, {kind}")
            trials = evaluation.each(
                lambda seed: step_trial(evaluation.axis, kind, {}, distance, seed, evaluation.extent.moves),
                range(evaluation.extent.seeds),
            )
            found[kind][distance] = positioning_figures(trials, distance)
    return found


def positioning_figures(trials, distance):
    """Figures of a list of `StepTrial`s: worst seed by 4s and bias, pooled intervals, settling, overshoot, rest.

    In SI; ``distance`` of the moves [m].
    """
    per_seed = [repeatability(t.errors) for t in trials]
    by_instrument = [repeatability(t.interferometer) for t in trials]
    pooled = repeatability(np.concatenate([t.errors for t in trials]))
    settling = np.concatenate([t.settling for t in trials])
    columns = trials[0].columns
    first = len(columns["t_s"]) // (2 * len(trials[0].errors))
    return {
        "four_s_worst": max(r.four_s for r in per_seed),
        "four_s_pooled": pooled.four_s,
        "four_s_interval": pooled.four_s_interval,
        "bias_worst": max((r.bias for r in per_seed), key=abs),
        "bias_pooled": pooled.bias,
        "bias_interval": pooled.bias_interval,
        "instrument_four_s_worst": max(r.four_s for r in by_instrument),
        "settling_median": float(np.median(np.nan_to_num(settling, nan=np.inf))),
        "settling_worst": float(np.nan_to_num(settling, nan=np.inf).max()),
        "never_settled": int(np.isnan(settling).sum()),
        "overshoot_worst": float(max(t.overshoot.max() for t in trials)),
        "rest_worst": float(max(t.rest.max() for t in trials)),
        "distance": distance,
        "curve": {
            "t": columns["t_s"][:first],
            "stage": columns["stage_m"][:first],
            "reference": columns["reference_m"][:first],
        },
    }


def rest(evaluation, controllers):
    """Ten seconds at rest after a move of 10 um: largest peak-to-peak of the true position [m] over seeds."""
    program = [{"move_to_m": 1e-5, "dwell_s": 11.0}]

    def held(kind, seed):
        stage = trial(evaluation.axis, kind, {}, program, seed)["stage_m"]
        return float(np.ptp(stage[len(stage) - 100_000 :]))

    found = {}
    for kind in controllers:
        evaluation.progress(f"rest, {kind}")
        found[kind] = max(evaluation.each(lambda seed: held(kind, seed), range(min(evaluation.extent.seeds, 5))))
    return found


def sines(evaluation, kinds=("pid", "self_tuning", "self_tuning_feedforward", "self_tuning_observer")):
    """Sines of many sizes: worst peak [m] of each law, and of the best fixed PID searched for that very sine."""
    def one(sine):
        axis, seeds, (size, frequency) = evaluation.axis, fresh_seeds(evaluation), sine
        worst = {kind: max(sine_trial(axis, kind, {}, size, frequency, seed).peak for seed in seeds) for kind in kinds}
        gains, worst["best_pid"] = best_for_sine(axis, seeds, size, frequency, evaluation.extent.searches)
        return {"amplitude": size, "frequency": frequency, "gains": gains, "peak": worst}

    evaluation.progress("best fixed PID for every sine")
    return evaluation.each(one, evaluation.extent.sines)


def stress(evaluation, controllers):
    """Every controller under every condition: sine (10 um, 0.1 Hz) and 10 um moves, from the fourth on.

    ``peak``, ``learned_peak`` [m]: worst of the sine's first full cycle, and of its third. Beside them `stress_limits`.
    """

    def one(job):
        kind, name = job
        conditions, seeds = STRESS[name], range(evaluation.extent.seeds)
        size, frequency = STRESS_SINE
        peaks = [
            cycle_peaks(
                sine_trial(evaluation.axis, kind, {}, size, frequency, seed, STRESS_CYCLES, **conditions), frequency
            )
            for seed in seeds
        ]
        peak, learned_peak = max(p[0] for p in peaks), max(p[-1] for p in peaks)
        trials = [step_trial(evaluation.axis, kind, {}, 1e-5, seed, 8, **conditions) for seed in seeds]
        learned = [
            t._replace(errors=t.errors[3:], interferometer=t.interferometer[3:], settling=t.settling[3:])
            for t in trials
        ]
        figures = positioning_figures(learned, 1e-5)
        return {
            "peak": peak,
            "learned_peak": learned_peak,
            **{key: figures[key] for key in ("four_s_worst", "bias_worst", "settling_median", "rest_worst")},
        }

    evaluation.progress("stress set")
    jobs = [(kind, name) for kind in controllers for name in STRESS]
    found = {name: {} for name in STRESS}
    for (kind, name), figures in zip(jobs, evaluation.each(one, jobs)):
        found[name][kind] = figures
    for name, conditions in STRESS.items():
        if set(conditions) <= {"period_s"}:
            period = conditions.get("period_s", evaluation.axis.value("period"))
            found[name]["least"] = {"peak": least_error(evaluation.axis, period, evaluation.extent.seeds)[1]}
    for name, found_limits in stress_limits(evaluation, STRESS).items():
        found[name] |= {yardstick: {"peak": peak} for yardstick, peak in found_limits.items()}
    return found


def gain_jumps(evaluation, controllers):
    """The amplifier's gain jumps during a sine (10 um, 0.1 Hz): {controller: [{factor, start, after, end}]}, m.

    ``start``: peak if the gain is wrong from the start; ``after``, ``end``: peak after a jump, and once it is over.
    """
    def one(job):
        kind, factor = job
        seeds = range(evaluation.extent.seeds)
        wrong = {"effects": {"amplifier_gain": {"factor": factor}}}
        start = max(sine_trial(evaluation.axis, kind, {}, 1e-5, 0.1, seed, **wrong).peak for seed in seeds)
        jumps = [gain_jump_trial(evaluation.axis, kind, factor, seed) for seed in seeds]
        return {"factor": factor, "start": start, "after": max(j[0] for j in jumps), "end": max(j[1] for j in jumps)}

    evaluation.progress("gain of the amplifier")
    jobs = [(kind, factor) for kind in controllers for factor in GAIN_JUMPS]
    found = {kind: [] for kind in controllers}
    for (kind, _), figures in zip(jobs, evaluation.each(one, jobs)):
        found[kind].append(figures)
    return found


def trade_off(evaluation):
    """What margin at the amplifier costs the observer law: the less it trusts the back-EMF, the larger the margin.

    Per doubt in the voltage: smallest gain margin [dB] and phase margin [deg] in pre-sliding and at full speed, and
    the worst peak [m] of a sine of 10 um at 0.1 Hz under each condition.
    """
    names = [
        name
        for name in ("nominal", "friction x 0.5", "friction x 2", "payload +200 %", "drive stiffness x 0.33")
        if name in STRESS
    ]

    def one(job):
        gains, name = {"voltage_noise": job[0]}, job[1]
        seeds = range(evaluation.extent.seeds)
        return max(
            sine_trial(evaluation.axis, "self_tuning_observer", gains, 1e-5, 0.1, k, **STRESS[name]).peak for k in seeds
        )

    evaluation.progress("margin against robustness")
    jobs = [(doubt, name) for doubt in DOUBTS for name in names]
    peaks = dict(zip(jobs, evaluation.each(one, jobs)))
    found = []
    for doubt in DOUBTS:
        parameters = controller_parameters("self_tuning_observer", evaluation.axis, {"voltage_noise": doubt})
        guarded = [m for m in controller_margins(evaluation.axis, parameters) if m.regime in GUARDED]
        found.append(
            {
                "doubt": doubt,
                "gain_db": min(m.gain_db for m in guarded),
                "phase_deg": min(m.phase_deg for m in guarded),
                "peak": {name: peaks[doubt, name] for name in names},
            }
        )
    return found


def observation(evaluation):
    """Errors of the friction observer (see `observer_trial`): worst over seeds, per motion."""
    evaluation.progress("observer")
    found = {}
    for motion in ("sine 10 um", "sine 1 mm", "moves 1 um", "moves 10 um", "moves 1 mm"):
        seeds = range(min(evaluation.extent.seeds, 5))
        trials = evaluation.each(lambda seed: observer_trial(evaluation.axis, motion, seed), seeds)
        found[motion] = {key: max(t[key] for t in trials) for key in trials[0]}
    return found


def level_jumps(evaluation):
    """How soon and how well the observer sees the level jump (see `level_jump_trial`): worst over seeds, per sine and
    jump."""
    evaluation.progress("jumps of the level")
    jobs = [(*sine, factor) for sine in LEVEL_SINES for factor in LEVEL_JUMPS]
    found = []
    for job in jobs:
        seeds = range(evaluation.extent.seeds)
        trials = evaluation.each(lambda seed: level_jump_trial(evaluation.axis, *job, seed), seeds)
        worst = {key: max(t[key] for t in trials) for key in trials[0]}
        found.append(dict(zip(("amplitude", "frequency", "factor"), job)) | worst)
    return found


def _margins(axis, kind):
    margins = controller_margins(axis, controller_parameters(kind, axis, {}))
    return None if margins is None else [m._asdict() for m in margins]
