"""What a controller's number means, where it may lie, and the refusal of one that does not.

Every law lists its numbers as `Gain` entries; the same list makes the numpy record that the compiled
law reads, checks what a user gives, and can be printed as documentation.
"""

from typing import NamedTuple

import numpy as np

from microstage_ros.quantities.spec import Spec


class Gain(NamedTuple):
    """One number of a control law.

    Attributes
    ----------
    name : word used in axis files, run files and ROS parameters.
    unit : SI unit.
    minimum, maximum : closed range of accepted values.
    default : value when neither the caller nor the axis file gives one.
    meaning : one line for people.
    """

    name: str
    unit: str
    minimum: float
    maximum: float
    default: float
    meaning: str


def record_type(gains, more=()):
    """Numpy structured type of one float field for each of ``gains``, a `Gain`, then the fields of ``more``."""
    return np.dtype([(gain.name, "f8") for gain in gains] + list(more))


def check_gain(place, gain, value):
    """The ``value`` as a float, in the unit of the `Gain`; `InputError` (place, value, range, unit) out of range."""
    return Spec(gain.unit, gain.minimum, gain.maximum, gain.meaning).check(value, f"{place}.{gain.name}")


def fill(record, gains, values, place):
    """Write checked values, or the defaults, into the record; returns the names it used.

    ``gains``: each a `Gain`; ``values``: {name: number in the unit of its `Gain`}.
    """
    for gain in gains:
        record[gain.name] = check_gain(place, gain, values.get(gain.name, gain.default))
    return {gain.name for gain in gains}
