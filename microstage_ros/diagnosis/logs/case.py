"""Logs to a `Diagnosis`: baseline learned, the difference judged, causes named, rivals and blind spots stated."""

import numpy as np

from microstage_ros.diagnosis.logs.preprocessing import channels as channel_module
from microstage_ros.diagnosis.logs.preprocessing import coordinates as reduction
from microstage_ros.diagnosis.logs.preprocessing import spread
from microstage_ros.diagnosis.logs.selection.context import Context
from microstage_ros.diagnosis.logs.selection.effects import columns_of
from microstage_ros.diagnosis.logs.preprocessing.motion import MOST_LATE, lag_of, motion_of, tops
from microstage_ros.diagnosis.logs.preprocessing.repeats import repetitions
from microstage_ros.diagnosis.logs.preprocessing.turn import turn_of
from microstage_ros.diagnosis.logs.selection.verdict import answer
from microstage_ros.quantities.errors import InputError

LEAST_ROWS = 40            # samples of a channel in the baseline, and in the logs of now


def diagnose_logs(baseline, now, description, seed=0):
    """Find what changed between the logs of a healthy machine and those of now.

    Parameters
    ----------
    baseline, now : lists of `Log` (one file each). description : `LogDescription`. seed : written into the result [1].

    Raises
    ------
    InputError : nothing can be compared: no condition, no motion, no signal in common.
    """
    prepared = prepare(baseline, now, description)
    groups, channels, stroke, top, sharp, notes = prepared
    places_cells = reduction.choose_cells(groups["baseline"], groups["now"], stroke, top)
    if not len(places_cells[1]):
        raise InputError(
            "records",
            "no phase of motion in common with the baseline",
            "logs with like speeds and places as the baseline's",
        )
    if places_cells[2] < 0.5:
        notes.append(f"Only {places_cells[2]:.0%} of the rows move as the baseline does; the others are not compared.")
    reduced, spreads, spectra = {}, {}, {}
    turn, guess = turn_of(groups, channels, description, stroke)
    if guess:
        notes.append(guess)
    for name, channel in list(channels.items()):
        places, cells, _ = places_cells
        reduced[name] = reduction.reduce(
            channel, groups["baseline"], groups["now"], cells, places, stroke, top, columns_of(stroke, turn), turn
        )
        if channel.kind == channel_module.FLUCTUATION:
            reduced[name] = reduction.only_rough(reduced[name])
            if reduced[name] is None:
                del reduced[name], channels[name]
                continue
        spreads[name] = spread.learn(reduced[name])
        if name == "effort" or not spectra:
            spectra = reduced[name].spectrum
    codes = sorted({int(c) for r in groups["now"] for c in np.unique(r.condition) if c >= 0})
    context = Context(
        channels,
        description.facts,
        abs(stroke[1] - stroke[0]),
        top,
        sharp,
        groups["baseline"][0].log.place_unit,
        codes,
        spectra,
        description.position_at,
    )
    open_sign, ratio = (
        channel_module.sign_is_open(channels["effort"], groups["baseline"]) if "effort" in channels else (False, 1.0)
    )
    if open_sign:
        notes.append(
            "The current has no sign, and the logs do not tell whether friction or a constant force is the larger: the"
            " two may change places."
        )
    if any(r.log.shift is not None for side in groups.values() for r in side):
        notes.append(
            "Levels of the effort were shifted after the recording; only its shape within stretches of one constant is"
            " compared."
        )
    result = answer(reduced, spreads, groups, context, notes, open_sign, seed)
    result.evidence |= {
        "cells": places_cells[1],
        "places": places_cells[0],
        "stroke": stroke,
        "turn": turn,
        "compared": places_cells[2],
    }
    return result


def prepare(baseline, now, description):
    """Rows with motion, repetition and condition; channels with their healthy models; stroke, top speed and
    acceleration; notes.

    Raises InputError: no baseline, no condition in common with it, no motion in it, no signal to judge by.
    """
    notes = []
    if not baseline:
        raise InputError("--baseline", "none", "at least one log of the machine while it was healthy")
    common = {label for log in baseline for label in log.conditions} & {
        label for log in now for label in log.conditions
    }
    if not common:
        raise InputError(
            f"{description.place}: condition",
            "no value in common between baseline and now",
            "logs of like conditions; the baseline has "
            + "; ".join(str(c) for log in baseline[:3] for c in log.conditions[:3]),
        )
    order = {label: k for k, label in enumerate(sorted(common, key=str))}
    for name, side in (("baseline", baseline), ("now", now)):
        left = {label for log in side for label in log.conditions} - common
        if left:
            notes.append(f"Conditions only in {name} are not compared: {', '.join(map(str, sorted(left, key=str)))}.")
    top, sharp = tops(baseline)
    if not top > 0.0:
        raise InputError("--baseline", "no motion", "logs in which the axis moves")
    groups, usual = {}, float(np.median([lag_of(log) for log in baseline]))
    for name, side in (("baseline", baseline), ("now", now)):
        rows = []
        for number, log in enumerate(side):
            lag = lag_of(log) - usual if name == "now" else 0.0
            motion = motion_of(log, top, sharp, lag if abs(lag) < MOST_LATE else 0.0)
            codes = np.array([order.get(label, -1) for label in log.conditions])[log.condition]
            numbers, regrouped = repetitions(log, motion, description, len(side))
            rows.append(channel_module.Rows(log, motion, numbers, codes, number))
            notes += [f"{log.source}: {note}" for note in (*log.notes, regrouped) if note]
        groups[name] = rows
    channels = {c.name: c for c in channel_module.channels_of(baseline[0])}
    few = {}
    for name, channel in list(channels.items()):
        for side, given in (("records", "now"), ("--baseline", "baseline")):
            good = sum(int(np.isfinite(channel.values(rows)).sum()) for rows in groups[given])
            if good < LEAST_ROWS:
                few[name] = (side, f"{good} rows with a value of the {name} ({channel.kind.replace('_', ' ')})")
        if name in few:
            del channels[name]
            side = "the baseline has" if few[name][0] == "--baseline" else "the logs of now have"
            notes.append(f"Too few rows: {side} {few[name][1]}, which is not compared.")
        else:
            channel_module.fit_models(channel, groups["baseline"])
    if not channels and few:
        raise InputError(*next(iter(few.values())), f"{LEAST_ROWS} rows or more")
    if not channels:
        raise InputError(
            "--baseline",
            "no signal that tells how the machine answered",
            "following_error, current, torque, force or voltage",
        )
    everything = [*groups["baseline"], *groups["now"]]
    return groups, channels, reduction.stroke_of(everything), top, sharp, _shorter(notes)


def _shorter(notes):
    """Notes that many files share are given once."""
    plain = {}
    for note in notes:
        key = note.split(": ", 1)[1] if ": " in note else note
        plain.setdefault(key, []).append(note)
    return [entries[0] if len(entries) == 1 else f"{len(entries)} files: {key}" for key, entries in plain.items()]
