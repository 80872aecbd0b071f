"""Only sensors that all compared records have: what another sensor reads has another noise, and is no baseline."""

import dataclasses

import numpy as np

# of the columns that a record may lack, those that make a channel of their own
OPTIONAL = ("interferometer_m", "current_A")
# derived: samples between two readings are bridged in a straight line (`preparation`)
LEAST_SHARE = 0.5


def in_common(*groups):
    """The records with those of the optional sensors that every one of them has.

    Parameters
    ----------
    groups : lists of `Record` that are compared: to learn from, to judge on, the baseline; any may be empty.

    Returns
    -------
    (groups, notes): the same lists, a record copied where it loses a column; a sentence for each sensor that is not
    used although a record has it. A sensor that reads in less than `LEAST_SHARE` of a record's rows counts as lacking:
    an interferometer that was logged at every tenth period follows no resonance.
    """
    notes, unused = [], set()
    for name in OPTIONAL:
        shares = [(record.source, _share(record, name)) for group in groups for record in group]
        without = [(source, share) for source, share in shares if share < LEAST_SHARE]
        if without and any(share > 0.0 for _, share in shares):
            unused.add(name)
            source, few = without[0]
            notes.append(f"{name} is not used: {source} has it in {few:.0%} of its rows"
                         + (f", and so {len(without) - 1} more." if len(without) > 1 else "."))
    return [[_without(record, unused) for record in group] for group in groups], notes


def _share(record, name):
    """Share [1] of the rows in which the record has that column."""
    return float(np.isfinite(record.columns[name]).mean()) if name in record.columns else 0.0


def _without(record, names):
    """The record, without the columns ``names``."""
    if not names & set(record.columns):
        return record
    return dataclasses.replace(record, columns={k: v for k, v in record.columns.items() if k not in names})
