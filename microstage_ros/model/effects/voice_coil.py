"""Effects in a voice coil.

Derived from the equation of `model.actuators.voice_coil`: K to second order in x.
"""

from microstage_ros.model.actuators.voice_coil import VoiceCoil
from microstage_ros.model.effects.effect import Effect, Parameter
from microstage_ros.model.effects.resimulated import Fitted, one_size

COIL = (lambda plant: plant["drive"] == VoiceCoil.number, "a voice coil (drive.type)")


class ForceConstantDroop(Effect):
    """The force constant falls faster along the stroke than the file says: K(x) / K_0 less droop_1_m2 x²."""

    id = "force_constant_droop"
    label = "The voice coil's force constant falls along the stroke"
    remedy = "Centre the coil in its magnet; enter the measured force_constant_curvature in the axis file."
    separated_by = "stroke"
    needs = COIL
    drives = ("voice_coil",)
    parameters = {"droop_1_m2": Parameter("1/m^2", "fall of K over K_0, per square of the position", None, -1e6, 1e6)}

    @classmethod
    def draw(cls, generator, strength):
        return {"droop_1_m2": generator.uniform(1000.0, 2500.0) * strength}

    @classmethod
    def apply(cls, plant, p):
        plant["drive_parameters"][1] -= p["droop_1_m2"]
        plant["shaped"] = 1

    @classmethod
    def resimulated(cls, axis, parts):
        reach = max(float(abs(part.position).max()) for part in parts)
        size = 0.02 / reach**2
        return (
            one_size(
                cls,
                "with the square of the position",
                Fitted("droop_1_m2", "1/m^2", size, -25 * size, 25 * size),
                "The force constant falls by a further {:.3g} per square metre of its value in the middle.",
            ),
        )


EFFECTS = (ForceConstantDroop,)
