"""Names, numbers, parameters and their errors."""

import numpy
import pytest
from law_contact import CURVE, OWN, pack

from microstage_ros.model.friction.registry import LAWS, NAMES, law_named, run_law, stretch_law
from microstage_ros.quantities.errors import InputError


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_the_compiled_door_leads_to_the_law_of_that_number(law):
    _, packed = pack(law.name)
    through, direct = law.initial_state(packed), law.initial_state(packed)
    for _ in range(3):
        force = stretch_law(law.number, packed, through, 1.0, 0.2, 0.4, 0.03, 1.0)
        assert force == law.file.stretch(packed, direct, 1.0, 0.2, 0.4, 0.03, 1.0)
        assert through.tolist() == direct.tolist()


def test_the_eight_laws_are_there_once():
    assert set(NAMES) == set(OWN)
    assert [law.number for law in LAWS] == list(range(8))
    assert law_named("lugre").file.TITLE == "LuGre"


def test_parameters_of_the_negative_direction_default_to_the_positive():
    packed = law_named("maxwell_slip").pack({"static": 2.0, "viscous": 3.0, "stiffness": (1.0,), "weight": (1.0,)})
    assert packed[:5].tolist() == packed[5:10].tolist() == [2.0, 2.0, 1.0, 1.0, 3.0]
    _, packed = pack("maxwell_slip")
    assert packed[:10].tolist() == [1.0, 0.6, 0.5, 1.3, 0.05, 0.9, 0.7, 0.5, 1.3, 0.08]


def test_weights_are_normalised():
    _, packed = pack("maxwell_slip", weight=(5.0, 3.0, 2.0))
    assert packed[-3:] == pytest.approx([0.5, 0.3, 0.2])


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("maxwell_slip", {"static": 0.0}, "static.*0.0.*> 0"),
        ("maxwell_slip", {"coulomb": 1.5}, "coulomb.*1.5.*at most"),
        ("maxwell_slip", {"viscous": -1.0}, "viscous.*-1.0.*>= 0"),
        ("maxwell_slip", {"weight": (1.0,)}, "weight.*as many"),
        ("maxwell_slip", {"stiffness": (1.0, -2.0, 1.0)}, "stiffness.*> 0"),
        ("maxwell_slip", {"weight": ("a", "b", "c")}, "weight.*numbers"),
        ("maxwell_slip", {"viscous": "low"}, "viscous.*low"),
        ("lugre", {"damping": -0.1}, "damping.*-0.1.*>= 0"),
        ("maxwell_slip", {"attraction": 1.0}, "attraction.*one of"),
        ("dahl", {"stiffness": float("nan")}, "stiffness.*nan"),
        ("elasto_plastic", {"breakaway_share": 1.0}, "breakaway_share.*1.0"),
        ("leuven", {"exponent": 0.5}, "exponent.*1 … 50"),
        ("hsieh_pan", {"hardening": 0.0}, "hardening"),
        ("generalised_maxwell_slip", {"attraction": "fast"}, "attraction.*fast"),
    ],
)
def test_a_bad_parameter_is_named_with_its_value_and_what_would_be_right(name, changes, message):
    with pytest.raises(InputError, match=message) as error:
        pack(name, **changes)
    assert str(error.value).startswith(name)


def test_missing_parameters_and_unknown_laws_are_named():
    with pytest.raises(InputError, match="static"):
        law_named("dahl").pack({"stiffness": 1.0})
    with pytest.raises(InputError, match="stiffness"):
        law_named("dahl").pack(CURVE)
    with pytest.raises(InputError, match="lugre"):
        law_named("lugr")


@pytest.mark.parametrize("velocity", [[], [0.0, numpy.inf], numpy.zeros((2, 2))])
def test_a_velocity_that_cannot_be_followed_is_refused(velocity):
    law, packed = pack("dahl")
    with pytest.raises(InputError, match="velocity"):
        run_law(law, packed, velocity, 1e-3)
