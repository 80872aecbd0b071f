"""Effects in analog position sensors: LVDT and capacitive.

Derived from the equations of `model.sensors.lvdt` and `model.sensors.capacitive`: one of their numbers changes.
"""

import numpy as np

from microstage_ros.model.effects.drawing import either_sign
from microstage_ros.model.effects.effect import Effect, Parameter
from microstage_ros.model.effects.resimulated import Fitted, one_size
from microstage_ros.model.sensors.capacitive import DRIFT as GAP_DRIFT
from microstage_ros.model.sensors.capacitive import Capacitive
from microstage_ros.model.sensors.lvdt import DRIFT as CORE_DRIFT
from microstage_ros.model.sensors.lvdt import NONLINEARITY, Lvdt

CORE = (lambda plant: plant["position_sensor"] == Lvdt.number, "an LVDT (sensors.encoder.type)")
ANALOG = (
    lambda plant: plant["position_sensor"] in (Lvdt.number, Capacitive.number),
    "an LVDT or a capacitive sensor (sensors.encoder.type)",
)


class LvdtNonlinearity(Effect):
    """The LVDT bends more than its file says: reading + change R (3√3/2)(ξ − ξ³), ξ = x/R."""

    id = "lvdt_nonlinearity"
    label = "The LVDT is less straight than its file says"
    remedy = "Calibrate the LVDT against a scale or an interferometer; check that its core is centred."
    separated_by = "stroke"
    needs = CORE
    sensors = ("lvdt",)
    parameters = {
        "change": Parameter("1", "largest further departure from the straight line, of the range", None, -0.1, 0.1)
    }

    @classmethod
    def draw(cls, generator, strength):
        return {"change": either_sign(generator, 1e-3 * strength, 3e-3 * strength)}

    @classmethod
    def apply(cls, plant, p):
        plant["sensor_parameters"][NONLINEARITY] += p["change"]

    @classmethod
    def resimulated(cls, axis, parts):
        return (
            one_size(
                cls,
                "cubic",
                Fitted("change", "1", 1e-4, -0.09, 0.09),
                "The LVDT departs by a further {:+.2%} of its range from a line.",
            ),
        )


class SensorDrift(Effect):
    """The zero of the position sensor drifts: reading + rate_m_s t."""

    id = "sensor_drift"
    label = "The position sensor's zero drifts"
    remedy = "Let sensor and electronics warm up; check the mounting and the temperature; zero the sensor again."
    separated_by = "dwell"
    shows_against = "time"
    needs = ANALOG
    sensors = ("lvdt", "capacitive")
    parameters = {"rate_m_s": Parameter("m/s", "rate of the drift", None, -1e-3, 1e-3)}

    @classmethod
    def draw(cls, generator, strength):
        return {"rate_m_s": either_sign(generator, 2e-8 * strength, 5e-8 * strength)}

    @classmethod
    def apply(cls, plant, p):
        place = CORE_DRIFT if plant["position_sensor"] == Lvdt.number else GAP_DRIFT
        plant["sensor_parameters"][place] += p["rate_m_s"]

    @classmethod
    def resimulated(cls, axis, parts):
        stroke = float(np.ptp(np.concatenate([part.position for part in parts])))
        step = max(1e-3 * stroke, 1e-10) / max(float(part.time[-1]) for part in parts)
        return (
            one_size(cls, "even", Fitted("rate_m_s", "m/s", step), "The sensor's zero drifts by {:.2g} m per second."),
        )


EFFECTS = (LvdtNonlinearity, SensorDrift)
