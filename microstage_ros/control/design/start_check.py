"""Before a start: whether the law is stable on the axis file's own model, and on machines that the file does not rule
out.

The eigenvalues of the sampled loop in every regime of `linear_loop.regime_slopes` say it, for the numbers of the file
and for each of `DOUBTED` moved by twice its standard uncertainty, a tenth at least. The observer law starts with the
first of `START_DOUBTS` in encoder and voltage that holds all of them. Where there is none, the encoder-only
self-tuning law starts, from gains that are stable with `GAIN_MARGIN` to spare.

``gains`` are {name of `pid.GAINS`: number, SI}, ``period`` that of control [s], ``margin`` a factor on all gains [1].
"""

import numpy as np

from microstage_ros.control.observer.flexible_mode import held
from microstage_ros.control.design.linear_loop import (
    OBSERVER_STATES,
    PID_STATES,
    cut_loop,
    linear_matrices,
    observer_step,
    pid_step,
    regime_slopes,
)
from microstage_ros.control.observer.wind_up import HEAVIER
from microstage_ros.quantities.errors import InputError

DOUBTED = ("stage.mass", "transmission.stiffness", "drive.rotor_inertia")
UNCERTAINTIES, LEAST_DOUBT = 2.0, 0.1  # by which each is moved, and the least share of it: no file is exact
GAIN_MARGIN = 1.4  # factor on all gains under which the encoder-only law must be stable
LOWER, STEPS = 0.75, 14  # of the gains with every step, and the most steps: to a fortieth
#: Doubts in encoder and voltage over the shipped ones, in the order in which they are tried.
START_DOUBTS = ((1.0, 1.0), (1.5, 1.0), (2.0, 1.0), (3.0, 1.0), (4.0, 1.0), (4.0, 2.0), (6.0, 2.0), (8.0, 4.0))
SLOWER = 1.5  # times the file's settling time, that a heavier stage may take: a choice, 38 ms for the shipped axis
ENCODER_DOUBTS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)  # over the shipped one, up to `source_doubt.MOST_ENCODER`
FILTERS = (1.0, 2.0, 3.2)  # times the filter time that are tried
_found: dict = {}  # by the numbers that it follows from: a campaign asks the same thousands of times
CREEPING = "sliding, 1 um/s"  # where the axis itself is unstable, and blocks that stick again bound what follows


def doubted_axes(axis):
    """The axis, and the same with each doubted number moved by its uncertainty up and down, a list of `Axis`."""
    found = [axis]
    for key in DOUBTED:
        if axis.has(key):
            value, stderr = axis.value(key), axis.quantity(key).stderr or 0.0
            doubt = max(UNCERTAINTIES * float(stderr), LEAST_DOUBT * value)
            moved = (max(value + sign * doubt, 0.1 * value) for sign in (-1.0, 1.0))
            found += [axis.with_values({key: number}, source="derived") for number in moved]
    return found


def stable_doubts(axis, parameters):
    """The first of `START_DOUBTS` with which the observer law holds every one of `doubted_axes`, None if there is none.

    ``parameters`` : the law's record, which is left as it is.
    """
    tried = parameters.copy()
    for doubts in START_DOUBTS:
        tried["observer"]["encoder_doubt"], tried["observer"]["voltage_doubt"] = doubts
        if observer_is_stable(axis, tried):
            return doubts
    return None


def held_doubts(axis, parameters):
    """Doubt in the encoder over the shipped one [1] with which the observer law holds a stage that is heavier than the
    file's, `wind_up.HEAVIER` times, shape (7,): the loop settles within `SLOWER` times the time that it takes on the
    file's. The most where none does.

    ``parameters`` : the law's record, which is left as it is.
    """
    key = ("heavier", parameters.tobytes(), *(repr(axis.quantity(name)) for name in DOUBTED if axis.has(name)))
    if key not in _found:
        tried, found = parameters.copy(), [float(parameters["observer"]["encoder_doubt"])]
        slowest = _slowest(axis, tried) ** (1.0 / SLOWER)
        for factor in HEAVIER[1:]:
            heavy = axis.with_values({"stage.mass": factor * axis.value("stage.mass")}, source="derived")
            for doubt in (found[-1], *(doubt for doubt in ENCODER_DOUBTS if doubt > found[-1])):
                tried["observer"]["encoder_doubt"] = doubt
                if _slowest(heavy, tried) < slowest:
                    break
            found.append(doubt)
        _found[key] = np.array(found)
    return _found[key]


def _slowest(axis, parameters):
    """Largest magnitude of the loop's eigenvalues in every regime but creeping [1]."""
    period = float(parameters["period"])
    return max(
        _magnitude(_sampled(axis, actuator, guideway, period), observer_step(parameters, *slopes), OBSERVER_STATES)
        for name, actuator, guideway, slopes in regime_slopes(axis) if name != CREEPING
    )


def observer_is_stable(axis, parameters):
    """Whether the observer law, its parameter record given, is stable in every regime of every one of
    `doubted_axes`."""
    key = parameters.tobytes() + repr([axis.quantity(name) for name in DOUBTED if axis.has(name)]).encode()
    if key not in _found:
        _found[key] = _observer_is_stable(axis, parameters)
    return _found[key]


def _observer_is_stable(axis, parameters):
    period = float(parameters["period"])
    return all(
        _settles(_sampled(each, actuator, guideway, period), observer_step(parameters, *slopes), OBSERVER_STATES)
        for each in doubted_axes(axis) for name, actuator, guideway, slopes in regime_slopes(each) if name != CREEPING
    )


def pid_is_stable(axis, gains, period, margin=GAIN_MARGIN):
    """Whether PID ``gains`` on the encoder, and ``margin`` times them, are stable in every regime but creeping."""
    return _pid_settles(_plants(axis, period), gains, period, margin)


def held_start(axis, gains, period):
    """(factor on the gains, factor on the filter time) from which the encoder-only self-tuning law holds the axis at
    its start.

    The largest factor of a grid for which the PID ``gains`` times it are stable with `GAIN_MARGIN`, then the shortest
    filter. Raises `InputError` if there is none.
    """
    plants = _plants(axis, period)
    for lower in LOWER ** np.arange(STEPS):
        for longer in FILTERS:
            changed = {
                **gains,
                "proportional": gains["proportional"] * lower,
                "filter_time": gains["filter_time"] * longer,
            }
            if _pid_settles(plants, changed, period, GAIN_MARGIN):
                return float(lower), longer
    raise InputError(
        f"{axis.place}: controller",
        gains["proportional"],
        "a machine that a PID law can hold: none is stable on its model",
    )


def _plants(axis, period):
    return [
        _sampled(axis, actuator, guideway, period)
        for name, actuator, guideway, _ in regime_slopes(axis)
        if name != CREEPING
    ]


def _pid_settles(plants, gains, period, margin):
    return all(
        _settles((a, b, c[:1]), pid_step({**gains, "proportional": factor * gains["proportional"]}, period), PID_STATES)
        for factor in (1.0, margin)
        for a, b, c in plants
    )


def _sampled(axis, actuator, guideway, period):
    a, b, c = linear_matrices(axis, actuator, guideway)
    return *held(a, b, period), c


def _settles(plant, step, size):
    """Whether the closed loop of ``plant`` (a, b, c) and law settles."""
    return bool(_magnitude(plant, step, size) < 1.0 - 1e-9)


def _magnitude(plant, step, size):
    """Largest magnitude of its eigenvalues [1]."""
    a, b, c = plant
    loop, entry, row = cut_loop(a, b, c, step, size)
    return np.abs(np.linalg.eigvals(loop + entry @ row)).max()
