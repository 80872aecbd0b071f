"""What the laws are measured against: fixed PIDs found by search, and what the sensors themselves allow.

A searched PID knows the sine, the moves or the stress it will meet, which no law does, and with no regard to
margins it may be one that nobody would ship; where margins are asked for, they are those of `tuning`.
Searches and judgement use different friction seeds.

``gains``: {name: number in the unit of its `control.gains.Gain`}. ``seed``, ``seeds`` (k,), ``evaluations`` and
``moves`` are counts [1]; a sine has an ``amplitude`` [m] and a ``frequency`` [Hz].
"""

import numpy as np

from microstage_ros.control.runs.trials import sine_trial, step_trial
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import pid_margins
from microstage_ros.control.tuning.tuning import SEARCHED, allowed_overshoot, guarded, search
from microstage_ros.metrology.repeatability import repeatability

SEARCH_SEEDS, MOVE_SEARCH_SEEDS, FIRST_FRESH_SEED = (0, 1), (200, 201, 202), 100
SHARES = {"pid": (), "pid_feedforward": ("friction_share",)}  # searched beside the gains
MOST_SHARE = 1.5  # of the modelled friction
PERFECT = {"encoder_m": 0.0, "voltage_V": 0.0}  # noise of an axis whose position and voltage are known
PERFECT_STEP = 1e-12  # m, its encoder's resolution
MOST_FOUR_S, MOST_REST = 25e-9, 50e-9  # m, asked of moves, and of the axis at rest (peak to peak)
STRESS_SINE = (1e-5, 0.1)  # m, Hz


def shipped_gains_of(axis, kind="pid"):
    """Gains of a shipped fixed PID, the ones a search starts from."""
    parameters = controller_parameters(kind, axis, {})
    names = (*SEARCHED, "derivative_on_reference")
    gains = {name: float(parameters["pid"][name]) for name in names}
    return gains | {name: float(parameters["feedforward"][name]) for name in SHARES[kind]}


def fresh_seeds(evaluation):
    """Seeds that no search has seen, as many as the comparison judges."""
    return range(FIRST_FRESH_SEED, FIRST_FRESH_SEED + evaluation.extent.seeds)


def best_for_sine(axis, seeds, amplitude, frequency, evaluations, kind="pid", **conditions):
    """The fixed law that tracks one sine best: (gains, worst peak [m] over the fresh ``seeds``)."""
    def peak(gains, seeds):
        return max(sine_trial(axis, kind, gains, amplitude, frequency, k, **conditions).peak for k in seeds)

    gains, _ = search(
        lambda gains: peak(gains, SEARCH_SEEDS), shipped_gains_of(axis, kind), evaluations,
        accept=lambda gains: gains.get("friction_share", 0.0) <= MOST_SHARE, names=SEARCHED + SHARES[kind],
    )
    return gains, peak(gains, seeds)


def stress_limits(evaluation, stress):
    """What can be had under each condition of ``stress``: {condition: {yardstick: worst peak [m] of the sine}}.

    `best_pid`, `best_pid_feedforward`: searched under that very condition, encoder as it is.
    `perfect_pid`: searched with an encoder and an amplifier without noise or rounding: what mechanics and rate leave.
    `perfect_observer`: the observer law with these sensors.
    """
    perfect = evaluation.axis.with_values({"sensors.encoder.resolution": PERFECT_STEP}, source="derived")

    seeds = fresh_seeds(evaluation)

    def one(job):
        name, yardstick = job
        if yardstick == "perfect_observer":
            trials = (
                sine_trial(perfect, "self_tuning_observer", {}, *STRESS_SINE, k, noise=PERFECT, **stress[name])
                for k in seeds
            )
            return max(trial.peak for trial in trials)
        axis, noise = (perfect, PERFECT) if yardstick == "perfect_pid" else (evaluation.axis, {})
        kind = "pid_feedforward" if yardstick == "best_pid_feedforward" else "pid"
        return best_for_sine(
            axis, seeds, *STRESS_SINE, evaluation.extent.stress_searches, kind, noise=noise, **stress[name]
        )[1]

    evaluation.progress("limits under stress")
    jobs = [
        (name, yardstick)
        for name in stress
        for yardstick in ("best_pid", "best_pid_feedforward", "perfect_pid", "perfect_observer")
    ]
    found = {name: {} for name in stress}
    for (name, yardstick), peak in zip(jobs, evaluation.each(one, jobs)):
        found[name][yardstick] = peak
    return found


def weak_start(evaluation, kinds=("self_tuning", "self_tuning_feedforward", "self_tuning_observer")):
    """From a tenth of the gains: error [m] of moves 1 ... 5 of 10 um against fixed PIDs.

    Figure of a move: rms of the true position's error from the move's start to its end, median over seeds. Beside
    the laws: `pid`, shipped; `best_pid`, searched for these moves alone; `kept_pid`, the best of those that
    `keeps_figures`; `guarded_pid`, the best of those with the margins that `tune` asks for.
    """
    evaluation.progress("tenth of the gains")

    def rms_by_move(kind, gains):
        seeds = range(evaluation.extent.seeds)
        errors = evaluation.each(lambda seed: move_errors(evaluation.axis, kind, gains, seed, 5), seeds)
        return np.median(errors, axis=0).tolist()

    def searched(rule):
        return search(
            lambda gains: max(move_errors(evaluation.axis, "pid", gains, seed, 2)[-1] for seed in MOVE_SEARCH_SEEDS),
            shipped_gains_of(evaluation.axis),
            evaluation.extent.stress_searches,
            accept=rule and (lambda gains: rule(evaluation.axis, gains)),
        )[0]

    found = {kind: rms_by_move(kind, {"start": 0.1}) for kind in kinds}
    found["pid"] = rms_by_move("pid", {})
    rules = {"best_pid": None, "kept_pid": keeps_figures, "guarded_pid": keeps_margins}
    for name, gains in zip(rules, evaluation.each(searched, rules.values())):
        found[name] = rms_by_move("pid", gains)
    return found


def keeps_margins(axis, gains):
    """Whether a fixed PID has the margins that `tune` asks for."""
    return guarded(pid_margins(axis, gains))


def keeps_figures(axis, gains):
    """Whether moves of 1 and 10 um under a fixed PID keep what is asked of every law: 4s, overshoot, and calm at
    rest."""
    for distance in (1e-6, 1e-5):
        for seed in MOVE_SEARCH_SEEDS:
            trial = step_trial(axis, "pid", gains, distance, seed, 5)
            if repeatability(trial.errors).four_s > MOST_FOUR_S or trial.overshoot.max() > allowed_overshoot(distance):
                return False
            if trial.rest.max() > MOST_REST:
                return False
    return True


def move_errors(axis, kind, gains, seed, moves):
    """Rms error [m] of the true position in each forward move of 10 um, dwell included, shape (moves,)."""
    columns = step_trial(axis, kind, gains, 1e-5, seed, moves).columns
    error = (columns["stage_m"] - columns["reference_m"]).reshape(2 * moves, -1)[::2]
    return np.sqrt(np.mean(error**2, axis=1))
