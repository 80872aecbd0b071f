"""Effects in the friction contacts. The limits of a contact are F_j,max = α_j s(w) · (factors).

Sources: B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (1994), for friction that depends on
position, direction and dwell and for frictional lag; paper, Table 2, for the difference between directions. Derived:
creep from a flow that falls as 1/t; the rest by definition, as factors on the axis's own law.
"""

import math

import numpy as np

from microstage_ros.model.effects.drawing import either_sign, smooth_profile
from microstage_ros.model.effects.effect import (
    BLOCKS,
    FRICTION,
    STRIBECK,
    Effect,
    Parameter,
    as_list,
    same_length,
    write_terms,
)
from microstage_ros.model.plant_record import PROFILE, RIPPLES
from microstage_ros.quantities.errors import InputError

INF = math.inf


class DirectionAsymmetry(Effect):
    """Friction differs between directions: limits × (1 + asymmetry · sgn w), σ × (1 + viscous_asymmetry · sgn w)."""

    id = "direction_asymmetry"
    label = "Friction differs between directions"
    remedy = "Look at preload and seals of nut and bearings; feed forward each direction with its own friction."
    separated_by = "rest"
    shows_against = "velocity"
    within = ("generic:speed",)
    on_contact = True
    needs = FRICTION
    parameters = {
        "asymmetry": Parameter("1", "half the relative difference between directions", None, -0.9, 0.9),
        "viscous_asymmetry": Parameter("1", "the same of the viscous friction", 0.0, -0.9, 0.9),
    }

    @classmethod
    def draw(cls, generator, strength):
        """Of the friction that sliding needs, and in every third case of the viscous part too."""
        found = {"asymmetry": either_sign(generator, 0.1 * strength, 0.25 * strength)}
        if generator.uniform() < 0.33:
            found["viscous_asymmetry"] = either_sign(generator, 0.1 * strength, 0.3 * strength)
        return found

    @classmethod
    def apply(cls, plant, p):
        contact = plant[p["contact"]]
        contact["asymmetry"] = p["asymmetry"]
        contact["viscous_asymmetry"] = p["viscous_asymmetry"]
        if p["viscous_asymmetry"] != 0.0:
            plant["smooth"] = 1
            plant["base_level"] = max(plant["base_level"], 2)


class PositionDependentFriction(Effect):
    """Friction varies along the stroke: limits × g(x).

    Either g(x) = 1 + Σ_n amplitude_n sin(2π x / period_m_n + phase_rad_n), or g is a cubic spline
    through (positions_m, factors), constant beyond its ends.
    """

    id = "position_dependent_friction"
    label = "Friction varies along the stroke"
    remedy = "Clean and grease the guide and the screw; check their alignment where friction is highest."
    separated_by = "stroke"
    shows_against = "position"
    within = ("generic:friction in time",)
    on_contact = True
    needs = FRICTION
    parameters = {
        "amplitude": Parameter("1", "relative amplitude of each term", 0.0, -0.9, 0.9),
        "period_m": Parameter("m", "period of each term", 1e-3, 1e-7, 10.0),
        "phase_rad": Parameter("rad", "phase of each term", 0.0),
        "positions_m": Parameter("m", "support points of the spline", [0.0]),
        "factors": Parameter("1", "factor at each support point", [1.0], 0.05, 20.0),
    }

    @classmethod
    def check_together(cls, checked, place):
        """InputError unless the lists are of one length and the support points rise."""
        same_length(checked, ["amplitude", "period_m", "phase_rad"], place)
        same_length(checked, ["positions_m", "factors"], place)
        x = as_list(checked["positions_m"])
        if any(b <= a for a, b in zip(x, x[1:])):
            raise InputError(f"{place}.positions_m", x, "rising positions")

    @classmethod
    def draw(cls, generator, strength):
        return smooth_profile(generator, generator.uniform(0.08, 0.2) * strength)

    @classmethod
    def apply(cls, plant, p):
        contact = plant[p["contact"]]
        plant["modulated"] = 1
        number = [2 * math.pi / period for period in as_list(p["period_m"])]
        write_terms(contact, ["ripple_amplitude", "ripple_number", "ripple_phase"], "ripples",
                    [p["amplitude"], number, p["phase_rad"]], RIPPLES, cls.id)
        x, factor = np.array(as_list(p["positions_m"])), np.array(as_list(p["factors"]))
        if len(x) > 1:
            grid = np.linspace(x[0], x[-1], PROFILE + 1)
            from scipy.interpolate import CubicSpline  # most of a second that a node without profile need not wait

            contact["profile"] = np.maximum(CubicSpline(x, factor)(grid), 0.02) if len(x) > 2 else np.interp(grid, x,
                                                                                                             factor)
            contact["profile_low"], contact["profile_high"], contact["profiled"] = x[0], x[-1], 1


class RisingStaticFriction(Effect):
    """Breakaway grows with dwell time: limits × (1 + a), where a = rate · log10(1 + t_dwell / dwell_scale_s).

    t_dwell counts while the contact does not slide as a whole (with a law that has no blocks: always); it and a
    decay as exp(−travel / release_m).
    """

    id = "rising_static_friction"
    label = "Breakaway grows with time at rest"
    remedy = "Expect larger first moves after a pause; an exercise move before precise work avoids it."
    separated_by = "dwell"
    shows_against = "time"
    within = ("generic:velocity",)
    on_contact = True
    needs = FRICTION
    parameters = {
        "rate_per_decade": Parameter("1", "relative growth per decade of dwell", None, 0.0, 1.0),
        "dwell_scale_s": Parameter("s", "dwell at which the growth begins", 0.05, 1e-4, 1e3),
        "release_m": Parameter("m", "travel of the stage that wipes the growth out", 2e-6, 1e-9, 1e-2),
    }

    @classmethod
    def draw(cls, generator, strength):
        return {"rate_per_decade": generator.uniform(0.1, 0.3) * strength}

    @classmethod
    def apply(cls, plant, p):
        contact = plant[p["contact"]]
        plant["modulated"] = 1
        contact["aging_rate"], contact["aging_time"] = p["rate_per_decade"], p["dwell_scale_s"]
        contact["aging_release"] = p["release_m"]


class FrictionalLag(Effect):
    """Friction lags velocity in sliding: s(w̃) with time_s · dw̃/dt = |w| − w̃."""

    id = "frictional_lag"
    label = "Friction lags behind speed"
    remedy = "Lubricant film: check grease and its temperature; let the observer use the lag."
    separated_by = "speed"
    shows_against = "velocity"
    within = ("generic:velocity",)
    on_contact = True
    needs = STRIBECK
    parameters = {"time_s": Parameter("s", "time constant of the lag", None, 1e-6, 10.0)}

    @classmethod
    def draw(cls, generator, strength):
        return {"time_s": generator.uniform(0.01, 0.05) * strength}

    @classmethod
    def apply(cls, plant, p):
        plant[p["contact"]]["lag"] = p["time_s"]
        plant["base_level"] = max(plant["base_level"], 2)


class PreslidingCreep(Effect):
    """Slow motion below breakaway: a sticking block flows ever more slowly the longer it is held.

    dF_j/dt = k_j (w − amplitude / (t + time_s) · F_j/F_j,max),

    t the time since the contact moved (travel over release_m wipes it out). Under a constant load the stage
    drifts by amplitude_m · load · ln(1 + t/time_s); at constant position the force relaxes likewise.
    """

    id = "presliding_creep"
    label = "The axis creeps under load at rest"
    remedy = "Keep the loop closed while holding, or unload the contact before a wait."
    separated_by = "dwell"
    shows_against = "time"
    on_contact = True
    needs = BLOCKS
    parameters = {
        "amplitude_m": Parameter("m", "drift per e-fold of time at full load, of the stage", None, 0.0, 1e-4),
        "time_s": Parameter("s", "time at which the logarithm begins", 0.05, 1e-4, 1e3),
        "release_m": Parameter("m", "travel of the stage that starts the time anew", 1e-6, 1e-9, 1e-2),
    }

    @classmethod
    def draw(cls, generator, strength):
        return {"amplitude_m": generator.uniform(2e-8, 1e-7) * strength, "time_s": generator.uniform(0.02, 0.1)}

    @classmethod
    def apply(cls, plant, p):
        contact = plant[p["contact"]]
        plant["modulated"] = 1
        lead = float(plant["screw_ratio"]) if p["contact"] == "actuator" else 1.0
        contact["creep_amplitude"], contact["creep_time"] = p["amplitude_m"] / lead, p["time_s"]
        contact["creep_release"] = p["release_m"]


class ViscousChange(Effect):
    """Viscosity differs (temperature, grease): σ × factor."""

    id = "viscous_change"
    label = "Viscous friction differs"
    remedy = "Check grease, its amount and its temperature."
    separated_by = "speed"
    shows_against = "velocity"
    within = ("generic:velocity", "generic:viscous in time")
    on_contact = True
    needs = FRICTION
    parameters = {"factor": Parameter("1", "factor on the viscous coefficient", None, 0.0, 1e3)}

    @classmethod
    def draw(cls, generator, strength):
        return {"factor": 1.0 + generator.uniform(0.4, 2.0) * strength}

    @classmethod
    def apply(cls, plant, p):
        plant[p["contact"]]["viscous"] *= p["factor"]


class NonlinearViscous(Effect):
    """Friction grows with speed other than linearly: extra coefficient · g^exponent · sgn w.

    g = |w|, or, where the growth ends (a lubricant film builds up), g = V (1 − exp(−|w|/V)) with
    V = saturation_speed.
    """

    id = "nonlinear_viscous"
    label = "Friction is not linear in speed"
    remedy = "Use the extended friction curve in feed-forward; check lubricant and seals."
    separated_by = "speed"
    shows_against = "velocity"
    within = ("generic:velocity", "generic:viscous in time")
    on_contact = True
    parameters = {
        "coefficient": Parameter("N m/(rad/s)^n or N/(m/s)^n", "coefficient, of the contact's own units", None),
        "exponent": Parameter("1", "exponent n", 2.0, 0.1, 4.0),
        "saturation_speed": Parameter("rad/s or m/s", "speed V at which the growth ends; 0: it does not end", 0.0, 0.0,
                                      1e6),
    }

    @classmethod
    def draw(cls, generator, strength):
        """A power of the speed, or in every third case a growth that ends."""
        if generator.uniform() < 0.67:
            return {"coefficient": generator.uniform(1.5e-5, 4e-5) * strength, "exponent": generator.uniform(1.7, 2.3)}
        return {"coefficient": generator.uniform(2e-4, 6e-4) * strength, "exponent": 1.0,
                "saturation_speed": generator.uniform(0.8, 3.0)}

    @classmethod
    def apply(cls, plant, p):
        contact = plant[p["contact"]]
        contact["quadratic"], contact["power"] = p["coefficient"], p["exponent"]
        contact["saturation"] = p["saturation_speed"]
        plant["smooth"] = 1
        plant["base_level"] = max(plant["base_level"], 2)


class FrictionLevelChange(Effect):
    """All of a contact's friction scaled (wear, run-in, preload): limits, stiffnesses kept in shape.

    F → factor · F at every displacement: k_j and the limits × factor, σ × factor.
    """

    id = "friction_level_change"
    label = "All of the friction has changed"
    remedy = "Check preload and wear; identify the friction anew."
    separated_by = "speed"
    shows_against = "velocity"
    within = ("generic:velocity", "generic:friction in time")
    contained_in = ("position_dependent_friction",)
    on_contact = True
    needs = FRICTION
    parameters = {"factor": Parameter("1", "factor on the friction", None, 0.01, 100.0)}

    @classmethod
    def draw(cls, generator, strength):
        return {"factor": 1.0 + either_sign(generator, 0.12 * strength, 0.3 * strength)}

    @classmethod
    def apply(cls, plant, p):
        scale_friction(plant[p["contact"]], p["factor"])


def scale_friction(contact, factor):
    """Scale a contact's friction at every displacement and velocity by ``factor`` [1]."""
    contact["level"] *= factor
    contact["kappa"] *= factor
    contact["viscous"] *= factor
    contact["attraction"] *= factor      # the relaxation time |s|/C stays


EFFECTS = (
    DirectionAsymmetry, PositionDependentFriction, RisingStaticFriction, FrictionalLag, PreslidingCreep,
    ViscousChange, NonlinearViscous, FrictionLevelChange,
)
