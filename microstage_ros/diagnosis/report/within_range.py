"""What was fitted, held against what is physically possible, before it goes into an answer."""

import dataclasses

from microstage_ros.diagnosis.result import Diagnosis
from microstage_ros.model import schema
from microstage_ros.model.axis_file import Axis
from microstage_ros.model.effects import REGISTRY
from microstage_ros.quantities.errors import InputError


def within_range(diagnosis: Diagnosis, axis: Axis) -> Diagnosis:
    """The `Diagnosis` without causes, stand-ins and numbers whose fitted size lies outside its own physical range.

    A size that no such effect can have means that something else is at work: the cause is not named, a note says with
    which size it was fitted, and the verdict becomes ``partly_explained`` where other causes remain, else
    ``unexplained``.
    """
    notes = list(diagnosis.notes)
    causes = [cause for cause in diagnosis.causes if _possible(cause.id, cause.effect, notes)]
    provisional = {name: effect for name, effect in diagnosis.provisional.items() if _possible(name, effect, notes)}
    specs = schema.leaf_specs(axis.choices, axis.place)
    identified = {key: number for key, number in diagnosis.identified.items() if _in_spec(specs, key, number, notes)}
    if len(notes) == len(diagnosis.notes):
        return diagnosis
    verdict = diagnosis.verdict
    if len(causes) < len(diagnosis.causes) and verdict != "undetermined":
        verdict = "partly_explained" if causes else "unexplained"
    return dataclasses.replace(
        diagnosis,
        causes=tuple(causes),
        provisional=provisional,
        identified=identified,
        verdict=verdict,
        notes=tuple(notes),
    )


def _possible(name, effect, notes):
    """Whether an effect may have the sizes that were fitted; else a note says why not."""
    try:
        REGISTRY[name].check(effect or {}, name)
    except InputError as error:
        notes.append(
            f"{error.place} was fitted as {error.value!r}, outside of what is possible ({error.expected}): not named as"
            " a cause."
        )
        return False
    return True


def _in_spec(specs, key, number, notes):
    """Whether a number of the axis file may have the fitted value; else a note says why not."""
    try:
        specs[key].check(number.value, key)
    except InputError as error:
        notes.append(
            f"{error.place} was fitted as {error.value!r}, outside of what is possible ({error.expected}): left as"
            " given."
        )
        return False
    return True
