"""A sine/cosine encoder: two signals per period p of the scale, digitised, and the angle between them taken.

    s = o_s + (1 + g) sin(φ + δ) + n_s,   c = o_c + cos φ + n_c,   φ = 2π x/p,   reading = p/(2π) · (atan2(s, c) + 2π k)

To first order the interpolation error is p/(2π) [o_s cos φ − o_c sin φ + (g/2) sin 2φ + (δ/2)(1 + cos 2φ)]: offsets
make one cycle per signal period, amplitude and phase two (P. L. M. Heydemann, Applied Optics 20, 1981). The periods k
are counted without error.
"""

import math

import numpy as np

from microstage_ros.model.sensors.position import PositionSensor
from microstage_ros.numerics.compiled import internal
from microstage_ros.numerics.random import normal
from microstage_ros.quantities.spec import Spec, any_number, not_negative

SPAN = 1.25             # full scale of the converters, in amplitudes of the signals


@internal
def _read(plant, state, y):
    """Reading [m] at position ``y`` [m]."""
    p = plant.sensor_parameters
    phase = plant.signal_number * y
    s, c = p[0] + (1.0 + p[2]) * math.sin(phase + p[3]), p[1] + math.cos(phase)
    if p[4] > 0.0:
        s += p[4] * normal(state.random)
        c += p[4] * normal(state.random)
    if p[5] > 0.0:
        s, c = p[5] * np.rint(s / p[5]), p[5] * np.rint(c / p[5])
    angle = math.atan2(s, c)
    return (angle + 2.0 * math.pi * np.rint((phase - angle) / (2.0 * math.pi))) / plant.signal_number


class SineCosine(PositionSensor):
    """Sine/cosine encoder with the errors of its two signals."""

    name = "sine_cosine"
    parameters = {
        "offset_sine": any_number("1", "offset o_s of the sine signal, of its amplitude", default=0.0),
        "offset_cosine": any_number("1", "offset o_c of the cosine signal, of its amplitude", default=0.0),
        "amplitude_error": Spec("1", -0.9, 10.0, "g: amplitude of the sine over that of the cosine, less 1",
                                default=0.0),
        "phase_error": Spec("rad", -1.0, 1.0, "δ: how much the signals differ from a quarter period", default=0.0),
        "signal_noise": not_negative("1", "standard deviation of each signal, of its amplitude", default=0.0),
        "bits": Spec("1", 0, 32, "width of each converter over ± 1.25 amplitudes; 0 means not quantised", default=0),
    }
    read = _read

    @classmethod
    def fill(cls, plant, axis):
        """The errors of both signals, their noise, the converters' step."""
        names = ("offset_sine", "offset_cosine", "amplitude_error", "phase_error", "signal_noise")
        plant["sensor_parameters"][:5] = [axis.value(f"sensors.encoder.{name}") for name in names]
        bits = axis.value("sensors.encoder.bits")
        plant["sensor_parameters"][5] = 2.0 * SPAN / 2.0**bits if bits else 0.0
