"""From records to evidence: every record prepared, every channel filled, all candidates' columns gathered."""

import numpy as np

from microstage_ros.discrepancy.catalogue import FORMS, forms_of
from microstage_ros.discrepancy.catalogue.form import Frame
from microstage_ros.discrepancy.channels.command import Command
from microstage_ros.discrepancy.channels.mechanical import DEFAULT_SPREADS, Mechanical, fit_spreads
from microstage_ros.discrepancy.channels.position import Position
from microstage_ros.discrepancy.channels.windup import Windup
from microstage_ros.discrepancy.evidence import gather
from microstage_ros.discrepancy.preparation import prepare
from microstage_ros.discrepancy.selection import Evidences
from microstage_ros.discrepancy.systematic import SYSTEMATIC


def prepare_all(groups, drive):
    """Prepared records of each group: ``groups`` is a mapping name → list of `Record`."""
    return {name: [prepare(record, drive) for record in records] for name, records in groups.items()}


def channels_of(prepared, drive):
    """The channels that a prepared record can fill, by name."""
    kinds = [Mechanical]
    if prepared.has_current:
        kinds += [Command, Windup]
    if prepared.interferometer is not None:
        kinds.append(Position)
    return {kind.name: kind(prepared, drive) for kind in kinds}


def frame_of(groups, drive):
    """`Frame` that spans all prepared records."""
    every = [p for group in groups.values() for p in group]
    return Frame(drive, min(p.position.min() for p in every), max(p.position.max() for p in every),
                 max(p.time[-1] for p in every))


def collect(groups, drive):
    """`Evidences` from prepared groups ``learn``, ``held``, ``base``; with the channels of each record.

    Returns (evidences, channels {group: [{name: channel}]}, frame).
    """
    frame = frame_of(groups, drive)
    channels = {name: [channels_of(p, drive) for p in group] for name, group in groups.items()}
    healthy = [c["torque"] for c in channels["base"]]
    spreads = fit_spreads(healthy) if healthy else DEFAULT_SPREADS
    sums = {}
    for name, group in channels.items():
        sums[name] = {}
        for one in group:
            for key, channel in one.items():
                noise = {"spreads": spreads} if key == "torque" else {}
                evidence = gather(channel, forms_of(key), frame, SYSTEMATIC.get(key), **noise)
                sums[name][key] = sums[name][key] + evidence if key in sums[name] else evidence
    common = set(sums["learn"]) & set(sums["held"])
    scatter = {key: _scatter(sums["base"].get(key)) for key in common}
    evidences = Evidences(*({k: v for k, v in sums[name].items() if k in common} for name in ("learn", "held", "base")),
                          [form for form in FORMS if form.channel in common], scatter)
    return evidences, channels, frame


def _scatter(evidence):
    """χ² per row of the baseline, at least one."""
    return 1.0 if evidence is None else max(evidence.energy() / evidence.rows, 1.0)
