"""The floor of a held-out record: what the same machine leaves of the same programme with nothing wrong in it."""

import math
import types

import numpy as np
import pytest

from microstage_ros.diagnosis.residuals.evidence_set import Choice
from microstage_ros.diagnosis.result import Cause, Diagnosis
from microstage_ros.diagnosis.selection.leftover import over_twin
from microstage_ros.diagnosis.validation import campaign, second_world, simulated_records
from microstage_ros.diagnosis.validation.simulated_records import Hidden
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file

ROWS = np.array([1000.0, 1000.0, 400.0])
LAG = Hidden("lag", ("frictional_lag",), {"frictional_lag": {"time_s": 0.02}})


def energies(per_row):
    """Evidence of a channel that leaves so much in each stretch of 2 s."""
    return types.SimpleNamespace(energies=lambda keys, beta, length: (np.array(per_row) * ROWS, ROWS))


def left_over(held, twin, scale=1.0):
    learn = types.SimpleNamespace(fit=lambda keys: (np.zeros(len(keys)), None, 0.0))
    evidences = types.SimpleNamespace(held={"torque": energies(held)}, learn={"torque": learn}, scatter={"torque": scale}, forms=[])
    groups = {"learn": [], "held": [], "base": []} | ({"twin": ["one"]} if twin else {})
    collection = types.SimpleNamespace(channels=groups, growing=lambda channel, forms, group: energies(twin))
    return over_twin(collection, evidences, [Choice("frictional_lag", ())])


def test_what_is_left_is_counted_from_what_the_twin_leaves_of_the_same_rows():
    assert left_over([0.7, 0.9, 0.8], []) == {}
    assert left_over([0.7, 0.9, 0.8], [0.7, 0.9, 0.8])["torque"] == pytest.approx((0.0, 0.0), abs=1e-9)
    more, stderr = left_over([0.8, 1.0, 0.9], [0.7, 0.9, 0.8], scale=2.0)["torque"]
    assert (more, stderr) == pytest.approx((0.1 * 2400 / 2.0, 0.0))       # loud stretches of both are no uncertainty


def test_positions_of_the_twin_are_weighed_by_the_reading_noise_of_the_held_out_record():
    """A resting stage that shakes from count to count, or does not, makes the estimate of one and the same noise another."""
    mine, its = types.SimpleNamespace(scatter=4.4e-9), types.SimpleNamespace(scatter=4.6e-9)
    evidence = energies([1.0, 1.0, 1.0])
    evidences = types.SimpleNamespace(held={"position": evidence}, learn={"position": types.SimpleNamespace(fit=lambda keys: (np.zeros(0),))},
                                      scatter={"position": 1.0}, forms=[])
    weighed = []
    collection = types.SimpleNamespace(
        channels={"held": [{"position": mine}], "twin": [{"position": its}]},
        growing=lambda channel, forms, group: weighed.append(its.scatter) or evidence)
    over_twin(collection, evidences, [])
    assert weighed == [mine.scatter]


def test_its_error_is_how_the_stretches_disagree():
    more, stderr = left_over([0.7, 1.2, 0.8], [0.7, 0.9, 0.8])["torque"]
    mean = 300.0 / 2400.0
    scatter = math.sqrt((300.0 - 1000.0 * mean) ** 2 + (1000.0 * mean) ** 2 + (400.0 * mean) ** 2)
    assert (more, stderr) == pytest.approx((300.0, scatter * math.sqrt(1.5)))


def test_nine_tenths_of_the_way_are_asked_and_a_wrong_name_never_goes_them():
    assert campaign.reached(("", True, 900.0, 99.0, 10.0)) and campaign.reached(("", True, 900.0, -50.0, 10.0))
    assert not campaign.reached(("", True, 900.0, 101.0, 10.0))
    assert campaign.reached(("", True, 900.0, 101.0, 10.0), campaign.SIGMAS)
    assert not campaign.reached(("", True, 900.0, 121.0, 10.0), campaign.SIGMAS)
    assert not campaign.reached(("", False, 900.0, -50.0, 10.0), campaign.SIGMAS)


def test_every_named_cause_is_counted():
    causes = tuple(Cause(name, {}, {}, 0.9, 0.5, None, channel, evidence=800.0, clarity=0.8)
                   for name, channel in (("frictional_lag", "torque"), ("transport_delay", "command")))
    ways = tuple(campaign._ways(Diagnosis("explained", causes, floors={"torque": (50.0, 20.0)}), LAG))
    assert ways[0] == ("frictional_lag", True, 800.0, 50.0, 20.0)
    assert ways[1][:3] == ("transport_delay", False, 800.0) and ways[1][3:] == pytest.approx((200.0, 0.0))
    known = dict(number=0, kind="single", hidden=LAG.ids, name="", verdict="explained", rivals=(), covered=(), before=1.0,
                 after=0.5, floor=0.5, seconds=1.0, sizes={})
    counts, _ = campaign.scores([campaign.Outcome(**known, named=LAG.ids, ways=ways)])
    assert counts[campaign.OVER_TWIN] == (1, 2)


@pytest.mark.parametrize("world", [simulated_records, second_world])
def test_a_twin_is_the_held_out_record_without_what_was_hidden(world, monkeypatch):
    asked = []
    monkeypatch.setattr(world, "_record", lambda *details: asked.append(details))
    axis = load_axis(config_file("axis.yaml"))
    world.make_case(axis, LAG, 7)
    hold = asked[2]
    del asked[:]
    world.make_twin(axis, LAG, 7)
    (twin,) = asked
    where = hold.index(LAG)
    assert twin[where].name == "healthy" and not twin[where].effects
    same = [[str(detail.as_dict()) if hasattr(detail, "as_dict") else detail for detail in (*d[:where], *d[where + 1:])] for d in (hold, twin)]
    assert same[0] == same[1]


def test_the_twin_of_another_level_varies_by_as_many_newtons(monkeypatch):
    """Friction varies in proportion to itself: what of its random part grew with the level is not to be explained. Over a twin of the
    old level all seven cases of less friction left less than nothing, four of five of more friction something (seed 20301)."""
    asked = []
    monkeypatch.setitem(campaign.WORLDS, "second", lambda *machine: ([], [], []))
    monkeypatch.setitem(campaign.TWINS, "second", lambda axis, what, seed, friction: asked.append(friction) or [])
    monkeypatch.setattr(campaign, "diagnose_records", lambda *given, **more: Diagnosis("agrees"))
    for one in campaign.examinations(3, 20301, str(config_file("axis.yaml")), "single", effect="friction_level_change", world="second"):
        what, friction = campaign.draw(one)
        campaign.examine(one)
        assert asked[-1] == pytest.approx(friction * what.effects["friction_level_change"]["factor"])
    assert campaign._level(LAG) == 1.0
