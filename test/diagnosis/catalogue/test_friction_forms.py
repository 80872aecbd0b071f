"""Forms of the friction: none would drive."""

import numpy as np
import pytest

from microstage_ros.diagnosis.catalogue import forms_of

FRICTIONS = ("viscous_change", "friction_level_change", "position_dependent_friction")


@pytest.mark.parametrize("effect", FRICTIONS)
def test_no_friction_drives(effect):
    """A level of −0.085 and 4.25 times the viscosity stood for a dead band beside a soft drive (pairs, seed 10301, case 14), and one
    of 0.043 with 2.8 times the viscosity, and more, for 1.85 times the viscosity (seed 10701, case 54)."""
    forms = [form for form in forms_of("torque") if form.effect == effect]
    assert forms
    for form in forms:
        assert form.possible(np.array([-0.9]), None) and not form.possible(np.array([-1.085]), None)
        assert not form.possible(np.array([0.4, -1.085]), None) and not form.possible(np.array([-0.957]), None)
