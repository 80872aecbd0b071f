"""Effects in the encoder and in the taking of samples."""

import math

from microstage_ros.model.effects.effect import Effect, Parameter


class SamplingJitter(Effect):
    """Readings taken late against their stamps, samples lost.

    Encoder and current are read at t_n + late_s + |jitter_s · N(0,1)|; with probability lost_fraction a
    sample is lost and the reading before it stands again.
    """

    id = "sampling_jitter"
    parameters = {
        "late_s": Parameter("s", "constant lateness", 0.0, 0.0, 1e-2),
        "jitter_s": Parameter("s", "standard deviation of the random lateness", 0.0, 0.0, 1e-2),
        "lost_fraction": Parameter("1", "share of samples lost", 0.0, 0.0, 0.5),
    }

    @classmethod
    def apply(cls, plant, p):
        plant["late"], plant["jitter"], plant["lost"] = p["late_s"], p["jitter_s"], p["lost_fraction"]


class EncoderSde(Effect):
    """Sub-divisional error: y = x + Σ_{n=1..3} amplitude_n sin(2π n x / period_m + phase_n)."""

    id = "encoder_sde"
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
    def apply(cls, plant, p):
        plant["sde_number"] = 2 * math.pi / p["period_m"]
        plant["sde_amplitude"] = [p["amplitude1_m"], p["amplitude2_m"], p["amplitude3_m"]]
        plant["sde_phase"] = [p["phase1_rad"], p["phase2_rad"], p["phase3_rad"]]


class ScaleError(Effect):
    """Encoder scale, cosine or Abbe error: y = x (1 − relative), so interferometer − encoder = relative · x."""

    id = "scale_error"
    parameters = {"relative": Parameter("1", "interferometer − encoder over x", None, -0.1, 0.1)}

    @classmethod
    def apply(cls, plant, p):
        plant["scale"] = -p["relative"]


EFFECTS = (SamplingJitter, EncoderSde, ScaleError)
