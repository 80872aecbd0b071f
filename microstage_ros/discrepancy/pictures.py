"""Curves that convince: the residual against the coordinate of each cause, measured and by the fitted model."""

import numpy as np

from microstage_ros.discrepancy.diagnosis import Picture
from microstage_ros.discrepancy.evidences import Evidences

BINS = 60
STRETCH = 0.15   # s
COORDINATE = {
    "direction_asymmetry": "velocity", "viscous_change": "velocity", "nonlinear_viscous": "velocity",
    "friction_level_change": "velocity", "frictional_lag": "velocity", "rising_static_friction": "time",
    "presliding_creep": "time", "thermal_drift": "time", "refractive_index": "time", "resistance_rise": "time",
    "amplifier_offset": "time", "backlash": "time", "drive_compliance": "time", "payload_change": "velocity",
    "amplifier_gain": "time", "amplifier_deadband": "time", "sampling_jitter": "velocity",
}
LABELS = {"position": "position [m]", "velocity": "velocity [m/s]", "time": "time [s]"}
Y_LABELS = {"torque": "torque needed beyond the model [N m]", "windup": "stage against motor [m]",
            "resonance": "stage against motor, fast part [m]",
            "position": "interferometer − encoder [m]"}


def pictures_of(collection, evidences, choices, left):
    """One `Picture` per cause and channel on the first held-out record, and one per coordinate that is left."""
    pictures = []
    for choice in choices:
        for channel in sorted({form.channel for form in choice.forms}):
            coordinate = COORDINATE.get(choice.effect, "position")
            pictures.append(_picture(collection, evidences, choices, choice, channel, coordinate))
    for finding in left:
        coordinate = finding.coordinate if finding.coordinate in LABELS else "time"
        pictures.append(_picture(collection, evidences, choices, None, finding.channel, coordinate))
    return pictures


def gap_picture(prepared):
    """`Picture` of stage against motor over the stretch of one record in which it moves most, measured and replayed."""
    rows = int(STRETCH / prepared.period)
    ahead = prepared.stage - prepared.angle
    ranges = [np.ptp(prepared.behind[at: at + rows]) for at in range(0, len(ahead) - rows, rows)]
    part = slice(rows * int(np.argmax(ranges)), rows * (int(np.argmax(ranges)) + 1))
    time = prepared.time[part][::5]
    curves = {"measured": (time, (ahead - np.median(ahead[part]))[part][::5]),
              "stage replayed behind the gap": (time, (prepared.behind - np.median(prepared.behind[part]))[part][::5])}
    return Picture("backlash-windup-time", "backlash: stage against motor", LABELS["time"], Y_LABELS["windup"], curves, "backlash")


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
    x = {"position": one.position, "velocity": one.speed, "time": one.time}[coordinate]
    curves = {"measured": _binned(x, residual - residual.mean())}
    name = choice.effect if choice else ""
    if choice:
        curves["model with the cause"] = _binned(x, model - model.mean())[:2]
    title = f"{name or 'what is left'}: residual against {coordinate}"
    return Picture(f"{name or 'left'}-{channel}-{coordinate}", title, LABELS[coordinate], Y_LABELS[channel], curves, name)


def _binned(x, y):
    """Means of y in bins of x with as many samples each: (x, y, standard error)."""
    order = np.argsort(x, kind="stable")
    parts = np.array_split(order, min(BINS, max(len(x) // 20, 2)))
    mean = lambda values: np.array([values[part].mean() for part in parts])
    spread = np.array([y[part].std() / np.sqrt(len(part)) for part in parts])
    return mean(x), mean(y), spread
