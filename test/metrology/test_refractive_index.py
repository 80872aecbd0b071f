"""The index of air against the tables that Ciddor and NIST published."""

import numpy as np
import pytest

from microstage_ros.metrology.refractive_index import (
    Air,
    index_sensitivities,
    index_uncertainty,
    refractive_index,
    saturation_pressure,
)
from microstage_ros.quantities.errors import InputError

CIDDOR_DRY = [(20, 80e3, 21458.0), (20, 100e3, 26824.4), (20, 120e3, 32191.6), (10, 100e3, 27774.7),
              (30, 100e3, 25937.2)]
"""Table 1 of Ciddor 1996: °C, Pa, (n - 1) 1e8; dry air, 450 ppm, 633 nm."""

CIDDOR_MOIST = [(19.526, 102094.8, 1065, 510, 27392.9), (19.173, 102993.0, 641, 450, 27682.4),
                (19.188, 102918.8, 706, 450, 27658.7), (19.532, 103603.2, 986, 600, 27802.0)]
"""Table 2: °C, Pa, vapour pressure Pa, ppm, (n - 1) 1e8."""

CIDDOR_EXTREME = [(20, 80e3, 0.75, 21394.0), (20, 120e3, 0.75, 32127.8), (40, 120e3, 0.75, 29941.8),
                  (50, 80e3, 1.0, 19058.4), (50, 120e3, 1.0, 28792.4)]
"""Table 3: °C, Pa, humidity, (n - 1) 1e8."""

NIST = [(20, 101325, 0, 633, 1.000271800), (20, 60e3, 0, 633, 1.000160924), (50, 100e3, 0, 633, 1.000243285),
        (5, 100e3, 0, 633, 1.000282756), (-40, 100e3, 0, 633, 1.000337580), (50, 120e3, 1, 633, 1.000287924),
        (20, 100e3, 1, 633, 1.000267394), (40, 110e3, 1, 1700, 1.000270247), (20, 101325, 0, 300, 1.000286581)]
"""Test values of the NIST Engineering Metrology Toolbox for the Ciddor equation: °C, Pa, humidity, nm, n."""


@pytest.mark.parametrize("celsius, pressure, expected", CIDDOR_DRY)
def test_dry_air_as_ciddor_tabulates(celsius, pressure, expected):
    index = refractive_index(Air(celsius + 273.15, pressure, 0.0), 633e-9)
    assert (index - 1) * 1e8 == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("celsius, pressure, vapour, ppm, expected", CIDDOR_MOIST)
def test_moist_air_as_ciddor_tabulates(celsius, pressure, vapour, ppm, expected):
    humidity = vapour / float(saturation_pressure(celsius + 273.15))
    index = refractive_index(Air(celsius + 273.15, pressure, humidity), 633e-9, ppm)
    assert (index - 1) * 1e8 == pytest.approx(expected, abs=0.2)


@pytest.mark.parametrize("celsius, pressure, humidity, expected", CIDDOR_EXTREME)
def test_extreme_air_as_ciddor_tabulates(celsius, pressure, humidity, expected):
    index = refractive_index(Air(celsius + 273.15, pressure, humidity), 633e-9)
    assert (index - 1) * 1e8 == pytest.approx(expected, abs=0.6)


@pytest.mark.parametrize("celsius, pressure, humidity, nm, expected", NIST)
def test_values_of_the_nist_calculator(celsius, pressure, humidity, nm, expected):
    assert refractive_index(Air(celsius + 273.15, pressure, humidity), nm * 1e-9) == pytest.approx(expected, abs=1.01e-9)


def test_saturation_pressure_of_iapws():
    """Verification values of IAPWS R7-97 (300 K: 0.353658941e-2 MPa) and the triple point."""
    assert saturation_pressure(300.0) == pytest.approx(3536.58941, rel=1e-8)
    assert saturation_pressure(273.16) == pytest.approx(611.657, rel=2e-5)
    assert saturation_pressure(273.1499) == pytest.approx(float(saturation_pressure(273.15)), rel=2e-4)


def test_slopes_that_every_handbook_gives():
    slopes = index_sensitivities(Air())
    assert slopes["temperature_K"] == pytest.approx(-0.95e-6, rel=0.03)
    assert slopes["pressure_Pa"] == pytest.approx(2.68e-9, rel=0.01)
    assert slopes["humidity"] == pytest.approx(-0.85e-6, rel=0.05)


def test_uncertainty_agrees_with_a_draw_of_the_sensors():
    air, standard = Air(293.15, 101325.0, 0.4), Air(0.05, 30.0, 0.02)
    generator = np.random.default_rng(6)
    drawn = Air(generator.normal(293.15, 0.05, 20_000), generator.normal(101325, 30, 20_000),
                generator.normal(0.4, 0.02, 20_000))
    spread = np.hypot(refractive_index(drawn).std(), 1e-8)
    assert index_uncertainty(air, standard) == pytest.approx(spread, rel=0.03)
    assert index_uncertainty(air, Air(0.0, 0.0, 0.0)) == pytest.approx(1e-8)


@pytest.mark.parametrize("air, told", [(Air(20.0), "temperature_K"), (Air(293.15, 1013.25), "pressure_Pa"),
                                       (Air(humidity=50.0), "humidity"), (Air(np.array([293.0, np.nan])), "temperature_K")])
def test_other_units_are_refused(air, told):
    with pytest.raises(InputError, match=told):
        refractive_index(air)
    with pytest.raises(InputError, match="wavelength"):
        refractive_index(Air(), 633.0)
