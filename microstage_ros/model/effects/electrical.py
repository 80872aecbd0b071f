"""Effects between the voltage command and the motor current.

Derived: by definition of offset, dead zone, gain, delay and first-order lag; `ResistanceRise` is the heat balance of a
winding of one thermal mass with Joule heat R i², its resistance linear in temperature.
"""

from microstage_ros.model.effects.drawing import either_sign
from microstage_ros.model.effects.effect import MOTOR, Effect, Parameter


class AmplifierOffset(Effect):
    """Zero error of the amplifier: u + offset_V."""

    id = "amplifier_offset"
    label = "The amplifier is off zero"
    remedy = "Trim the amplifier's offset."
    separated_by = "rest"
    shows_against = "time"
    within = ("generic:voltage",)
    parameters = {"offset_V": Parameter("V", "offset at the amplifier's input", None, -10.0, 10.0)}

    @classmethod
    def draw(cls, generator, strength):
        return {"offset_V": either_sign(generator, 0.015 * strength, 0.05 * strength)}

    @classmethod
    def apply(cls, plant, p):
        plant["amplifier_offset"] = p["offset_V"]


class AmplifierDeadband(Effect):
    """Crossover dead zone: u → sgn(u) max(|u| − half_width_V, 0)."""

    id = "amplifier_deadband"
    label = "The amplifier has a dead zone"
    remedy = "Trim the crossover of the output stage, or compensate it by command."
    separated_by = "rest"
    shows_against = "time"
    within = ("generic:voltage",)
    parameters = {"half_width_V": Parameter("V", "half the width of the dead zone", None, 0.0, 5.0)}

    @classmethod
    def draw(cls, generator, strength):
        return {"half_width_V": generator.uniform(0.01, 0.05) * strength}

    @classmethod
    def apply(cls, plant, p):
        plant["dead_half"] = p["half_width_V"]


class AmplifierGain(Effect):
    """Gain differs from the nominal: u × factor."""

    id = "amplifier_gain"
    label = "The amplifier's gain differs"
    remedy = "Measure the gain and enter it in the axis file."
    separated_by = "speed"
    shows_against = "time"
    within = ("generic:voltage",)
    parameters = {"factor": Parameter("1", "gain over nominal gain", None, 0.01, 100.0)}

    @classmethod
    def draw(cls, generator, strength):
        return {"factor": 1.0 + either_sign(generator, 0.05 * strength, 0.15 * strength)}

    @classmethod
    def apply(cls, plant, p):
        plant["gain"] *= p["factor"]


class ResistanceRise(Effect):
    """Winding warms up: R (1 + h), dh/dt = rise_per_joule R i² − h / time_s, h(0) = initial."""

    id = "resistance_rise"
    label = "The winding warms up"
    remedy = "Let the motor cool or lower the duty; let the observer follow the resistance."
    separated_by = "dwell"
    shows_against = "time"
    within = ("generic:voltage",)
    needs = MOTOR
    parameters = {
        "rise_per_joule": Parameter("1/J", "relative rise per joule of heat", 0.0, 0.0, 100.0),
        "time_s": Parameter("s", "cooling time constant", 20.0, 1e-2, 1e5),
        "initial": Parameter("1", "relative rise at the start of the record", 0.0, -0.5, 2.0),
    }

    @classmethod
    def draw(cls, generator, strength):
        return {"rise_per_joule": generator.uniform(0.05, 0.2) * strength, "time_s": generator.uniform(5.0, 30.0)}

    @classmethod
    def apply(cls, plant, p):
        plant["rise_per_joule"], plant["rise_time"], plant["rise_initial"] = (
            p["rise_per_joule"],
            p["time_s"],
            p["initial"],
        )
        plant["electrical"] = 1


class TransportDelay(Effect):
    """Command arrives late: u(t − delay_s), whole periods and fractions."""

    id = "transport_delay"
    label = "The command arrives late"
    remedy = "Check the controller's timing and the bus; lower the gains or add prediction."
    separated_by = "frequency"
    shows_against = "position"
    parameters = {"delay_s": Parameter("s", "delay", None, 0.0, 60 * 1e-4)}

    @classmethod
    def draw(cls, generator, strength):
        return {"delay_s": generator.uniform(1.5e-4, 5e-4) * strength}

    @classmethod
    def apply(cls, plant, p):
        plant["delay"] = p["delay_s"]
        plant["electrical"] = 1


class ActuatorLag(Effect):
    """Amplifier or current loop follows late: time_s du_a/dt = u − u_a."""

    id = "actuator_lag"
    label = "The amplifier follows with a lag"
    remedy = "Check the current loop's tuning; account for the lag in the controller."
    separated_by = "frequency"
    shows_against = "position"
    parameters = {"time_s": Parameter("s", "time constant", None, 0.0, 1.0)}

    @classmethod
    def draw(cls, generator, strength):
        return {"time_s": generator.uniform(1.5e-4, 6e-4) * strength}

    @classmethod
    def apply(cls, plant, p):
        plant["actuator_lag"] = p["time_s"]
        plant["electrical"] = 1


EFFECTS = (AmplifierOffset, AmplifierDeadband, AmplifierGain, ResistanceRise, TransportDelay, ActuatorLag)
