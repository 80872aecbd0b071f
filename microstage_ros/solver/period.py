"""One control period called from Python, quickly.

Numba takes a record (numpy.void) apart through its buffer, whose format text is made anew at every call:
75 µs for a plant. An array of one record costs 0.2 µs.
"""

import numpy as np

from microstage_ros.model.sensors.readings import read_sensors
from microstage_ros.numerics.compiled import compiled
from microstage_ros.solver.step import advance, note_friction


def as_array(record):
    """A record as an array of shape (1,), sharing its memory."""
    return np.ndarray((1,), record.dtype, record)


@compiled
def read(plants, states, readings):
    """`read_sensors` and `note_friction` of the only record of each array."""
    read_sensors(plants[0], states[0], readings[0])
    note_friction(plants[0], states[0])


@compiled
def advance_and_read(plants, states, works, readings, voltage):
    """`advance` by one period with ``voltage`` [V], then `read_sensors`, of the only record of each array."""
    advance(plants[0], states[0], works[0], voltage)
    read_sensors(plants[0], states[0], readings[0])
    note_friction(plants[0], states[0])
