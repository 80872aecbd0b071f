"""A capacitive gap sensor whose electronics take the gap from the reciprocal of the capacitance.

    d = d_0 − x,    C/C_0 = (d_0/d) t(a) + κ,    reading = d_0 − d_0 (1 + κ) C_0/C,
    t = 2 (1 − √(1 − a²))/a²,    a = α ϱ/d

d_0: gap at x = 0; κ: stray capacitance over C_0; α: tilt between the plates, ϱ: radius of the sensing plate. Without
stray capacitance and tilt the reading is x; with κ it is d (1 + κ)/(1 + κ d/d_0), bent and of smaller slope.

Derived: C = ε ∫ dA / gap over a disc of radius ϱ whose gap changes by α per length, 2 π ε (d − √(d² − α² ϱ²)) / α²;
C_0 = ε π ϱ² / d_0.
"""

import math

import numpy as np

from microstage_ros.model.sensors.position import PositionSensor, filter_weights, first_order
from microstage_ros.numerics.compiled import internal
from microstage_ros.numerics.random import normal
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec, any_number, not_negative, positive

DRIFT = 7               # place in ``plant.sensor_parameters``


@internal
def _read(plant, state, y):
    """Reading [m] at position ``y`` [m]."""
    p = plant.sensor_parameters
    gap = max(p[0] - y, 1e-3 * p[0])
    a2 = min((p[6] / gap) ** 2, 1.0)
    tilted = 2.0 * (1.0 - math.sqrt(1.0 - a2)) / a2 if a2 > 1e-6 else 1.0 + 0.25 * a2
    y = p[0] - p[0] * (1.0 + p[1]) / (p[0] / gap * tilted + p[1])
    y = first_order(state, y, p[2], p[3]) + p[DRIFT] * state.time
    if plant.encoder_noise > 0.0:
        y += plant.encoder_noise * normal(state.random)
    if p[5] > 0.0:
        y = p[5] * np.rint(y / p[5])
    return min(max(y, -p[4]), p[4])


class Capacitive(PositionSensor):
    """Capacitive sensor: gap, stray capacitance, tilt, bandwidth."""

    name = "capacitive"
    parameters = {
        "gap": positive("m", "gap d_0 at x = 0; it closes with growing x"),
        "range": positive("m", "readings are clipped to ± this, less than the gap"),
        "stray": not_negative("1", "stray capacitance κ over the capacitance at the gap d_0", default=0.0),
        "tilt": Spec("rad", 0.0, 0.1, "tilt α between the plates", default=0.0),
        "radius": not_negative("m", "radius ϱ of the sensing plate", default=0.0),
        "bandwidth": not_negative("Hz", "bandwidth of the electronics; 0 means no filter", default=0.0),
        "drift": any_number("m/s", "drift of the zero", default=0.0),
        "bits": Spec("1", 0, 32, "converter width over ± range; 0 means not quantised", default=0),
    }
    read = _read

    @classmethod
    def fill(cls, plant, axis):
        """Gap, stray, filter, range, converter step, tilt times radius.

        Raises InputError: a range in which the plates would touch.
        """
        gap, span, stray, tilt, radius, band, drift, bits = (axis.value(f"sensors.encoder.{key}") for key in (
            "gap", "range", "stray", "tilt", "radius", "bandwidth", "drift", "bits"))
        if not tilt * radius + span < gap:
            raise InputError(f"{axis.place}: sensors.encoder.range", span,
                             f"less than gap − tilt · radius = {gap - tilt * radius:g} m: the plates would touch")
        step = 2.0 * span / 2.0**bits if bits else 0.0
        numbers = gap, stray, *filter_weights(float(plant["period"]), band), span, step, tilt * radius, drift
        plant["sensor_parameters"][: len(numbers)] = numbers
