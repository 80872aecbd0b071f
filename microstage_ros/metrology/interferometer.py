"""What an interferometer's reading is worth: correction for air and dead path, and its uncertainty.

The instrument counts optical path.  With dead path D (from the beam splitter to the reflector at the
zero of the axis), index n_0 that the instrument assumes, n_s when it was zeroed, n now:

    reading  L_r = [n (D + L) - n_s D] / n_0
    position L   = L_r n_0/n - D (n - n_s)/n

Uncertainty by the GUM (JCGM 100): standard uncertainties times sensitivities, root of the sum of
squares, expanded by k = 2.  The air sensors' errors are taken as constant (type B), so along the
dead path only their change since zeroing counts.

Derived: the counted path is n times the geometric one, less n_s D when zeroed, over n_0. Cosine and Abbe errors: first
order of the geometry, L θ²/2 and arm times angle. Budget: JCGM 100:2008, clauses 5.1 and 6.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from microstage_ros.metrology.refractive_index import (
    EQUATION_UNCERTAINTY,
    HELIUM_NEON_M,
    Air,
    index_sensitivities,
    refractive_index,
)
from microstage_ros.quantities.errors import InputError

COVERAGE = 2.0
SENSORS = Air(0.1, 50.0, 0.05)
"""Standard uncertainties of an ordinary weather station: 0.1 K, 50 Pa, 5 %."""

SENSOR_CHANGES = Air(0.01, 5.0, 0.01)
"""The same for changes within hours."""


@dataclass(frozen=True)
class Interferometer:
    """The instrument and its set-up.  Every uncertainty is a standard uncertainty.

    Attributes
    ----------
    wavelength_m : in vacuum.
    assumed_index : n_0 that the instrument divides by; 1 if it reads vacuum lengths.
    dead_path_m, dead_path_uncertainty_m : D and how well it is known.
    wavelength_relative : relative, of the vacuum wavelength.
    sensors : of the air sensors (`Air`); sensor_changes : of their change since zeroing.
    noise_m : of one reading, resolution included.
    cosine_rad : of the angle between beam and travel; abbe_offset_m, abbe_angle_rad : arm, and
        standard uncertainty of the stage's angle along the travel.
    """

    wavelength_m: float = HELIUM_NEON_M
    assumed_index: float = 1.0
    dead_path_m: float = 0.0
    dead_path_uncertainty_m: float = 1e-3
    wavelength_relative: float = 2e-8
    sensors: Air = SENSORS
    sensor_changes: Air = SENSOR_CHANGES
    noise_m: float = 10e-9
    cosine_rad: float = 5e-5
    abbe_offset_m: float = 0.0
    abbe_angle_rad: float = 0.0


@dataclass(frozen=True)
class Contribution:
    """One line of an uncertainty budget: what, its size in its own unit, ∂L/∂what, and the product [m]."""

    name: str
    size: float
    unit: str
    sensitivity: float
    standard_m: float


@dataclass(frozen=True)
class Budget:
    """An uncertainty budget, largest contribution first.

    Attributes
    ----------
    contributions : tuple of `Contribution`.
    standard_m : combined standard uncertainty; expanded_m : times k = 2.
    """

    contributions: tuple
    standard_m: float
    expanded_m: float


def correct(reading_m: ArrayLike, air: Air, zeroed: Air, interferometer: Interferometer) -> np.ndarray:
    """Position from the reading.

    Parameters
    ----------
    reading_m : what the instrument shows, number or array.
    air : `Air` at the time of the reading(s), numbers or arrays of the same shape.
    zeroed : `Air` when the instrument was set to zero.
    interferometer : `Interferometer`.

    Returns
    -------
    position [m], of the shape of `reading_m`.

    Raises
    ------
    InputError : air outside the range of the refractive index's equation.
    """
    now = refractive_index(air, interferometer.wavelength_m)
    then = refractive_index(zeroed, interferometer.wavelength_m)
    scaled = np.asarray(reading_m, dtype=float) * interferometer.assumed_index / now
    return scaled - interferometer.dead_path_m * (now - then) / now


def budget(position_m: float, air: Air, zeroed: Air, interferometer: Interferometer) -> Budget:
    """Uncertainty of one corrected position.

    Parameters
    ----------
    position_m : distance L from the zero [m]; air, zeroed, interferometer : as for `correct`.

    Returns
    -------
    Budget

    Raises
    ------
    InputError : an uncertainty that is negative or not finite, or air out of range.
    """
    setup, length = interferometer, abs(float(position_m))
    now, then = (float(refractive_index(state, setup.wavelength_m)) for state in (air, zeroed))
    by_index, by_dead_path = -length / now, -(now - then) / now
    lines = [("vacuum wavelength", setup.wavelength_relative, "1", length),
             ("equation of the index", EQUATION_UNCERTAINTY, "1", by_index),
             ("length of the dead path", setup.dead_path_uncertainty_m, "m", by_dead_path),
             ("noise and resolution", setup.noise_m, "m", 1.0),
             ("angle between beam and travel", setup.cosine_rad**2, "rad²", length / 2),
             ("angle of the stage (Abbe)", setup.abbe_angle_rad, "rad", setup.abbe_offset_m)]
    for part, slope in index_sensitivities(air, setup.wavelength_m).items():
        quantity, _, unit = part.partition("_")
        lines.append((f"air {quantity}", getattr(setup.sensors, part), unit or "1", by_index * slope))
        lines.append((f"air {quantity}, change along the dead path", getattr(setup.sensor_changes, part), unit or "1",
                      -setup.dead_path_m * slope / now))
    contributions = [_line(*line) for line in lines]
    contributions.sort(key=lambda line: -line.standard_m)
    standard = float(np.sqrt(sum(line.standard_m**2 for line in contributions)))
    return Budget(tuple(contributions), standard, COVERAGE * standard)


def _line(name: str, size: float, unit: str, sensitivity: float) -> Contribution:
    """A contribution, with its size checked."""
    if not np.isfinite(size) or size < 0:
        raise InputError(f"uncertainty of {name}", size, f"a standard uncertainty of 0 or more, in {unit}")
    return Contribution(name, float(size), unit, float(sensitivity), abs(float(size) * float(sensitivity)))
