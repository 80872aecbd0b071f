"""Features of records of a motor: slow reversals, steady sliding, accelerations; one record at a time.

A record is reduced to what the estimators need (a few thousand numbers), so that hours of repeats fit in
memory. `identify_actuator` turns the features of all records into parameters.

Source: paper, section 4.1: friction torque k_M i against the angle in slow motion, and against constant speeds.
"""

from dataclasses import dataclass, field

import numpy as np

from microstage_ros.identification.estimators.acceleration import total_inertia_of
from microstage_ros.identification.estimators.virgin_curve import loading_from_samples
from microstage_ros.identification.signals import MotorSignals, reversals, steady_windows, window_means
from microstage_ros.model.transmission import screw_ratio
from microstage_ros.numerics.filters import low_pass

QUASI_STATIC = 0.03  # a branch is slow if its speed is below this share of the Stribeck velocity
BRANCH_EDGE = 300.0  # low-pass of angle and torque on a slow branch [Hz]
JUMP = 2.0  # rows faster than this many times the branch's speed are left out
STRAIGHT = 0.3  # share of the force up to which a branch is one straight line
SLIDING_TRAVEL = 1.5  # steady points count from this many slip displacements after the start


@dataclass
class Features:
    """What one or many records hold.

    `loadings` with `loading_repeat`; steady points `speed` [rad/s], `friction` [N m], `repeat`; friction
    series for the variability as rows (relative deviation is formed later): `series` of (speed, torque,
    travel [m], time [s], position [m], new run).
    """

    loadings: list = field(default_factory=list)
    loading_repeat: list = field(default_factory=list)
    speed: list = field(default_factory=list)
    friction: list = field(default_factory=list)
    repeat: list = field(default_factory=list)
    series: list = field(default_factory=list)

    def extend(self, other):
        """Take over the features of another record."""
        for name in self.__dataclass_fields__:
            getattr(self, name).extend(getattr(other, name))


def slip_displacement(axis):
    """Largest slip displacement x_j of the axis file's actuator [rad]: where sliding is complete."""
    stiffness, weight = (np.asarray(axis.value(f"contacts.actuator.{key}")) for key in ("stiffness", "weight"))
    return float((weight / weight.sum() * axis.value("contacts.actuator.static") / stiffness).max())


def extract(signals: MotorSignals, axis, repeat, load=None):
    """`Features` of one record.

    Parameters
    ----------
    signals : `MotorSignals` of the record.
    axis : gives the scales (slip displacement, Stribeck velocity) and the inertia to take off.
    repeat : number of the repeat that this record belongs to [1].
    load : torque at the motor of what else is driven [N m], shape (n,); taken off. None: nothing is driven.
    """
    features = Features()
    if load is not None:
        signals = MotorSignals(**{**signals.__dict__, "torque": signals.torque - load})
    slip = slip_displacement(axis)
    slow = QUASI_STATIC * axis.value("contacts.actuator.stribeck_velocity")
    for start, stop, direction in reversals(signals, slow, 2.0 * slip):
        branch = _branch(signals, start, stop, direction)
        if branch is not None and branch.displacement[-1] > 0.5 * slip:
            features.loadings.append(branch)
            features.loading_repeat.append(repeat)
    inertia = axis.value("transmission.gear_ratio") * total_inertia_of(axis)
    for window in steady_windows(signals, least_travel=SLIDING_TRAVEL * 2.0 * slip):
        speed, torque = window_means(signals, window, inertia)
        if speed * torque > 0.0:
            features.speed.append(speed)
            features.friction.append(torque)
            features.repeat.append(repeat)
    return features


def _branch(signals, start, stop, direction):
    """The branch after a reversal as first loading (Masing: half the displacement, half the force)."""
    # the turning point is where the angle was extreme, which the loop's lag puts after the reference's;
    # without the low-pass the extreme would be one of the noise
    margin = int(0.2 / signals.period)
    near = slice(max(start - margin, 0), min(stop + margin, len(signals.angle)))
    if near.stop - near.start < 3 * margin:
        return None
    edge = min(BRANCH_EDGE, 0.2 / signals.period)
    angle, torque = (low_pass(values[near], edge, signals.period) for values in (signals.angle, signals.torque))
    stop -= near.start
    turn = int(np.argmin(direction * angle[:stop]))
    if stop - turn < 50 or direction * torque[turn] >= 0.0:
        return None
    # at the turn the speed is none and the friction, for a moment, the static one
    displacement = 0.5 * direction * (angle[turn:stop] - angle[turn])
    force = 0.5 * direction * (torque[turn:stop] - torque[turn])
    # the low-pass rounds the peak of the force at the turn: nothing is said of the way covered in its time, and
    # force is counted from where the straight beginning of the branch meets no displacement
    speed = abs(np.polyfit(np.arange(len(displacement)) * signals.period, displacement, 1)[0])
    clear = np.maximum.accumulate(displacement) > speed / edge
    straight = clear & (force < STRAIGHT * force.max())
    if straight.sum() > 10:
        force = force - np.polyfit(displacement[straight], force[straight], 1)[1]
    # where a block lets go the motor jumps ahead, and friction falls with its speed: such rows are not of rest
    slow = np.gradient(displacement, signals.period) < JUMP * speed
    return loading_from_samples(displacement[clear & slow], force[clear & slow], 0.5 * signals.resolution)


def steady_series(signals, axis, travel_step, load=None):
    """Friction along steady sliding in cells of travel, for the variability.

    Parameters
    ----------
    travel_step : length of a cell [m]; well below the length that is looked for.
    load : torque at the motor of what else is driven [N m], shape (n,); taken off. None: nothing is driven.

    Returns
    -------
    ndarray, shape (n, 6): speed [rad/s], torque [N m], travel [m], time [s], position [m], 1 at a new run.
    Travel counts every movement of the record, in the windows and between them.
    """
    ratio = screw_ratio(axis)
    torque = signals.torque if load is None else signals.torque - load
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(signals.reference)))]) * ratio
    slip, rows = slip_displacement(axis), []
    for window in steady_windows(signals, least_travel=SLIDING_TRAVEL * 2.0 * slip):
        size = max(int(travel_step / (abs(window.speed) * ratio * signals.period)), 1)
        if size * signals.period > 2.0 or travel_step < abs(window.speed) * ratio * signals.period:
            continue
        for start in range(window.start, window.stop - size + 1, size):
            part = slice(start, start + size)
            rows.append((window.speed, float(np.mean(torque[part])), travel[start + size // 2],
                         (start + 0.5 * size) * signals.period, float(np.mean(signals.angle[part])) * ratio, 0.0))
    table = np.array(rows).reshape(-1, 6)
    if len(table):
        table[0, 5] = 1.0
    return table
