"""Causes that are no matter of regression: what had to be known first, a drift with a course of its own, late
readings."""

import math

import numpy as np

from microstage_ros.diagnosis.prerequisites.resonant import DAMPING_ERROR, STIFFNESS_ERROR
from microstage_ros.diagnosis.prerequisites.timing import HALF_MEAN, HALF_SPREAD, readings_late
from microstage_ros.diagnosis.result import Cause, Improvement, Parameter
from microstage_ros.diagnosis.selection import judge

# share of a jitter: rounding scatters otherwise under it; calibrated by: microstage campaign --world second
# --kind single --effect sampling_jitter --seed 17001 --cases 10 --form-errors (0.014 to 0.065)
JITTER_ERROR = 0.03


def nonregression_causes(collection, known, course, others, book, unsure):
    """Causes of a `known.Known`, of a `slow_drift.Course` or None, and late readings; their χ² is added to the book.

    ``others``: causes of the regression. Rivals are added to ``unsure``, `Rivals` each.
    """
    causes = []
    if known.slow is not None:
        causes += _slowness(known.slow, book, unsure)
    if known.gap is not None:
        causes.append(_lost_motion(known.gap, collection.frame.drive.radius, book))
        if known.gap.far and not any(cause.id == "payload_change" for cause in others):
            causes += _drive_behind(known.gap, book, unsure)
    if known.lines:
        causes.append(_vibration(known.lines, len(collection.prepared["held"]), book))
    if course is not None:
        causes.append(_drift(course, collection, book))
    sde = next((cause.effect for cause in others if cause.id == "encoder_sde"), None)
    learn, held, base = (collection.prepared[group] for group in ("learn", "held", "base"))
    late = readings_late(learn, held, base, sde=sde)
    if late is not None:
        mean = next((cause.parameters["late_s"] for cause in others if cause.id == "sampling_jitter"), None)
        causes.append(_late(late, book, mean, learn[0].period))
    return causes


def _slowness(slow, book, unsure):
    """The causes ``transport_delay`` and ``actuator_lag``, one of them, or one of them as the other's rival."""
    book.before += slow.held
    if slow.rival:
        book.parts[slow.effect] = slow.held
        unsure.append(judge.rivals_entry(["transport_delay", "actuator_lag"]))
        return []
    found = [(slow.effect, slow.time, slow.stderr, slow.held - slow.lag_held)]
    found += [("actuator_lag", slow.lag, slow.lag_stderr, slow.lag_held)] if slow.lag else []
    causes, left = [], slow.held_before - slow.held
    for effect, time, stderr, part in found:
        book.parts[effect] = part
        name = "delay_s" if effect == "transport_delay" else "time_s"
        before, after = (float(slow.noise * np.sqrt(v / slow.held_rows)) for v in (left + part, left))
        causes.append(Cause(effect, {name: Parameter(time, stderr, "s")}, {name: time}, 0.0, 0.0,
                            Improvement(before, after, "V"), "command"))
    return causes


def _lost_motion(gap, radius, book):
    """The cause ``backlash`` from the replayed gap."""
    # a replay that lost its place in the gap makes the held-out record worse: no part of the whole; its own gain tells
    # it
    part = max(gap.held_before - gap.held_after, 0.0)
    book.before += part
    book.parts["backlash"] = part
    rms = [gap.noise * np.sqrt(v / gap.held_rows) for v in (gap.held_before, gap.held_after)]
    width = gap.width / radius
    return Cause(
        "backlash",
        {"width_rad": Parameter(width, gap.stderr / radius, "rad")},
        {"width_rad": width},
        0.0,
        0.0,
        Improvement(float(rms[0]), float(rms[1]), "m"),
        "windup",
    )


def _drive_behind(gap, book, unsure):
    """The cause ``drive_compliance`` of a drive train that a rattle in a `Gap` tells; it or a mass are rivals where the
    damping is off by the same factor, as it would be by a mass."""
    if gap.scales:
        unsure.append(judge.rivals_entry(["drive_compliance", "payload_change"]))
        return []
    part = max(gap.held_loose - gap.held_after, 0.0)
    book.before += part
    book.parts["drive_compliance"] = part
    before, after = (float(gap.noise * np.sqrt(v / gap.held_rows)) for v in (gap.held_loose, gap.held_after))
    error = float(np.hypot(gap.stiffness_stderr, STIFFNESS_ERROR * gap.stiffness))
    parameters = {
        "stiffness_factor": Parameter(gap.stiffness, error, "1"),
        "damping_factor": Parameter(gap.damping, DAMPING_ERROR * gap.damping, "1"),
    }
    return [Cause("drive_compliance", parameters, {name: p.value for name, p in parameters.items()}, 0.0, 0.0,
                  Improvement(before, after, "m"), "windup")]


def _drift(course, collection, book):
    """The cause ``thermal_drift`` from a course of its own in every record; an axis file can hold its mean rate
    only."""
    part = course.held_before - course.held_after
    book.before += part
    book.parts["thermal_drift"] = part
    channels = [c["position"] for c in collection.channels["held"]]
    noise, rows = np.mean([c.scatter for c in channels]), sum(len(c.residual) for c in channels)
    before, after = (float(noise * np.sqrt(v / rows)) for v in (course.held_before, course.held_after))
    parameters = {"drift_rms_m": Parameter(course.size, course.size_stderr, "m"),
                  "rate_m_s": Parameter(course.rate, course.rate_stderr, "m/s")}
    return Cause("thermal_drift", parameters, {"rate_m_s": course.rate}, 0.0, 0.0, Improvement(before, after, "m"),
                 "position")


def _vibration(lines, held_records, book):
    """The cause ``floor_vibration`` from its lines; its gain is what the amplitudes learned take from the held-out
    records, each line with the phase that it has there."""
    held = sum(line.held for line in lines)
    book.before += held
    book.parts["floor_vibration"] = held
    parameters = {}
    for n, line in enumerate(lines, 1):
        parameters[f"frequency_{n}_hz"] = Parameter(line.frequency, line.frequency_stderr, "Hz")
        parameters[f"amplitude_{n}_m"] = Parameter(line.amplitude, line.stderr, "m")
    effect = {"frequencies_hz": [line.frequency for line in lines], "amplitudes_m": [line.amplitude for line in lines],
              "phases_rad": [line.phase for line in lines]}
    sizes = np.abs([line.traces[-held_records:] for line in lines])          # (lines, held-out records)
    learned = np.array([[line.amplitude] for line in lines])
    before, left = (float(np.sqrt(np.mean(np.sum(values**2, axis=0)) / 2.0)) for values in (sizes, sizes - learned))
    return Cause("floor_vibration", parameters, effect, 0.0, 0.0, Improvement(before, left, "m"), "position")


def _late(late, book, mean, period):
    """The cause ``sampling_jitter`` from scatter and repeated samples.

    ``mean``: lateness [s] that the regression found, a `Parameter`, or None. Of readings that are late by late_s +
    |jitter_s · N(0, 1)|, a share of them lost, it is late_s + √(2/π) jitter_s − lost_fraction T, as a lost one stands
    for the reading a ``period`` T [s] before.
    """
    taught, again = late
    book.before += again.gain
    book.parts["sampling_jitter"] = book.parts.get("sampling_jitter", 0.0) + again.gain
    jitter = taught.jitter / HALF_SPREAD
    # derived: of the root of a variance
    error = jitter * math.hypot(taught.stderr / (2.0 * taught.variance), JITTER_ERROR) if jitter > 0.0 else 0.0
    parameters = {"lost_fraction": Parameter(taught.lost, taught.lost_stderr, "1")}
    effect = {"lost_fraction": min(taught.lost, 0.5)}
    if jitter > 0.0:
        parameters["jitter_s"], effect["jitter_s"] = Parameter(jitter, error, "s"), jitter
    if mean is not None:
        constant = mean.value - HALF_MEAN * jitter + taught.lost * period
        stderr = float(np.hypot(mean.stderr, np.hypot(HALF_MEAN * error, taught.lost_stderr * period)))
        parameters["late_s"], effect["late_s"] = Parameter(constant, stderr, "s"), max(constant, 0.0)
    before, after = (float(np.sqrt(again.left(growth))) for growth in (0.0, taught.grown))
    return Cause("sampling_jitter", parameters, effect, 0.0, 0.0, Improvement(before, after, "m"), "position")
