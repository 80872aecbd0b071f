"""What a position sensor is: its parameters, and how it turns the true position into a reading.

Derived: `first_order` is τ ds/dt = y(t) − s solved for an input that is a straight line over a period.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from microstage_ros.numerics.compiled import inlined_before_typing
from microstage_ros.quantities.spec import Spec

STARTED, BEFORE, FILTERED = 13, 14, 15
"""Places in ``state.sensor``: whether the filter has begun, the position and the filter's output a period before."""


class PositionSensor:
    """Base of the position sensors; a subclass is one file of `model.sensors` and one line of its registry.

    Attributes
    ----------
    name : word in axis files (``sensors.encoder.type``). number : its place in the registry, set there.
    parameters : {key below ``sensors.encoder``: `Spec`}, beside ``resolution`` and ``noise``, which all have.
    read : compiled function (plant, state, y) -> reading [m] of the position y [m]; noise and rounding included.
    """

    name = ""
    number = 0
    parameters: dict[str, Spec] = {}
    read: Callable | None = None

    @classmethod
    def fill(cls, plant, axis):
        """Write the sensor's numbers into ``plant['sensor_parameters']``."""


@inlined_before_typing
def first_order(state, y, fade, share):
    """Output of a first-order filter whose input went straight from the value a period before to ``y``.

    s = y − τ m + (s₀ − y₀ + τ m) e, with slope m, e = exp(−T/τ) (``fade``), τ/T (``share``); no filter: both zero.
    """
    if state.sensor[STARTED] == 0.0:
        state.sensor[STARTED], state.sensor[BEFORE], state.sensor[FILTERED] = 1.0, y, y
    slope = share * (y - state.sensor[BEFORE])
    filtered = y - slope + fade * (state.sensor[FILTERED] - state.sensor[BEFORE] + slope)
    state.sensor[BEFORE], state.sensor[FILTERED] = y, filtered
    return filtered


def filter_weights(period, bandwidth):
    """(exp(−T/τ), τ/T) [1] for `first_order`, τ = 1/(2π bandwidth); zeros for a bandwidth of 0, which means no filter.

    ``period`` T [s], ``bandwidth`` [Hz].
    """
    if not bandwidth > 0.0:
        return 0.0, 0.0
    tau = 1.0 / (2.0 * math.pi * bandwidth)
    return math.exp(-period / tau), tau / period
