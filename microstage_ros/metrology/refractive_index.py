"""Refractive index of air for the laser of an interferometer.

P. E. Ciddor, *Refractive index of air: new equations for the visible and near infrared*, Appl. Opt.
35 (1996) 1566-1573, with the saturation vapour pressure of IAPWS R7-97 as in J. A. Stone and
J. H. Zimmerman, *Index of refraction of air*, NIST Engineering Metrology Toolbox.  Valid from -40 to
100 °C, 10 to 140 kPa, 0 to 100 % humidity, 300 to 1700 nm; about 20 °C its own standard uncertainty
is 1e-8.

    n - 1 = (ρ_a/ρ_axs) r_axs + (ρ_v/ρ_vs) r_vs

with the densities ρ_a of dry air and ρ_v of water vapour (BIPM 1981/91 equation) and the
refractivities r of both at their standard conditions.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from microstage_ros.quantities.errors import InputError

HELIUM_NEON_M = 632.9908e-9
"""Vacuum wavelength of a helium-neon laser on the usual line [m]."""

CO2_PPM = 450.0
EQUATION_UNCERTAINTY = 1e-8
"""Standard uncertainty of the equation itself."""

ZERO_CELSIUS = 273.15
GAS_CONSTANT, WATER_MASS, STANDARD_COMPRESSIBILITY = 8.314472, 0.018015, 0.9995922115
STANDARD_VAPOUR_DENSITY = 0.00985938
IAPWS = (1.16705214528e3, -7.24213167032e5, -1.70738469401e1, 1.20208247025e4, -3.23255503223e6,
         1.49151086135e1, -4.82326573616e3, 4.05113405421e5, -2.38555575678e-1, 6.50175348448e2)
RANGES = {"temperature_K": (233.15, 373.15), "pressure_Pa": (1e4, 1.4e5), "humidity": (0.0, 1.0)}
STEPS = {"temperature_K": 0.01, "pressure_Pa": 10.0, "humidity": 1e-3}
"""Steps of the central differences: the index is smooth, its rounding is 2e-16."""


@dataclass(frozen=True)
class Air:
    """State of the air, or a standard uncertainty of each part.  Numbers or arrays of one shape.

    Attributes
    ----------
    temperature_K : [K]. pressure_Pa : [Pa]. humidity : relative, 0 to 1.
    """

    temperature_K: Any = 293.15
    pressure_Pa: Any = 101325.0
    humidity: Any = 0.5


def refractive_index(air: Air, wavelength_m: float = HELIUM_NEON_M, co2_ppm: float = CO2_PPM) -> np.ndarray:
    """Phase index n of air [1] by Ciddor's equation.

    Parameters
    ----------
    air : `Air`; arrays give an array.
    wavelength_m : in vacuum [m].
    co2_ppm : carbon dioxide by volume [ppm].

    Returns
    -------
    n, of the shape of the air's parts.

    Raises
    ------
    InputError : a state or a wavelength outside the equation's range, with the value.
    """
    _check(air, wavelength_m)
    kelvin, pressure = np.asarray(air.temperature_K, dtype=float), np.asarray(air.pressure_Pa, dtype=float)
    s = (1e-6 / wavelength_m) ** 2
    dry = 1e-8 * (5792105.0 / (238.0185 - s) + 167917.0 / (57.362 - s)) * (1 + 5.34e-7 * (co2_ppm - 450.0))
    vapour = 1.022e-8 * (295.235 + 2.6422 * s - 0.032380 * s**2 + 0.004028 * s**3)
    dry_mass = 0.0289635 + 1.2011e-8 * (co2_ppm - 400.0)
    fraction = vapour_fraction(air)
    per_mole = pressure / (compressibility(kelvin, pressure, fraction) * GAS_CONSTANT * kelvin)
    standard_density = 101325.0 * dry_mass / (STANDARD_COMPRESSIBILITY * GAS_CONSTANT * 288.15)
    return 1 + (dry * (1 - fraction) * per_mole * dry_mass / standard_density
                + vapour * fraction * per_mole * WATER_MASS / STANDARD_VAPOUR_DENSITY)


def saturation_pressure(temperature_K: ArrayLike) -> np.ndarray:
    """Pressure of saturated water vapour [Pa]: IAPWS R7-97 over water, Wagner, Saul and Pruß 1994 over ice."""
    kelvin = np.asarray(temperature_K, dtype=float)
    k = IAPWS
    omega = kelvin + k[8] / (kelvin - k[9])
    a = omega**2 + k[0] * omega + k[1]
    b = k[2] * omega**2 + k[3] * omega + k[4]
    c = k[5] * omega**2 + k[6] * omega + k[7]
    over_water = 1e6 * (2 * c / (-b + np.sqrt(b**2 - 4 * a * c))) ** 4
    theta = kelvin / 273.16
    over_ice = 611.657 * np.exp(-13.928169 * (1 - theta**-1.5) + 34.7078238 * (1 - theta**-1.25))
    return np.where(kelvin >= ZERO_CELSIUS, over_water, over_ice)


def vapour_fraction(air: Air) -> np.ndarray:
    """Molar fraction of water vapour: enhancement factor × humidity × saturation pressure / pressure [1]."""
    celsius = np.asarray(air.temperature_K, dtype=float) - ZERO_CELSIUS
    enhancement = 1.00062 + 3.14e-8 * np.asarray(air.pressure_Pa, dtype=float) + 5.60e-7 * celsius**2
    return enhancement * air.humidity * saturation_pressure(air.temperature_K) / air.pressure_Pa


def compressibility(kelvin: np.ndarray, pressure: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    """Compressibility Z of moist air [1] (BIPM 1981/91 equation), in arrays of one shape or numbers.

    ``kelvin``: temperature [K], ``pressure`` [Pa], ``fraction``: molar fraction of water vapour [1].
    """
    t, ratio = kelvin - ZERO_CELSIUS, pressure / kelvin
    linear = (1.58123e-6 - 2.9331e-8 * t + 1.1043e-10 * t**2 + (5.707e-6 - 2.051e-8 * t) * fraction
              + (1.9898e-4 - 2.376e-6 * t) * fraction**2)
    return 1 - ratio * linear + ratio**2 * (1.83e-11 - 0.765e-8 * fraction**2)


def index_sensitivities(air: Air, wavelength_m: float = HELIUM_NEON_M) -> dict[str, float]:
    """Derivatives of the index by each part of the state: name of the part to ∂n/∂part [1/K, 1/Pa, 1]."""
    found = {}
    for name, step in STEPS.items():
        value = float(getattr(air, name))
        low, high = max(value - step, RANGES[name][0]), min(value + step, RANGES[name][1])
        indices = [refractive_index(_with(air, name, edge), wavelength_m) for edge in (low, high)]
        found[name] = float(indices[1] - indices[0]) / (high - low)
    return found


def index_uncertainty(air: Air, standard: Air, wavelength_m: float = HELIUM_NEON_M) -> float:
    """Standard uncertainty of the index [1] from those of the sensors, the equation's own included.

    Parameters
    ----------
    air : the state; standard : standard uncertainty of each part, `Air` too.
    """
    parts = [slope * getattr(standard, name) for name, slope in index_sensitivities(air, wavelength_m).items()]
    return float(np.sqrt(sum(part**2 for part in parts) + EQUATION_UNCERTAINTY**2))


def _with(air: Air, name: str, value: float) -> Air:
    """`air` with one part changed."""
    return Air(**{**{part.name: getattr(air, part.name) for part in fields(air)}, name: value})


def _check(air: Air, wavelength_m: float) -> None:
    """Refuse a state or wavelength that the equation does not cover."""
    units = {"temperature_K": "K", "pressure_Pa": "Pa", "humidity": "(a share of 1)"}
    for name, (low, high) in RANGES.items():
        values = np.asarray(getattr(air, name), dtype=float)
        bad = ~((values >= low - 1e-12) & (values <= high + 1e-12))
        if bad.any():
            raise InputError(f"air: {name}", float(values[bad].flat[0]), f"{low:g} to {high:g} {units[name]}")
    if not 300e-9 <= wavelength_m <= 1700e-9:
        raise InputError("laser: wavelength", wavelength_m, "300e-9 to 1700e-9 m in vacuum")
