"""Effects in a piezo stack and its amplifier.

Derived from the equations of `model.actuators.piezo` (K. Kuhnen 2003): one of their numbers changes.
"""

from dataclasses import replace

from microstage_ros.model.actuators.piezo import COUNT, CREEP_COUNT, CREEPS, GAIN, PACE, PLAYS, WEIGHT, Piezo
from microstage_ros.model.effects.drawing import either_sign
from microstage_ros.model.effects.effect import Effect, Parameter
from microstage_ros.model.effects.resimulated import Fitted, one_size
from microstage_ros.quantities.errors import InputError

WITH_HYSTERESIS = (lambda plant: plant["drive"] == Piezo.number and plant["drive_parameters"][COUNT] > 0,
                   "a piezo drive whose file gives hysteresis (drive.type, drive.hysteresis_weight)")
STACK = (lambda plant: plant["drive"] == Piezo.number, "a piezo drive (drive.type)")


class PiezoHysteresis(Effect):
    """Hysteresis of the stack differs: all weights w_j × (1 + change)."""

    id = "piezo_hysteresis"
    label = "The piezo stack's hysteresis has changed"
    remedy = "Measure the loop anew (identify); a stack that is depolarised is poled again by cycles of full voltage."
    separated_by = "stroke"
    needs = WITH_HYSTERESIS
    drives = ("piezo",)
    parameters = {"change": Parameter("1", "relative change of all weights", None, -1.0, 10.0)}

    @classmethod
    def draw(cls, generator, strength):
        return {"change": either_sign(generator, 0.3 * strength, 0.6 * strength)}

    @classmethod
    def apply(cls, plant, p):
        plant["drive_parameters"][WEIGHT : WEIGHT + PLAYS] *= 1.0 + p["change"]

    @classmethod
    def resimulated(cls, axis, parts):
        if not axis.value("drive.hysteresis_weight"):
            return ()
        return (
            one_size(
                cls,
                "all weights scaled",
                Fitted("change", "1", 0.05, -1.0, 10.0),
                "The stack's hysteresis differs by {:+.0%}.",
            ),
        )


class PiezoCreep(Effect):
    """More (or less) creep: one further term, τ dc/dt = gain y − c, of the answer y to the voltage."""

    id = "piezo_creep"
    label = "The piezo stack creeps more than its file says"
    remedy = (
        "Wait after large steps, close the loop with more integral action, or identify the creep anew; a warm stack"
        " creeps more."
    )
    separated_by = "dwell"
    shows_against = "time"
    needs = STACK
    drives = ("piezo",)
    parameters = {
        "gain": Parameter("1", "creep in the end, over the voltage that it follows", None, -0.2, 0.5),
        "time_s": Parameter("s", "its time constant", 0.5, 1e-3, 1e4),
    }

    @classmethod
    def draw(cls, generator, strength):
        return {"gain": generator.uniform(0.02, 0.05) * strength, "time_s": float(generator.choice([0.3, 0.6, 1.0]))}

    @classmethod
    def apply(cls, plant, p):
        """One more term of creep; InputError if the drive's own take all places."""
        q = plant["drive_parameters"]
        count = int(q[CREEP_COUNT])
        if count >= CREEPS:
            raise InputError(f"effects: {cls.id}", count, f"a drive with fewer than {CREEPS} terms of creep of its own")
        q[CREEP_COUNT], q[GAIN + count] = count + 1, p["gain"]
        q[PACE + count] = min(float(plant["period"]) / p["time_s"], 1.0)

    @classmethod
    def resimulated(cls, axis, parts):
        if len(axis.value("drive.creep_gain")) >= CREEPS:
            return ()
        size, time = Fitted("gain", "1", 0.005, -0.2, 0.5), Fitted("time_s", "s", 0.05, 1e-2, 1e2)
        found = one_size(
            cls,
            "one further time constant",
            size,
            "The stack creeps by a further {:.1%} of what it is given.",
            shapes=(time,),
            grid=((0.1, 0.3, 1.0, 3.0),),
        )
        return (replace(found, effect=lambda p: {"gain": float(p[0]), "time_s": float(p[1])}),)


class PiezoGain(Effect):
    """Stroke per volt differs (temperature, depolarisation): d × (1 + change)."""

    id = "piezo_gain"
    label = "The piezo stack's stroke per volt has changed"
    remedy = "Identify the stroke anew; if it has fallen, pole the stack again or replace it."
    separated_by = "stroke"
    needs = STACK
    drives = ("piezo",)
    parameters = {"change": Parameter("1", "relative change of the stroke per volt", None, -0.9, 10.0)}

    @classmethod
    def draw(cls, generator, strength):
        return {"change": either_sign(generator, 0.08 * strength, 0.2 * strength)}

    @classmethod
    def apply(cls, plant, p):
        plant["torque_constant"] *= 1.0 + p["change"]

    @classmethod
    def resimulated(cls, axis, parts):
        return (
            one_size(
                cls, "gain", Fitted("change", "1", 0.02, -0.9, 10.0), "The stack's stroke per volt differs by {:+.1%}."
            ),
        )


EFFECTS = (PiezoHysteresis, PiezoCreep, PiezoGain)
