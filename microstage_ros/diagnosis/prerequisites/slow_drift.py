"""A drift between the two position readings that takes its own course in every record.

Parts warm up as the room and the day will have it: a second record does not repeat the first one's course, and no
size learned on one predicts another. What can be held out is time within each record: a smooth course laid
through two thirds of it must tell the last third, half a second at a time, in every record.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.residuals.position import course_columns

LEFT_OUT = 0.5     # s, predicted from what is on both sides
FOLDS = 3
MEANS = 40   # blocks of the position channel in a mean of 20 ms; derived: half a millisecond each,
SAMPLES = 200   # and samples in one; derived: at 10 kHz
# share of what moves that the course must tell; calibrated by: validation.margins (0.53 to 0.99)
PREDICTED_SHARE = 0.7
ABOVE_BASE = 3.0   # times the baseline's course
# m rms; calibrated by: validation.margins (6.2e-10 to 9.6e-8)
LEAST = 2.0e-9
# m rms: above it, other residuals must take it into account; calibrated by: validation.margins (6.2e-10 to 9.6e-8)
MATTERS = 2.0e-8
OF_ALL = 0.1       # share of the whole residual's variance; derived: a third of its rms, squared
TINY = np.finfo(float).tiny


@dataclasses.dataclass(frozen=True)
class Course:
    """Size of the drift (rms, m) and its mean rate [m/s], with standard errors from the scatter between records,
    and χ² of the held-out records without and with it."""

    size: float
    size_stderr: float
    rate: float
    rate_stderr: float
    held_before: float = 0.0
    held_after: float = 0.0


def find_course(collection, evidences, choices):
    """`Course` of the drift that is left beside these choices, or None.

    Of the baseline nothing is taken out, as it has none of them: less a drift that was learned elsewhere it would
    drift.
    """
    if "position" not in collection.names:
        return None
    forms = [form for choice in choices for form in choice.forms if form.channel == "position"]
    beta = evidences.learn["position"].fit([form.key for form in forms])[0]
    trends = {
        group: [_trend_beside(c["position"], [] if group == "base" else forms, beta, collection.frame)
                for c in records if "position" in c]
        for group, records in collection.channels.items()
    }
    ours = trends["learn"] + trends["held"]
    if not _agree(ours, trends["base"], LEAST) or min(t.size**2 / t.whole for t in ours) < OF_ALL:
        return None
    sizes, rates = np.array([t.size for t in ours]), np.array([t.rate for t in ours])
    root = np.sqrt(len(ours))
    return Course(float(sizes.mean()), float(sizes.std() / root), float(rates.mean()), float(rates.std() / root))


def courses(prepared):
    """The interferometer's slow course of every learning and held-out record [m, one per row], or () without one that
    matters.

    It is in no torque balance, and a stage that seems to creep by it does not move.
    """
    records = [p for group in ("learn", "held") for p in prepared[group]]
    if any(p.interferometer is None for p in records):
        return ()
    ours, base = ([_trend(*_means(p.interferometer - p.encoder, p.time, SAMPLES)) for p in group] for group in (
        records, [p for p in prepared["base"] if p.interferometer is not None]))
    if not _agree(ours, base, MATTERS):
        return ()
    return tuple(np.interp(p.time, t.time, t.course) - t.course[0] for p, t in zip(records, ours))


def course_of(prepared):
    """(interferometer less encoder, time, smooth course) of one record in means of 20 ms, each shape (k,) [m, s, m]."""
    trends = _trend(*_means(prepared.interferometer - prepared.encoder, prepared.time, SAMPLES))
    return _means(prepared.interferometer - prepared.encoder, prepared.time, SAMPLES)[0], trends.time, trends.course


@dataclasses.dataclass(frozen=True)
class _Trend:
    """What a smooth course predicts: share of what moves, its rms [m] and mean rate [m/s], and itself over time;
    ``whole`` is the variance of the residual it was taken from [m²]."""

    share: float
    size: float
    rate: float
    whole: float
    time: np.ndarray
    course: np.ndarray


def _agree(ours, base, least):
    """Whether every record has a course, and the baseline none like it."""
    usual = max((t.size for t in base), default=0.0)
    return min(t.share for t in ours) >= PREDICTED_SHARE and min(t.size for t in ours) >= max(least, ABOVE_BASE * usual)


def _means(values, time, count=MEANS):
    rows = len(values) // count * count
    return tuple(v[:rows].reshape(-1, count).mean(axis=1) for v in (values, time))


def _trend_beside(channel, forms, beta, frame):
    """`_Trend` of what these forms leave of a channel."""
    values, time = _means(_left(channel, forms, beta, frame), channel.time)
    return _trend(values, time, np.var(channel.residual))


def _trend(values, time, whole=1.0):
    """`_Trend` of means over 20 ms."""
    basis, part = course_columns(time), (time / LEFT_OUT).astype(int) % FOLDS
    error = np.empty(len(values))
    for fold in range(FOLDS):
        out = part == fold
        error[out] = values[out] - basis[out] @ np.linalg.lstsq(basis[~out], values[~out], rcond=None)[0]
    noise = np.mean(np.diff(values) ** 2) / 2.0
    moves = max(np.var(values) - noise, TINY)
    course = basis @ np.linalg.lstsq(basis, values, rcond=None)[0]
    return _Trend(
        1.0 - (np.mean(error**2) - noise) / moves,
        float(np.std(course)),
        float(np.polyfit(time, course, 1)[0]),
        whole,
        time,
        course,
    )


def _left(channel, forms, beta, frame):
    """Residual of a record without what these forms explain."""
    return channel.residual - sum(
        (f.columns(channel, frame) @ b for f, b in zip(forms, _parts(forms, beta, channel, frame))), 0.0
    )


def _parts(forms, beta, channel, frame):
    """Sizes form by form."""
    ends = np.cumsum([form.columns(channel, frame).shape[1] for form in forms])
    return np.split(beta, ends[:-1]) if len(forms) else []


def take_out(collection, evidences, course):
    """(`Evidences` in which every record's position channel is free of its course, the `Course` with its χ²)."""
    for group in ("learn", "held"):
        for channels in collection.channels[group]:
            channels["position"].drifts = True
    forms = [form for form in evidences.forms if form.channel == "position"]
    sums = {group: dict(getattr(evidences, group)) for group in ("learn", "held")}
    before = sums["held"]["position"].energy()
    for group, how in (("learn", collection.gather), ("held", collection.growing)):
        sums[group]["position"] = how("position", forms, group)
    after = sums["held"]["position"].energy()
    free = evidences.with_tables(sums["learn"], sums["held"])
    scale = evidences.scatter["position"]
    return free, dataclasses.replace(course, held_before=before / scale, held_after=after / scale)
