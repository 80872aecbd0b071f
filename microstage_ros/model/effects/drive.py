"""Effects in the drive train and in the forces on the stage.

Sources: backlash as a dead zone of the compliant drive train: M. Nordin, P.-O. Gutman, Automatica 38 (2002); the other
equations are derived: definitions of stiffness, lead and load, ripple as a Fourier series of the angle, friction in
proportion to the load (Amontons), m g sin of the tilt.
"""

import math

import numpy as np

from microstage_ros.model.effects.drawing import either_sign
from microstage_ros.model.effects.effect import DRIVE_TRAIN, Effect, Parameter, same_length, write_terms
from microstage_ros.model.effects.friction import scale_friction
from microstage_ros.model.plant_record import RIPPLES

GRAVITY = 9.80665   # m/s², standard


class Backlash(Effect):
    """Lost motion in the gearhead, b = r · width_rad of travel.

    With d = r φ − x: F_c = K_c (d − sgn(d) b/2) + D_c ḋ where |d| > b/2, else 0.
    """

    id = "backlash"
    label = "Lost motion at reversal"
    remedy = "Check gearhead, coupling and nut preload; approach targets from one side until it is mended."
    separated_by = "frequency"
    shows_against = "time"
    within = ("generic:voltage",)
    needs = DRIVE_TRAIN
    parameters = {"width_rad": Parameter("rad", "width at the screw", None, 0.0, 1.0)}

    @classmethod
    def draw(cls, generator, strength):
        return {"width_rad": generator.uniform(0.006, 0.03) * strength}

    @classmethod
    def apply(cls, plant, p):
        plant["gap"] = plant["screw_ratio"] * p["width_rad"]


class DriveCompliance(Effect):
    """Softer or resonant drive train: K_c × stiffness_factor, D_c × damping_factor."""

    id = "drive_compliance"
    label = "The drive train is softer than assumed"
    remedy = "Check coupling clamps and bearing preload; lower the gains until then."
    separated_by = "frequency"
    shows_against = "time"
    needs = DRIVE_TRAIN
    parameters = {
        "stiffness_factor": Parameter("1", "factor on the stiffness", None, 1e-3, 1e3),
        "damping_factor": Parameter("1", "factor on the damping", 1.0, 0.0, 1e3),
    }

    @classmethod
    def draw(cls, generator, strength):
        return {"stiffness_factor": 1.0 / (1.0 + generator.uniform(4.0, 30.0) * strength),
                "damping_factor": float(np.exp(generator.uniform(-0.7, 0.7)))}

    @classmethod
    def apply(cls, plant, p):
        plant["stiffness"] *= p["stiffness_factor"]
        plant["damping"] *= p["damping_factor"]


class ScrewPitchError(Effect):
    """Error of the lead: r φ → r φ (1 + cumulative) + Σ amplitude_m_n sin(n φ + phase_rad_n), n per screw turn."""

    id = "screw_pitch_error"
    label = "The lead of the screw is not even"
    remedy = "Enter the error in a compensation table, or replace the screw."
    separated_by = "stroke"
    shows_against = "position"
    within = ("generic:voltage",)
    needs = DRIVE_TRAIN
    parameters = {
        "amplitude_m": Parameter("m", "amplitude of each term", 0.0, -1e-3, 1e-3),
        "cycles_per_turn": Parameter("1", "cycles of each term per screw turn", 1.0, 0.01, 100.0),
        "phase_rad": Parameter("rad", "phase of each term", 0.0),
        "cumulative": Parameter("1", "relative error of the lead", 0.0, -0.05, 0.05),
    }

    @classmethod
    def check_together(cls, checked, place):
        same_length(checked, ["amplitude_m", "cycles_per_turn", "phase_rad"], place)

    @classmethod
    def draw(cls, generator, strength):
        return {"amplitude_m": generator.uniform(1e-6, 4e-6) * strength, "phase_rad": generator.uniform(0, 6.28)}

    @classmethod
    def apply(cls, plant, p):
        write_terms(plant, ["lead_amplitude", "lead_number", "lead_phase"], "leads",
                    [p["amplitude_m"], p["cycles_per_turn"], p["phase_rad"]], RIPPLES, cls.id)
        plant["lead_slope"] = p["cumulative"]
        plant["smooth"] = 1
        plant["base_level"] = max(plant["base_level"], 2)


class TorqueRipple(Effect):
    """Cogging, commutation, gear mesh: extra motor torque Σ amplitude_Nm_n sin(cycles_n θ + phase_rad_n).

    On an axis without a motor angle θ is the angle of the (unit) transmission, and the torque a force.
    """

    id = "torque_ripple"
    label = "The drive's force ripples with its turn"
    remedy = "Check commutation and the coupling's alignment; compensate by angle."
    separated_by = "stroke"
    shows_against = "motor turns"
    parameters = {
        "amplitude_Nm": Parameter("N m", "amplitude of each term", None, -10.0, 10.0),
        "cycles_per_turn": Parameter("1", "cycles of each term per motor turn", 1.0, 1e-3, 1e4),
        "phase_rad": Parameter("rad", "phase of each term", 0.0),
    }

    @classmethod
    def check_together(cls, checked, place):
        same_length(checked, ["amplitude_Nm", "cycles_per_turn", "phase_rad"], place)

    @classmethod
    def draw(cls, generator, strength):
        """One to three terms, whole or half cycles per turn, the first the largest."""
        count = int(generator.integers(1, 4))
        cycles = generator.choice(np.concatenate([np.arange(1, 13), [0.5, 1.5, 2.5, 14, 16, 18, 24]]), count,
                                  replace=False)
        sizes = generator.uniform(8e-6, 3e-5) * strength * np.array([1.0, 0.5, 0.3])[:count]
        return {"amplitude_Nm": sizes.tolist(), "cycles_per_turn": cycles.tolist(),
                "phase_rad": generator.uniform(0, 6.28, count).tolist()}

    @classmethod
    def apply(cls, plant, p):
        write_terms(plant, ["cog_amplitude", "cog_number", "cog_phase"], "cogs",
                    [p["amplitude_Nm"], p["cycles_per_turn"], p["phase_rad"]], RIPPLES, cls.id)
        plant["smooth"] = 1
        plant["base_level"] = max(plant["base_level"], 2)


class PayloadChange(Effect):
    """Other mass on the stage: m + mass_kg; guideway friction grows with the load, × (1 + mass_kg/m)."""

    id = "payload_change"
    label = "Another mass sits on the stage"
    remedy = "Enter the mass in the axis file, or take the load off."
    separated_by = "speed"
    shows_against = "velocity"
    within = ("generic:velocity",)
    parameters = {"mass_kg": Parameter("kg", "mass added", None, -100.0, 1e4)}

    @classmethod
    def draw(cls, generator, strength):
        return {"mass_kg": generator.uniform(2.0, 6.0) * strength}

    @classmethod
    def apply(cls, plant, p):
        scale_friction(plant["guideway"], max(1.0 + p["mass_kg"] / float(plant["mass"]), 0.05))
        plant["mass"] = max(plant["mass"] + p["mass_kg"], 0.05 * plant["mass"])


class GravityTilt(Effect):
    """The axis is not level: constant force −m g sin(angle_rad) on the stage, not on the rotating parts."""

    id = "gravity_tilt"
    label = "The axis is not level"
    remedy = "Level the machine, or feed the constant force forward."
    separated_by = "rest"
    shows_against = "position"
    within = ("generic:position",)
    contained_in = ("cable_spring",)
    parameters = {"angle_rad": Parameter("rad", "tilt, positive where +x is uphill", None, -math.pi / 2, math.pi / 2)}

    @classmethod
    def draw(cls, generator, strength):
        return {"angle_rad": either_sign(generator, 0.03 * strength, 0.12 * strength)}

    @classmethod
    def apply(cls, plant, p):
        plant["push"] -= plant["mass"] * GRAVITY * math.sin(p["angle_rad"])


class CableSpring(Effect):
    """Cable drag or gauging force: −stiffness_N_m (x − anchor_m) on the stage."""

    id = "cable_spring"
    label = "A cable or a gauge pulls on the stage"
    remedy = "Re-route the cable; feed the force forward if it must stay."
    separated_by = "stroke"
    shows_against = "position"
    within = ("generic:position",)
    parameters = {
        "stiffness_N_m": Parameter("N/m", "stiffness", None, -1e7, 1e7),
        "anchor_m": Parameter("m", "position without force", 0.0, -10.0, 10.0),
    }

    @classmethod
    def draw(cls, generator, strength):
        return {"stiffness_N_m": generator.uniform(250.0, 1500.0) * strength,
                "anchor_m": either_sign(generator, 0, 2e-3)}

    @classmethod
    def apply(cls, plant, p):
        plant["cable"], plant["anchor"] = p["stiffness_N_m"], p["anchor_m"]


EFFECTS = (
    Backlash, DriveCompliance, ScrewPitchError, TorqueRipple, PayloadChange, GravityTilt, CableSpring,
)
