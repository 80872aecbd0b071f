"""Effects in a stepper motor and its driver.

Source: P. Acarnley, Stepping Motors, IET 2002; the equations are those of `model.actuators.stepper`.
"""

from dataclasses import replace

import numpy as np

from microstage_ros.model.actuators.stepper import DETENT, LOST, LOST_AT, LOST_WITHIN, MICROSTEP, POLES, Stepper
from microstage_ros.model.effects.drawing import either_sign
from microstage_ros.model.effects.effect import Effect, Parameter
from microstage_ros.model.effects.resimulated import Fitted, one_size

FIELD = (lambda plant: plant["drive"] == Stepper.number, "a stepper (drive.type)")
LOSING_RATE = (
    500.0  # full steps lost per second while pulses are missing: slow enough for the rotor to follow the field
)
WINDOW_S = 0.05         # means before and behind a possible loss are taken over so long


class LostSteps(Effect):
    """The driver loses pulses: from time_s on 500 full steps per second, until the field is ``steps`` short."""

    id = "lost_steps"
    label = "The stepper has lost steps"
    remedy = "Check the load, the speed and the pulse lines; home the axis again."
    separated_by = "speed"
    shows_against = "time"
    needs = FIELD
    drives = ("stepper",)
    parameters = {
        "steps": Parameter("1", "full steps lost, with their direction", None, -1e4, 1e4),
        "time_s": Parameter("s", "when, from the start of the record", 0.0, 0.0, 1e6),
    }

    @classmethod
    def draw(cls, generator, strength):
        return {"steps": either_sign(generator, 2.0 * strength, 8.0 * strength), "time_s": generator.uniform(0.3, 0.6)}

    @classmethod
    def apply(cls, plant, p):
        q = plant["drive_parameters"]
        full = 2.0 * np.pi / (4.0 * q[POLES])
        q[LOST], q[LOST_AT] = round(p["steps"] * full / q[MICROSTEP]), p["time_s"]
        q[LOST_WITHIN] = max(abs(p["steps"]) / LOSING_RATE, 1e-9)

    @classmethod
    def resimulated(cls, axis, parts):
        """The moment is that of the largest jump of the command against the position; the steps are fitted."""
        period, (rows, lag) = axis.value("period"), _lag(axis, parts[0])
        width = max(int(WINDOW_S / period), 2)
        if rows < 4 * width:
            return ()
        total = np.concatenate([[0.0], np.cumsum(lag)])
        means = (total[width:] - total[:-width]) / width
        jump = np.abs(means[width:] - means[:-width])
        moment = float((np.argmax(jump) + width) * period)
        found = one_size(
            cls,
            "at one moment",
            Fitted("steps", "1", 1.0, -1e4, 1e4),
            f"{{:+.1f}} full steps were lost at {moment:.3g} s.",
        )
        return (replace(found, effect=lambda p: {"steps": float(p[0]), "time_s": moment}),)


class DetentTorqueChange(Effect):
    """More detent torque (or uneven microsteps, which look alike): T_D + extra_Nm, four periods per electrical turn."""

    id = "detent_torque"
    label = "The stepper's microsteps are uneven"
    remedy = (
        "Check that the driver gives both windings their full, equal current; its tables of microsteps may be"
        " corrected."
    )
    separated_by = "stroke"
    needs = FIELD
    drives = ("stepper",)
    parameters = {"extra_Nm": Parameter("N m", "detent torque beyond that of the file", None, -1.0, 1.0)}

    @classmethod
    def draw(cls, generator, strength):
        return {"extra_Nm": generator.uniform(0.1, 0.2) * strength}

    @classmethod
    def apply(cls, plant, p):
        plant["drive_parameters"][DETENT] += p["extra_Nm"]

    @classmethod
    def resimulated(cls, axis, parts):
        size = 0.05 * axis.value("drive.holding_torque")
        bound = 0.5 * axis.value("drive.holding_torque")
        return (one_size(cls, "four periods per electrical turn", Fitted("extra_Nm", "N m", size, -bound, bound),
                         "The detent torque differs by {:+.2g} N m."),)


def _lag(axis, part):
    """(rows, command less the angle that the position reading stands for [rad])."""
    ratio = axis.value("transmission.pitch") / (2.0 * np.pi * axis.value("transmission.gear_ratio"))
    return len(part), part.force - part.position / ratio


EFFECTS = (LostSteps, DetentTorqueChange)
