"""The diagnosis of an axis by re-simulation, from records to the answer: its command is a force at the stage, or a
position."""

import math
import pathlib

import numpy as np

from microstage_ros.diagnosis.report.experiment import WHY, condition_of, separating_run
from microstage_ros.diagnosis.resimulation import pictures
from microstage_ros.diagnosis.resimulation.candidates import candidates, joint_candidates, own_candidates
from microstage_ros.diagnosis.resimulation.closed_loop import ClosedLoop, measured, turning_effects
from microstage_ros.diagnosis.resimulation.fit import BLOCK_S, Model, fit
from microstage_ros.diagnosis.resimulation.folds import (
    HELD_BACK,
    bootstrap_interval,
    make_folds,
    mean_square,
    repetition,
)
from microstage_ros.diagnosis.resimulation.noise import noise_of
from microstage_ros.diagnosis.resimulation.selection import Selector
from microstage_ros.diagnosis.result import Cause, Diagnosis, Improvement, OverallImprovement, Parameter, Rivals
from microstage_ros.diagnosis.stored_calibration import stored_calibration
from microstage_ros.model.actuators import actuator_of
from microstage_ros.quantities.errors import InputError

OPEN = 0.1                     # share of a cause with rivals from which the whole verdict is open
CALIBRATION = pathlib.Path(__file__).with_name("calibration.yaml")     # written by `resimulation.examination`
METRIC = "measured minus simulated {} in closed loop, rms on time not fitted on"


def diagnose_force_axis(axis, records, holdout=(), baseline=(), seed=0, progress=None, jobs=1):
    """Find what a force-driven axis file lacks.

    Parameters
    ----------
    axis : `Axis` whose command is a force at the stage, or sets a position, with the controller that was in the loop.
    records, holdout, baseline : lists of `Record`. Without ``holdout`` some of every record's time is
        held back (see `folds`). ``baseline`` (the axis while the model was right) re-identifies the axis's own numbers
        first.
    seed : of thresholds and intervals [1].
    progress : function (text), or None. jobs : threads that re-simulate [1].

    Returns
    -------
    `Diagnosis`. Raises InputError for records that do not fit the axis file.
    """
    if not records:
        raise InputError("records", 0, "at least one record")
    healthy = 0.0
    parts = [measured(record, axis) for record in (*records, *holdout)]
    if baseline:
        axis, healthy = _on_baseline(axis, baseline)
    folds = make_folds(parts, [False] * len(records) + [True] * len(holdout))
    loop = ClosedLoop(parts, jobs)
    loop.home(axis, every=True)
    noise = noise_of(axis, loop, folds, healthy)
    selector = Selector(loop, folds, axis.value("period"), noise, progress)
    learnt = parts[: len(records)]
    selection = selector.select(Model.of(axis), own_candidates(axis), candidates(axis, learnt), joint_candidates(axis))
    return _answer(axis, parts, folds, loop, selection, noise, records, holdout, seed)


def _on_baseline(axis, baseline):
    """The axis with its own numbers fitted to records of it while nothing was wrong, and what is left there [N]."""
    loop = ClosedLoop([measured(record, axis) for record in baseline])
    model, residual = fit(loop, Model.of(axis), loop.tells)
    return model.extended, float(np.sqrt(np.mean(residual[loop.tells] ** 2)))


def _answer(axis, parts, folds, loop, selection, noise, records, holdout, seed):
    period, last = axis.value("period"), selection.final
    _, unit, quantity = actuator_of(axis).judged(axis)
    before, after = (math.sqrt(mean_square(stage.residual, folds.held)) for stage in (selection.given, last))
    alone = {name: math.sqrt(mean_square(stage.residual, folds.held)) for name, stage in selection.without.items()}
    errors = selection.errors
    causes, rivals, provisional, open_share = [], [], {}, 0.0
    for position, cause in enumerate(last.model.chosen):
        found = _cause(cause, _errors_of(last.model, errors, position), selection.shares[cause.candidate.id],
                       Improvement(alone[cause.candidate.id], after, unit), quantity)
        alike = selection.rivals.get(found.id, [])
        if alike:
            ids = (found.id, *alike)
            rivals.append(Rivals(ids, _why(ids, found), separating_run(ids, axis)))
            provisional[found.id] = found.effect
            open_share = max(open_share, found.share)
        else:
            causes.append(found)
    causes.sort(key=lambda cause: -cause.share)
    own = np.flatnonzero(folds.held)
    coordinates = pictures.coordinates(parts, axis, own)
    found = pictures.findings(coordinates, selection.given.residual[own], last.residual[own], seed, quantity)
    block = max(int(BLOCK_S / period), 1)
    gain = OverallImprovement(
        METRIC.format(quantity),
        unit,
        _held_names(records, holdout, parts),
        before,
        after,
        noise.floor,
        bootstrap_interval(last.residual[own], block, seed),
    )
    names = [cause.candidate.id for cause in last.model.chosen]
    stays = after if holdout or names else min(after, math.sqrt(last.time))
    return Diagnosis(
        _verdict(causes, rivals, open_share, stays, noise.limit),
        tuple(causes),
        tuple(rivals),
        gain,
        found,
        pictures.pictures(
            coordinates, selection.given.residual[own], last.residual[own], names, folds.period_rows, (quantity, unit)
        ),
        _notes(selection, folds, loop, before, after, own),
        seed,
        _identified(last.model, errors),
        provisional,
        turning_effects(last.model.extended),
    )


def _errors_of(model, errors, position):
    first = len(model.keys) + sum(len(cause.values) for cause in model.chosen[:position])
    return errors[first: first + len(model.chosen[position].values)]


def _cause(chosen, errors, share, gain, channel):
    """`Cause` of one chosen candidate; how sure it is: calibrated by its surest size, z, and its ``share`` [1]."""
    candidate = chosen.candidate
    parameters = {fitted.name: Parameter(float(value), float(error), fitted.unit)
                  for fitted, value, error in zip(candidate.fitted, chosen.values, errors)}
    z = max(abs(value) / max(error, 1e-300) for value, error in zip(chosen.values, errors[: len(candidate.sizes)]))
    probability = stored_calibration(CALIBRATION).probability(z * z, share)
    return Cause(candidate.id, parameters, chosen.effect, probability, share, gain, channel,
                 candidate.sentence(chosen.values), evidence=z * z, clarity=share)


def _why(ids, found):
    return (f"{found.sentence[:-1]}, or what looks the same here: these records do not separate {', '.join(ids)}; "
            + WHY[condition_of(ids)])


def _verdict(causes, rivals, open_share, after, limit):
    """One of `diagnosis.VERDICTS`.

    ``limit``: rms up to which there is nothing to explain (`Noise`). Without a cause ``after`` is what the axis's own
    numbers leave when they are fitted again: a file's numbers may be a little off (`selection.OWN_CHANGE`), and
    friction has another level on another day. Of one record both kinds of time have to show it, what was learned from
    and what was held back.
    """
    if not causes and not rivals:
        return "unexplained" if after > limit else "agrees"
    if rivals and (open_share >= OPEN or not causes):
        return "undetermined"
    return "explained" if after <= limit else "partly_explained"


def _held_names(records, holdout, parts):
    if holdout:
        return tuple(str(record.source) for record in holdout)
    return tuple(
        f"{record.source} (" + (f"t ≥ {(1 - HELD_BACK) * len(part) * record.period_s:.4g} s"
                                if repetition(part.reference) else "every third tenth of its time")
        + ", held back by the program)" for record, part in zip(records, parts)
    )


def _identified(model, errors):
    unit = {key: model.axis.quantity(key).unit for key in model.keys}
    return {
        key: Parameter(float(value), float(error), unit[key])
        for key, value, error in zip(model.keys, model.own, errors)
    }


def _notes(selection, folds, loop, before, after, held):
    axis = selection.given.model.axis
    _, unit, quantity = actuator_of(axis).judged(axis)
    own = math.sqrt(mean_square(selection.own.residual, folds.held))
    notes = [
        f"Fitting the axis file's own numbers again, without any cause, gives {own:.3g} {unit} ({before:.3g} {unit} as"
        " given)."
    ]
    if actuator_of(axis).holds_position:
        notes = [
            f"The command sets the position; the model in closed loop asks for another {quantity} by {before:.3g}"
            f" {unit} as given."
        ]
    if folds.motion:
        notes.append("The motion repeats itself: causes were also tested on parts of the motion left out in every "
                     "repetition, and the noise floor is what differs between repetitions.")
    positions = [loop.position[held] - loop.simulate(model.extended)[1][held]
                 for model in (selection.given.model, selection.final.model)]
    rms = [1e6 * float(np.sqrt(np.mean(p**2))) for p in positions]
    notes.append(
        f"Position in closed loop: predicted to {rms[0]:.3g} µm rms with the axis file, {rms[1]:.3g} µm with the"
        " causes."
    )
    names = turning_effects(selection.final.model.extended)
    if names:
        pitch = selection.final.model.axis.value("transmission.pitch")
        places = ", ".join(f"{360.0 * shift / pitch:.0f}°" for shift in loop.shifts)
        notes.append(
            f"The phase of {' and '.join(names)} belongs to one homing of the machine and is found anew in each record "
            f"(turn of the screw against the extended axis, record by record: {places})."
        )
    if after > before:
        notes.append("On held-out time the causes do not help: the records to learn from are not like those held out.")
    return tuple(notes)
