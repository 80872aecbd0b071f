"""The choice of law and gains: margins on the axis and on draws."""

from machines import random_axis

from microstage_ros.commissioning.design.law_choice import BARE, OBSERVER, OBSERVER_GAIN, OBSERVER_PHASE, choose_law, observer_gains
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import controller_margins
from microstage_ros.control.tuning.tuning import GUARDED
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file


def _worst(axis, gains):
    found = [m for m in controller_margins(axis, controller_parameters(OBSERVER, axis, gains)) if m.regime in GUARDED]
    return all(m.stable for m in found), min(m.phase_deg for m in found), min(m.gain_db for m in found)


def test_observer_law_gives_way_until_it_has_margins():
    axis = load_axis(config_file("axis.yaml")).with_controller({"type": OBSERVER})
    plain = _worst(axis, {})
    gains, reach, _ = observer_gains(axis, [])
    stable, phase, gain = _worst(axis, gains)
    assert plain[2] < OBSERVER_GAIN  # the rule's own gains have less
    assert reach >= 1.0 and stable and phase >= OBSERVER_PHASE and gain >= OBSERVER_GAIN


def test_law_without_margin_is_not_taken():
    axis = random_axis(load_axis(config_file("axis.yaml")).with_controller({"type": OBSERVER}), 16)  # soft, hardly damped drive train
    axis = axis.with_values({"stage.mass": 6.0 * axis.value("stage.mass")}, source="derived")  # that no doubt in the encoder holds
    assert observer_gains(axis, [])[1] < BARE
    law, _, why = choose_law(axis, [], True)
    assert law == "self_tuning_feedforward" and OBSERVER in why


def test_without_a_current_the_law_is_encoder_only():
    axis = load_axis(config_file("axis.yaml"))
    assert choose_law(axis, [], False)[0] == "self_tuning_feedforward"
