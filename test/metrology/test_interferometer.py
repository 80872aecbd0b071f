"""The interferometer's correction undoes what air does, and its budget adds up."""

import numpy as np
import pytest

from microstage_ros.metrology.interferometer import Interferometer, budget, correct
from microstage_ros.metrology.refractive_index import Air, refractive_index
from microstage_ros.quantities.errors import InputError


def test_correction_undoes_the_air():
    setup = Interferometer(assumed_index=1.000271, dead_path_m=0.3)
    generator = np.random.default_rng(9)
    position = generator.uniform(-0.025, 0.025, 50)
    air = Air(generator.normal(295, 2, 50), generator.normal(100e3, 1e3, 50), generator.uniform(0.2, 0.8, 50))
    zeroed = Air(293.0, 101e3, 0.4)
    reading = (refractive_index(air) * (0.3 + position) - refractive_index(zeroed) * 0.3) / 1.000271
    np.testing.assert_allclose(correct(reading, air, zeroed, setup), position, rtol=0, atol=1e-15)
    assert np.abs(reading - position).max() > 1e-7


def test_dead_path_alone():
    """Air that warms by one kelvin seems to move the stage by -0.93e-6 of the dead path."""
    setup = Interferometer(assumed_index=float(refractive_index(Air())), dead_path_m=0.3)
    shift = correct(0.0, Air(294.15), Air(), setup)
    assert shift == pytest.approx(0.3 * 0.94e-6, rel=0.03)


def test_budget_adds_up_and_agrees_with_a_draw():
    setup = Interferometer(dead_path_m=0.2, noise_m=5e-9, cosine_rad=0.0, wavelength_relative=5e-8)
    air, zeroed, length = Air(), Air(292.15), 0.02
    told = budget(length, air, zeroed, setup)
    assert told.expanded_m == pytest.approx(2 * told.standard_m)
    assert told.standard_m == pytest.approx(np.sqrt(sum(line.standard_m**2 for line in told.contributions)))
    sizes = [line.standard_m for line in told.contributions]
    assert sizes == sorted(sizes, reverse=True)

    draws, generator = 20_000, np.random.default_rng(3)
    def drawn(state, standard):
        return Air(*(generator.normal(getattr(state, part), getattr(standard, part), draws)
                     for part in ("temperature_K", "pressure_Pa", "humidity")))
    offset = drawn(Air(0.0, 0.0, 0.0), setup.sensors)
    change = drawn(Air(0.0, 0.0, 0.0), setup.sensor_changes)
    shown = [Air(state.temperature_K + offset.temperature_K + extra.temperature_K,
                 state.pressure_Pa + offset.pressure_Pa + extra.pressure_Pa,
                 state.humidity + offset.humidity + extra.humidity)
             for state, extra in ((air, change), (zeroed, Air(0.0, 0.0, 0.0)))]
    dead = generator.normal(setup.dead_path_m, setup.dead_path_uncertainty_m, draws)
    reading = refractive_index(air) * (0.2 + length) - refractive_index(zeroed) * 0.2
    now, then = (refractive_index(state) for state in shown)
    found = reading / now - dead * (now - then) / now
    found = found + generator.normal(0, np.hypot(5e-9, length * np.hypot(5e-8, 1e-8)), draws)
    assert found.mean() == pytest.approx(length, abs=1e-9)
    assert told.standard_m == pytest.approx(found.std(), rel=0.05)


def test_at_zero_only_noise_and_dead_path_are_left():
    told = budget(0.0, Air(), Air(), Interferometer(noise_m=20e-9))
    assert told.expanded_m == pytest.approx(40e-9)


def test_negative_uncertainty_is_refused():
    with pytest.raises(InputError, match="noise and resolution"):
        budget(0.01, Air(), Air(), Interferometer(noise_m=-1e-9))
