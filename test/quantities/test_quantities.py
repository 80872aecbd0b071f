"""The one validator: ranges, words that are numbers, lists, defaults, refusals that name place, value and range."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microstage_ros.control.gains import Gain, check_gain
from microstage_ros.model.effects.effect import Parameter
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.quantity import Quantity, quantity_from
from microstage_ros.quantities.spec import Spec, check_all, positive

MASS = Spec("kg", 0.5, 20.0, "moving mass")


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_accepted_exactly_in_the_closed_range(value):
    if math.isfinite(value) and 0.5 <= value <= 20.0:
        assert MASS.check(value, "here") == value
    else:
        with pytest.raises(InputError, match="here: got .*0.5 … 20 kg"):
            MASS.check(value, "here")


@pytest.mark.parametrize("value", [3, "3", "3e0", np.float64(3.0), np.int64(3)])
def test_numbers_of_any_type_and_words_that_are_numbers(value):
    assert MASS.check(value, "here") == 3.0


@pytest.mark.parametrize("value", [True, None, "three", [3.0], {"value": 3.0}, 3j])
def test_what_is_no_number_is_refused(value):
    with pytest.raises(InputError, match="a number"):
        MASS.check(value, "here")


@pytest.mark.parametrize("value", [10**400, -(10**400)])
def test_a_whole_number_beyond_every_float_is_out_of_range(value):
    """It ended in an error of Python, "int too large to convert to float"."""
    for spec in (MASS, positive("kg", "mass")):
        with pytest.raises(InputError, match="here: got .*kg"):
            spec.check(value, "here")


@pytest.mark.parametrize(("value", "bound"), [(1e-300, "at least 1e-15"), (9.9e-16, "at least 1e-15"), (1.1e15, "at most 1e"), (1e300, "at most 1e")])
def test_a_number_that_no_machine_has_is_refused(value, bound):
    """A resistance of 1e-300 ohm ended in a division by zero, a pitch of it in an overflow."""
    with pytest.raises(InputError, match=f"here: got .*a finite number > 0 in ohm .*, and {bound}"):
        positive("ohm", "resistance").check(value, "here")
    assert positive("ohm", "resistance").check(1e-15, "here") == 1e-15


def test_lists():
    weights = positive("1", "weights", is_list=True)
    assert weights.check((1, 2), "here") == [1.0, 2.0]
    for bad in (1.0, "12", {"a": 1}):
        with pytest.raises(InputError, match="list of numbers"):
            weights.check(bad, "here")
    with pytest.raises(InputError):
        weights.check([1.0, -2.0], "here")
    either = Parameter("m", "amplitude", 0.0, -1.0, 1.0)
    assert either.check([0.5, 1], "here") == [0.5, 1.0] and either.check(0.5, "here") == 0.5


def test_section_with_defaults_and_refusals():
    specs = {"mass": MASS, "gain": Spec("1", 0, 1, "gain", 0.25)}
    assert check_all(specs, {"mass": 2}, "here") == {"mass": 2.0, "gain": 0.25}
    with pytest.raises(InputError, match="here.mass: got None"):
        check_all(specs, {}, "here")
    with pytest.raises(InputError, match="here.weight: got 'unknown parameter', expected one of mass, gain"):
        check_all(specs, {"mass": 2, "weight": 1}, "here")
    with pytest.raises(InputError, match="a mapping"):
        check_all(specs, [2], "here")


def test_leaf_keeps_its_uncertainty_and_tolerance():
    leaf = {"value": 2.0, "unit": "kg", "source": "datasheet", "stderr": 0.1, "tolerance": 0.3}
    assert quantity_from(leaf, MASS, "here") == Quantity(2.0, "kg", "datasheet", 0.1, 0.3)
    assert quantity_from(leaf, MASS, "here").as_dict() == leaf


@pytest.mark.parametrize("change, place", [
    ({"unit": "g"}, "unit"), ({"source": "rumour"}, "source"), ({"tolerance": -0.1}, "tolerance"),
    ({"stderr": float("nan")}, "stderr"), ({"value": 0.1}, "here"), ({"note": "x"}, "here"),
])
def test_bad_leaves_are_refused_by_name(change, place):
    with pytest.raises(InputError, match=place):
        quantity_from({"value": 2.0, "unit": "kg", "source": "datasheet", **change}, MASS, "here")


def test_gains_are_checked_by_the_same_rule():
    gain = Gain("derivative_time", "s", 0.0, 1.0, 0.1, "T_D")
    assert check_gain("controller", gain, "4e-3") == 4e-3
    with pytest.raises(InputError, match="controller.derivative_time: got 2.0, expected 0 … 1 s"):
        check_gain("controller", gain, 2.0)
