"""From records to evidence: every record prepared, every channel filled, all candidates' columns gathered."""

import copy
import dataclasses
import functools
import operator

import numpy as np

from microstage_ros.diagnosis.catalogue import FORMS
from microstage_ros.diagnosis.catalogue.form import Frame
from microstage_ros.diagnosis.preprocessing.threads import side_by_side
from microstage_ros.diagnosis.residuals.command import Command
from microstage_ros.diagnosis.residuals.evidence import gather
from microstage_ros.diagnosis.residuals.evidence_set import Evidences
from microstage_ros.diagnosis.residuals.growing import Growing
from microstage_ros.diagnosis.residuals.healthy import (
    laws_of,
    profile_of,
    rescale_random_friction,
    take_healthy,
    unevenness,
)
from microstage_ros.diagnosis.residuals.mechanical import Mechanical, fit_spreads, stated_spreads
from microstage_ros.diagnosis.residuals.position import Position
from microstage_ros.diagnosis.residuals.resonance import Resonance
from microstage_ros.diagnosis.residuals.systematic import SYSTEMATIC
from microstage_ros.diagnosis.residuals.transmission_deflection import Windup

GROUPS = ("learn", "held", "base")


class Collection:
    """Channels of all records in the groups ``learn``, ``held`` and ``base``, and what is common to them.

    ``channels`` {group: [{name: channel}]}, of a group ``twin``, too, where there is one; ``spreads`` of the random
    friction (from the baseline);
    ``healthy`` [(form, sizes)] that the baseline shows and that were taken out of every torque balance; ``raw`` the
    baseline's balances before that; ``own_profile`` the relative
    standard deviation of the healthy friction along the stroke.
    """

    def __init__(self, prepared, drive, fast_only=False, rattled_mass=0.0):
        drive = seen_amplifier(prepared["base"], drive)
        self.frame = dataclasses.replace(frame_of(prepared, drive), rattled_mass=rattled_mass)
        self.prepared = prepared
        self.channels = {group: [channels_of(p, drive, fast_only) for p in some] for group, some in prepared.items()}
        self.spreads = stated_spreads(drive)
        healthy = [c["torque"] for c in self.channels["base"] if "torque" in c]
        self.own_profile, self.healthy, self.raw = 0.0, [], [copy.copy(one) for one in healthy]
        if healthy:
            self.spreads = fit_spreads(healthy)
            every = [c["torque"] for some in self.channels.values() for c in some if "torque" in c]
            self.healthy = take_healthy(every, healthy, laws_of(FORMS), self.frame, self.spreads)
            if self.healthy:
                self.spreads = fit_spreads(healthy)
            # where the baseline did not go, friction along the stroke stays random: the spreads keep it
            profile = profile_of(self.frame, self.spreads)
            found = take_healthy(every, healthy, [profile], self.frame, self.spreads)
            self.own_profile = unevenness(healthy, found, self.frame)
            self.healthy += found
            if found:
                rescale_random_friction(every, healthy, self.frame, self.spreads)
        self.names = set.intersection(*({*c} for group in ("learn", "held") for c in self.channels[group]))

    def gather(self, channel, forms, group):
        """`Evidence` of one channel for some forms, summed over the records of a group; None if there are none."""
        records = [record[channel] for record in self.channels[group] if channel in record]
        parts = side_by_side(
            lambda one: gather(one, forms, self.frame, SYSTEMATIC.get(channel), **self._noise(channel)), records
        )
        return functools.reduce(operator.add, parts) if parts else None

    def growing(self, channel, forms, group):
        """The same as a `Growing`, which gathers a form when it is asked for; group ``raw``: the baseline's torque
        balance before anything was taken out of it."""
        records = self.raw if group == "raw" else [r[channel] for r in self.channels[group] if channel in r]
        return Growing(records, forms, self.frame, SYSTEMATIC.get(channel), **self._noise(channel)) if records else None

    def _noise(self, channel):
        return {"spreads": self.spreads} if channel == "torque" else {}

    def evidences(self, forms=FORMS):
        """`Evidences` over all channels that learning and held-out records share."""
        sums = {group: {} for group in GROUPS}
        for name in sorted(self.names):
            for group in GROUPS:
                how = self.gather if group == "learn" else self.growing
                evidence = how(name, [form for form in forms if form.channel == name], group)
                if evidence is not None:
                    sums[group][name] = evidence
        scatter = {name: _scatter(sums["base"].get(name)) for name in self.names}
        kept = [form for form in forms if form.channel in self.names]
        own = {name: [form for form in kept if form.channel == name] for name in self.names}
        raw = {"torque": self.growing("torque", own["torque"], "raw")} if self.healthy and "torque" in own else {}
        return Evidences(sums["learn"], sums["held"], sums["base"], kept, scatter, self.frame,
                         lambda name: self.growing(name, own[name], "learn"), raw,
                         self.own_profile)


def seen_amplifier(base, drive):
    """The drive with the amplifier's noise that records of the healthy axis show, where there are such; else as
    stated."""
    seen = [Windup(p, drive).amplifier_noise for p in base if p.has_current]
    return dataclasses.replace(drive, amplifier_noise=float(np.median(seen))) if seen else drive


def frame_of(prepared, drive):
    """`Frame` of prepared records {group: [`Prepared`]}."""
    every = [p for group in GROUPS for p in prepared[group]]
    return Frame(drive, min(p.position.min() for p in every), max(p.position.max() for p in every),
                 max(p.time[-1] for p in every))


def channels_of(prepared, drive, fast_only=False):
    """The channels that a prepared record can fill, by name; the command channel alone if ``fast_only``."""
    if fast_only:
        return {"command": Command(prepared, drive)} if prepared.has_current else {}
    kinds: list[type[Mechanical | Windup | Resonance | Position]] = [Mechanical]
    if prepared.has_current:
        kinds += [Windup] if prepared.behind is not None else [Windup, Resonance]
    if prepared.interferometer is not None:
        kinds.append(Position)
    return {kind.name: kind(prepared, drive) for kind in kinds}


def _scatter(evidence):
    """χ² per row of the baseline, at least one."""
    return 1.0 if evidence is None else max(evidence.energy() / evidence.rows, 1.0)
