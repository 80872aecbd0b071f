"""Curves that convince: the residual against the coordinate of each cause, measured and by the fitted model."""

import numpy as np

from microstage_ros.diagnosis.prerequisites.slow_drift import course_of
from microstage_ros.diagnosis.residuals.evidence_set import Evidences
from microstage_ros.diagnosis.result import Picture
from microstage_ros.model.effects import REGISTRY

BINS = 60
FOLDED_BINS = 180   # a ripple has up to some twenty cycles per turn
STRETCH = 0.15   # s
COURSE = 2.0     # s: of a record shown in time
MOVES = 2.0e-5   # m/s: slower is rest
ENOUGH = 400     # samples in each direction for a curve of its own
LABELS = {
    "position": "position [m]",
    "velocity": "velocity [m/s]",
    "time": "time [s]",
    "signal period": "position within a signal period [m]",
    "motor turns": "travel within two turns of the motor [m]",
}
FOLDED = ("signal period", "motor turns")   # what repeats too often to be seen along the stroke
Y_LABELS = {"torque": "torque needed beyond the model [N m]", "windup": "stage against motor [m]",
            "resonance": "stage against motor, fast part [m]",
            "position": "interferometer − encoder [m]"}


def pictures_of(collection, evidences, choices, left):
    """One `Picture` per cause and channel on the first held-out record, and one per coordinate that is ``left``,
    `Finding` each."""
    pictures = course_pictures(collection, evidences, choices)
    for choice in choices:
        for channel in sorted({form.channel for form in choice.forms}):
            coordinate = REGISTRY[choice.effect].shows_against
            pictures.append(_picture(collection, evidences, choices, choice, channel, coordinate))
    for finding in left:
        coordinate = finding.coordinate if finding.coordinate in LABELS else "time"
        pictures.append(_picture(collection, evidences, choices, None, finding.channel, coordinate))
    return pictures


def gap_picture(prepared):
    """`Picture` of stage against motor in the stretch of one record where it moves most, measured and by the gap."""
    rows = int(STRETCH / prepared.period)
    ahead = prepared.stage - prepared.angle
    ranges = [np.ptp(prepared.behind[at: at + rows]) for at in range(0, len(ahead) - rows, rows)]
    part = slice(rows * int(np.argmax(ranges)), rows * (int(np.argmax(ranges)) + 1))
    time = prepared.time[part][::5]
    curves = {"measured": (time, (ahead - np.median(ahead[part]))[part][::5]),
              "stage behind the gap": (time, (prepared.behind - np.median(prepared.behind[part]))[part][::5])}
    return Picture(
        "backlash-windup-time", "backlash: stage against motor", LABELS["time"], Y_LABELS["windup"], curves, "backlash"
    )


def drift_picture(prepared):
    """`Picture` of one record's interferometer less encoder over time, in means of 20 ms, and the smooth course through
    it."""
    values, time, course = course_of(prepared)
    level = course.mean()
    curves = {"measured": (time, values - level), "smooth course": (time, course - level)}
    return Picture("thermal_drift-position-time", "thermal_drift: interferometer less encoder", LABELS["time"],
                   Y_LABELS["position"], curves, "thermal_drift")


def course_pictures(collection, evidences, choices):
    """Torque in time over a stretch of the first held-out record: measured, by the axis file, with the causes.

    The stretch is the one over which the causes change the model most; none without a cause in that channel.
    """
    forms = [form for choice in choices for form in choice.forms if form.channel == "torque"]
    if not forms:
        return []
    one = collection.channels["held"][0]["torque"]
    beta, _, _ = evidences.learn["torque"].fit(Evidences._keys("torque", choices))
    change = np.concatenate([form.columns(one, collection.frame) for form in forms], axis=1) @ beta
    rows = max(int(COURSE / (one.time[1] - one.time[0])), 2)
    sums = np.convolve((change - change.mean()) ** 2, np.ones(min(rows, len(change))), "valid")
    part = slice(int(np.argmax(sums)), int(np.argmax(sums)) + rows)
    model = one.torque - one.residual
    curves = {"measured": (one.time[part], one.torque[part]), "axis file": (one.time[part], model[part]),
              "with the causes": (one.time[part], (model + change)[part])}
    return [
        Picture(
            "course-torque-time",
            "measurement and model in time",
            LABELS["time"],
            "torque of friction and loads [N m]",
            curves,
        )
    ]


def _picture(collection, evidences, choices, choice, channel, coordinate):
    one = collection.channels["held"][0][channel]
    residual, model = np.array(one.residual), np.zeros(len(one.residual))
    keys = Evidences._keys(channel, choices)
    beta, _, _ = evidences.learn[channel].fit(keys)
    at = 0
    for c in choices:
        for form in (f for f in c.forms if f.channel == channel):
            columns = form.columns(one, collection.frame)
            part = columns @ beta[at: at + columns.shape[1]]
            at += columns.shape[1]
            if c is choice:
                model += part
            else:
                residual -= part
    x = _across(one, choice, channel, coordinate, collection.frame.drive)
    if coordinate == "motor turns":  # at rest the friction's unknown state stands at one place
        moving = np.abs(one.speed) > MOVES
        x, residual, model = x[moving], residual[moving], model[moving]
    bins = FOLDED_BINS if coordinate in FOLDED else BINS
    name = choice.effect if choice else ""
    residual, model = residual - residual.mean(), model - model.mean()
    curves = {}
    for way, rows in _directions(one.speed if coordinate != "motor turns" else one.speed[moving], coordinate):
        curves["measured" + way] = _binned(x[rows], residual[rows], bins)
        if choice:
            curves["model with the cause" + way] = _binned(x[rows], model[rows], bins)[:2]
    title = f"{name or 'what is left'}: residual against {coordinate}"
    return Picture(
        f"{name or 'left'}-{channel}-{coordinate}", title, LABELS[coordinate], Y_LABELS[channel], curves, name
    )


def _directions(speed, coordinate):
    """Rows to be shown together: by direction of motion along the stroke or a turn, else all.

    Friction turns its sign with the direction: what both have in common cancels where they are pooled.
    """
    ways = (", forward", speed > MOVES), (", backward", speed < -MOVES)
    if coordinate in ("velocity", "time") or min(np.count_nonzero(rows) for _, rows in ways) < ENOUGH:
        return [("", slice(None))]
    return ways


def _across(one, choice, channel, coordinate, drive):
    """The coordinate of a picture for every row of a channel; what repeats is folded on its period."""
    if coordinate == "motor turns":
        return one.position % (4.0 * np.pi * drive.lever)  # two: half cycles per turn are found too
    if coordinate == "signal period":
        return one.position % float(next(form for form in choice.forms if form.channel == channel).variant)
    return {"position": one.position, "velocity": one.speed, "time": one.time}[coordinate]


def _binned(x, y, bins):
    """Means of y in ``bins`` bins of x with as many samples each: (x, y, standard error)."""
    order = np.argsort(x, kind="stable")
    parts = np.array_split(order, min(bins, max(len(x) // 20, 2)))
    mean = lambda values: np.array([values[part].mean() for part in parts])
    spread = np.array([y[part].std() / np.sqrt(len(part)) for part in parts])
    return mean(x), mean(y), spread
