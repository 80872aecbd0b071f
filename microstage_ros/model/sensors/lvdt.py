"""A linear variable differential transformer with its demodulator.

    reading = filter[ x + n R (3√3/2) (ξ − ξ³) ] + d t + noise,    ξ = x/R, |reading| ≤ R

R: range; n: nonlinearity, the largest departure from the straight line through zero and both ends, over R; the filter
is the demodulator's first-order lag 1/(2πB); d: drift of the zero. The converter spans ± R.

Derived: the cubic is the lowest odd error that vanishes at zero and at both ends; its largest value, at ξ = 1/√3, is
2/(3√3), which the factor makes one.
"""

import math

import numpy as np

from microstage_ros.model.sensors.position import PositionSensor, filter_weights, first_order
from microstage_ros.numerics.compiled import internal
from microstage_ros.numerics.random import normal
from microstage_ros.quantities.spec import Spec, any_number, not_negative, positive

NONLINEARITY, DRIFT = 1, 4        # places in ``plant.sensor_parameters``
PEAK = 1.5 * math.sqrt(3.0)     # of 1/(ξ − ξ³)


@internal
def _read(plant, state, y):
    """Reading [m] at position ``y`` [m]."""
    p = plant.sensor_parameters
    part = min(max(y / p[0], -1.0), 1.0)
    y = first_order(state, y + p[1] * p[0] * PEAK * (part - part**3), p[2], p[3]) + p[4] * state.time
    if plant.encoder_noise > 0.0:
        y += plant.encoder_noise * normal(state.random)
    if p[5] > 0.0:
        y = p[5] * np.rint(y / p[5])
    return min(max(y, -p[0]), p[0])


class Lvdt(PositionSensor):
    """LVDT: range, nonlinearity, bandwidth, drift."""

    name = "lvdt"
    parameters = {
        "range": positive("m", "R: readings are clipped to ± this"),
        "nonlinearity": Spec("1", -0.1, 0.1, "n: largest departure from a straight line, of the range", default=0.0),
        "bandwidth": not_negative("Hz", "bandwidth B of the demodulator; 0 means no filter", default=0.0),
        "drift": any_number("m/s", "drift d of the zero", default=0.0),
        "bits": Spec("1", 0, 32, "converter width over ± range; 0 means not quantised", default=0),
    }
    read = _read

    @classmethod
    def fill(cls, plant, axis):
        """Range, nonlinearity, filter, drift, converter step."""
        span, bent, band, drift, bits = (axis.value(f"sensors.encoder.{key}") for key in (
            "range", "nonlinearity", "bandwidth", "drift", "bits"))
        step = 2.0 * span / 2.0**bits if bits else 0.0
        plant["sensor_parameters"][:6] = span, bent, *filter_weights(float(plant["period"]), band), drift, step
