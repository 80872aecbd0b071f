"""Effects of the surroundings: temperature, air, floor.

Sources: B. Edlén, Metrologia 2 (1966) 71, for the index of air; expansion and vibration are derived: first-order
thermal lag, sum of sines.
"""

import numpy as np

from microstage_ros.model.effects.drawing import either_sign
from microstage_ros.model.effects.effect import Effect, Parameter, same_length, write_terms
from microstage_ros.model.plant_record import LINES


class ThermalDrift(Effect):
    """Parts expand: interferometer − encoder = amplitude_m (1 − exp(−t/time_s)) + rate_m_s t + expansion_m_K ΔT(t).

    ΔT(t) = temperature_rise_K (1 − exp(−t/temperature_time_s)) is what the stage thermometer shows.
    """

    id = "thermal_drift"
    label = "Parts expand"
    remedy = "Let the machine warm up; compensate by the stage thermometer."
    separated_by = "dwell"
    shows_against = "time"
    within = ("generic:time",)
    parameters = {
        "amplitude_m": Parameter("m", "final drift of the exponential", 0.0, -1e-3, 1e-3),
        "time_s": Parameter("s", "its time constant", 10.0, 1e-2, 1e5),
        "rate_m_s": Parameter("m/s", "linear drift", 0.0, -1e-5, 1e-5),
        "expansion_m_K": Parameter("m/K", "drift per kelvin of the stage", 0.0, -1e-3, 1e-3),
        "temperature_rise_K": Parameter("K", "rise of the stage temperature", 0.0, -100.0, 100.0),
        "temperature_time_s": Parameter("s", "its time constant", 10.0, 1e-2, 1e5),
    }

    @classmethod
    def draw(cls, generator, strength):
        """An exponential that every record repeats, or a smooth course of every record's own."""
        if generator.uniform() < 0.5:
            return {"amplitude_m": either_sign(generator, 1e-7 * strength, 6e-7 * strength),
                    "time_s": generator.uniform(3.0, 15.0)}
        size = generator.uniform(8e-8, 4e-7) * strength

        def after(columns, records):
            t = columns["t_s"]
            for _ in range(4):
                wave = np.sin(2 * np.pi * t / records.uniform(9.0, 40.0) + records.uniform(0, 2 * np.pi))
                columns["interferometer_m"] += 0.7 * size * records.normal() * wave

        return after

    @classmethod
    def apply(cls, plant, p):
        plant["drift_amplitude"], plant["drift_time"], plant["drift_rate"] = (
            p["amplitude_m"],
            p["time_s"],
            p["rate_m_s"],
        )
        plant["drift_expansion"] = p["expansion_m_K"]
        plant["stage_temperature_rise"], plant["stage_temperature_time"] = (
            p["temperature_rise_K"],
            p["temperature_time_s"],
        )


class RefractiveIndex(Effect):
    """Air index not compensated: the interferometer reads x + (path_m + x) Δn(t).

    Δn = −0.93e−6/K ΔT + 2.7e−9/Pa Δp about 20 °C and 101 325 Pa (first-order terms of the Edlén equation);
    ΔT and Δp drift at the given rates and swing as sines of swing_time_s.
    """

    id = "refractive_index"
    label = "The air's refractive index is not compensated"
    remedy = "Switch on the interferometer's weather station."
    separated_by = "dwell"
    shows_against = "time"
    within = ("generic:time",)
    parameters = {
        "path_m": Parameter("m", "dead path", 0.3, 0.0, 100.0),
        "temperature_rate_K_s": Parameter("K/s", "drift of the air temperature", 0.0, -1.0, 1.0),
        "pressure_rate_Pa_s": Parameter("Pa/s", "drift of the air pressure", 0.0, -100.0, 100.0),
        "temperature_swing_K": Parameter("K", "amplitude of the temperature's swing", 0.0, -20.0, 20.0),
        "pressure_swing_Pa": Parameter("Pa", "amplitude of the pressure's swing", 0.0, -5000.0, 5000.0),
        "swing_time_s": Parameter("s", "period of the swings", 15.0, 0.1, 1e5),
    }

    @classmethod
    def draw(cls, generator, strength):
        return {"path_m": generator.uniform(0.2, 0.6), "temperature_swing_K": generator.uniform(0.5, 2.0) * strength,
                "pressure_swing_Pa": generator.uniform(50.0, 300.0) * strength}

    @classmethod
    def apply(cls, plant, p):
        plant["air_path"], plant["air_compensated"] = p["path_m"], 0
        plant["air_temperature_rate"], plant["air_pressure_rate"] = p["temperature_rate_K_s"], p["pressure_rate_Pa_s"]
        plant["air_temperature_swing"], plant["air_pressure_swing"] = p["temperature_swing_K"], p["pressure_swing_Pa"]
        plant["air_swing_time"] = p["swing_time_s"]


class FloorVibration(Effect):
    """Narrow lines in position, with the motor off too.

    Both sensors see x + Σ amplitudes_m_n sin(2π f_n t + phase_n).
    """

    id = "floor_vibration"
    label = "The floor vibrates"
    remedy = "Find the machine that runs at this frequency; isolate the table."
    separated_by = None
    shows_against = "position"
    parameters = {
        "frequencies_hz": Parameter("Hz", "line frequencies", None, 0.0, 1e5),
        "amplitudes_m": Parameter("m", "amplitude of each line", None, 0.0, 1e-3),
        "phases_rad": Parameter("rad", "phase of each line", 0.0),
    }

    @classmethod
    def check_together(cls, checked, place):
        if not isinstance(checked["phases_rad"], list) and isinstance(checked["frequencies_hz"], list):
            checked["phases_rad"] = [checked["phases_rad"]] * len(checked["frequencies_hz"])
        same_length(checked, ["frequencies_hz", "amplitudes_m", "phases_rad"], place)

    @classmethod
    def draw(cls, generator, strength):
        return {"frequencies_hz": [generator.uniform(15, 90)],
                "amplitudes_m": [generator.uniform(4e-8, 2e-7) * strength]}

    @classmethod
    def apply(cls, plant, p):
        write_terms(plant, ["line_frequency", "line_amplitude", "line_phase"], "lines",
                    [p["frequencies_hz"], p["amplitudes_m"], p["phases_rad"]], LINES, cls.id)


EFFECTS = (ThermalDrift, RefractiveIndex, FloorVibration)
