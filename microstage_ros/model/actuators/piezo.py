"""A piezo stack that pushes the stage against its flexure.

    x̄ = k_s d h / (k_s + k_f)   at rest;
    force = k_s (d h − x) on a stage with the flexure k_f, c_f (``stage.flexure_…``)
    h  = y + Σ_k c_k,            y = u + Σ_j w_j P_j[u],       τ_k dc_k/dt = g_k y − c_k

P_j: play operator of radius r_j, P_j u (t) = max(u − r_j, min(u + r_j, P_j before)), the rate-independent hysteresis
(Prandtl–Ishlinskii; K. Kuhnen, European Journal of Control 9, 2003); c_k: creep. Both are taken of the voltage held in
a period, before the amplifier's lag 1/(2πB). The command u is counted from the bias voltage, at which x = 0.
"""

import math

from microstage_ros.model.actuators.actuator import UNKNOWN_TOP_SPEED, Actuator, lever
from microstage_ros.numerics.compiled import internal
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec, not_negative, positive

PLAYS, CREEPS = 8, 4
SHARE = 0.25            # of the damping rate c_f/m that integral control may use
#: Places in ``plant.drive_parameters``: counts, radii, weights, creep gains, shares of the way per period.
COUNT, CREEP_COUNT, RADIUS, WEIGHT = 0, 1, 2, 2 + PLAYS
GAIN, PACE = 2 + 2 * PLAYS, 2 + 2 * PLAYS + CREEPS


@internal
def _hysteresis(plant, state, u):
    """Answer h [V] to a period of held command u; moves plays and creep to its end."""
    p, s = plant.drive_parameters, state.drive
    y = u
    for j in range(int(p[COUNT])):
        s[j] = max(u - p[RADIUS + j], min(u + p[RADIUS + j], s[j]))
        y += p[WEIGHT + j] * s[j]
    h = y
    for k in range(int(p[CREEP_COUNT])):
        before = s[PLAYS + k]
        s[PLAYS + k] += p[PACE + k] * (p[GAIN + k] * y - before)
        h += 0.5 * (before + s[PLAYS + k])
    return h


class Piezo(Actuator):
    """Piezo stack on a flexure: command [V], counted from the bias."""

    name = "piezo"
    transmissions = ("rigid",)
    measures_current = False
    holds_position = True
    # zero volts are a jump by up to the whole stroke; so is an amplifier that is switched off and discharges the stack
    holds_on_fault = True
    disables_on_fault = False
    estimation = "position"
    identified = ("drive.displacement_per_volt", "drive.hysteresis_weight", "drive.creep_gain")
    laws = ("none", "pid", "pid_feedforward")
    parameters = {
        "voltage_limit": positive("V", "amplifier output is clipped to ± this about its bias"),
        "dac_range": positive("V", "converter spans ± this, at the amplifier's output"),
        "dac_bits": Spec("1", 0, 32, "converter width; 0 means not quantised"),
        "noise": not_negative("V", "standard deviation of the amplifier's output, held over a period", default=1.0e-3),
        "bandwidth": positive("Hz", "bandwidth B of the amplifier on the stack"),
        "stack_stiffness": positive("N/m", "stiffness k_s of the stack"),
        "displacement_per_volt": positive("m/V", "free stroke d per volt at small amplitude"),
        "hysteresis_radius": not_negative("V", "radii r_j of the play operators", default=[], is_list=True),
        "hysteresis_weight": not_negative("1", "their weights w_j", default=[], is_list=True),
        "creep_gain": not_negative("1", "gains g_k of creep", default=[], is_list=True),
        "creep_time": positive("s", "its time constants τ_k", default=[], is_list=True),
    }
    shape = _hysteresis

    @classmethod
    def check(cls, axis):
        """Lists of one length, no longer than the record holds.

        Raises InputError: lists of unequal length, or longer than the plant's record holds.
        """
        super().check(axis)
        for one, other, most in (("hysteresis_radius", "hysteresis_weight", PLAYS),
                                 ("creep_gain", "creep_time", CREEPS)):
            count = len(axis.value(f"drive.{one}"))
            if count != len(axis.value(f"drive.{other}")) or count > most:
                raise InputError(f"{axis.place}: drive.{other}", len(axis.value(f"drive.{other}")),
                                 f"as many numbers as {one} has ({count}), at most {most}")

    @classmethod
    def fill(cls, plant, axis):
        """I stands for the amplifier's voltage: L = 1/2πB, R = b = 1, k_M = k_s d.

        The stack's stiffness beside the flexure's.
        """
        stiffness = axis.value("drive.stack_stiffness")
        plant["inductance"], plant["resistance"] = 1.0 / (2 * math.pi * axis.value("drive.bandwidth")), 1.0
        plant["electrical_input"] = 1.0
        plant["torque_constant"] = stiffness * axis.value("drive.displacement_per_volt") * plant["ratio"]
        plant["flexure"] += stiffness
        p = plant["drive_parameters"]
        radius, weight, gain, time = (axis.value(f"drive.{key}") for key in (
            "hysteresis_radius", "hysteresis_weight", "creep_gain", "creep_time"))
        p[COUNT], p[CREEP_COUNT] = len(radius), len(gain)
        p[RADIUS : RADIUS + len(radius)], p[WEIGHT : WEIGHT + len(weight)] = radius, weight
        p[GAIN : GAIN + len(gain)] = gain
        p[PACE : PACE + len(time)] = [-math.expm1(-float(plant["period"]) / t) for t in time]

    @classmethod
    def start(cls, plant, state):
        """Held at rest where it stands, on the curve of first loading, with the creep that belongs to it settled."""
        p, x = plant["drive_parameters"], float(state["x"])
        held = float(plant["flexure"] * x * plant["ratio"] / plant["torque_constant"])
        settled = 1.0 + float(sum(p[GAIN : GAIN + int(p[CREEP_COUNT])]))

        def first_loading(u):
            plays = [max(u - r, min(u + r, 0.0)) for r in p[RADIUS : RADIUS + int(p[COUNT])]]
            return plays, u + sum(w * play for w, play in zip(p[WEIGHT:], plays))

        low, high = -abs(held) - 1e-12, abs(held) + 1e-12
        for _ in range(80):        # y(u) rises at least as fast as u
            middle = 0.5 * (low + high)
            low, high = (middle, high) if first_loading(middle)[1] * settled < held else (low, middle)
        plays, y = first_loading(0.5 * (low + high))
        state["drive"][: len(plays)] = plays
        for k in range(int(p[CREEP_COUNT])):
            state["drive"][PLAYS + k] = p[GAIN + k] * y
        state["current"], state["voltage"] = held, held

    @classmethod
    def feed_forward(cls, axis):
        """Volts for a position, half of the hysteresis counted."""
        stack, flexure = axis.value("drive.stack_stiffness"), axis.value("stage.flexure_stiffness")
        wide = 1.0 + 0.5 * sum(axis.value("drive.hysteresis_weight"))
        _, _, ratio = lever(axis)
        return {
            "volts_per_position": (stack + flexure) / (stack * axis.value("drive.displacement_per_volt") * wide),
            "force_per_torque": 1.0 / ratio, "moving_mass": axis.value("stage.mass"), "top_speed": UNKNOWN_TOP_SPEED,
            "integral_rate": SHARE * axis.value("stage.flexure_damping") / axis.value("stage.mass"),
        }
