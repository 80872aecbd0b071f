"""Effects in the encoder and in the taking of samples.

Sources: P. L. M. Heydemann, Applied Optics 20 (1981), for the harmonics of the signal period (offsets give the first,
amplitude and phase the second); the other equations are derived: readings at the wrong time, a scale by definition.
"""

import math

import numpy as np

from microstage_ros.model.effects.drawing import either_sign
from microstage_ros.model.effects.effect import Effect, Parameter


class SamplingJitter(Effect):
    """Readings taken late against their stamps, samples lost.

    The encoder is read at t_n + late_s + |jitter_s · N(0,1)|, the current at t_n; with probability lost_fraction a
    sample is lost and the readings of both before it stand again.
    """

    id = "sampling_jitter"
    label = "Readings are late or lost"
    remedy = "Check the reading's timing and the cable; stamp readings where they are made."
    separated_by = "frequency"
    shows_against = "velocity"
    within = ("generic:direction",)
    parameters = {
        "late_s": Parameter("s", "constant lateness", 0.0, 0.0, 1e-2),
        "jitter_s": Parameter("s", "standard deviation of the random lateness", 0.0, 0.0, 1e-2),
        "lost_fraction": Parameter("1", "share of samples lost", 0.0, 0.0, 0.5),
    }

    @classmethod
    def draw(cls, generator, strength):
        return {"late_s": generator.uniform(2e-4, 6e-4) * strength, "lost_fraction": generator.uniform(0.0, 0.02)}

    @classmethod
    def apply(cls, plant, p):
        plant["late"], plant["jitter"], plant["lost"] = p["late_s"], p["jitter_s"], p["lost_fraction"]


class EncoderSde(Effect):
    """Sub-divisional error: y = x + Σ_{n=1..3} amplitude_n sin(2π n x / period_m + phase_n)."""

    id = "encoder_sde"
    label = "The encoder errs within its signal period"
    remedy = "Clean and re-align the reading head; calibrate the interpolation."
    separated_by = "stroke"
    shows_against = "signal period"
    within = ("generic:position",)
    parameters = {
        "period_m": Parameter("m", "signal period", 10e-6, 1e-7, 1e-2),
        "amplitude1_m": Parameter("m", "first harmonic", 0.0, -1e-5, 1e-5),
        "phase1_rad": Parameter("rad", "its phase", 0.0),
        "amplitude2_m": Parameter("m", "second harmonic", 0.0, -1e-5, 1e-5),
        "phase2_rad": Parameter("rad", "its phase", 0.0),
        "amplitude3_m": Parameter("m", "third harmonic", 0.0, -1e-5, 1e-5),
        "phase3_rad": Parameter("rad", "its phase", 0.0),
    }

    @classmethod
    def draw(cls, generator, strength):
        """A usual signal period, or any."""
        period = float(generator.choice([20e-6, 10e-6, 4e-6, 2e-6]) if generator.uniform() < 0.5 else np.exp(
            generator.uniform(*np.log([0.8e-6, 4e-5]))))
        return {"period_m": period, "amplitude1_m": generator.uniform(1e-8, 5e-8) * strength,
                "phase1_rad": generator.uniform(0, 6.28),
                "amplitude2_m": generator.uniform(0, 1e-8) * strength}

    @classmethod
    def apply(cls, plant, p):
        plant["sde_number"] = 2 * math.pi / p["period_m"]
        plant["sde_amplitude"] = [p["amplitude1_m"], p["amplitude2_m"], p["amplitude3_m"]]
        plant["sde_phase"] = [p["phase1_rad"], p["phase2_rad"], p["phase3_rad"]]


class ScaleError(Effect):
    """Encoder scale, cosine or Abbe error: y = x (1 − relative), so interferometer − encoder = relative · x."""

    id = "scale_error"
    label = "The encoder's scale is off"
    remedy = "Calibrate against the interferometer; check cosine and Abbe alignment."
    separated_by = "stroke"
    shows_against = "position"
    within = ("generic:position",)
    parameters = {"relative": Parameter("1", "interferometer − encoder over x", None, -0.1, 0.1)}

    @classmethod
    def draw(cls, generator, strength):
        return {"relative": either_sign(generator, 5e-5 * strength, 3e-4 * strength)}

    @classmethod
    def apply(cls, plant, p):
        plant["scale"] = -p["relative"]


EFFECTS = (SamplingJitter, EncoderSde, ScaleError)
