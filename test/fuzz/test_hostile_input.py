"""Anything at all in the place of a file, a goal or a message: it is accepted as it should be or refused in one line.

Examples are few here so that the suite stays quick; `./microstage faults --files N --messages N` goes through any number. A
failing example is printed with what reproduces it.
"""

import math

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.control.trajectories.move import check_move
from microstage_ros.control.trajectories.profiles import MotionLimits, jerk_limited_move
from microstage_ros.control.trajectories.reference_player import ReferencePlayer
from microstage_ros.model.axis_file import axis_from_dict
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.yaml_text import yaml_tree
from microstage_ros.records.bags.bag_reader import Bag
from microstage_ros.records.bags.recovery import recover
from microstage_ros.records.csv_file import read_csv
from microstage_ros.records.logs.description import description_of
from microstage_ros.records.logs.log import read_log

FEW = settings(max_examples=60, deadline=None, print_blob=True, suppress_health_check=list(HealthCheck))

WORDS = st.one_of(st.text(max_size=8), st.sampled_from(["value", "unit", "m", "type", "pid", "cycles", "12:30:45", "1e5", "nan", "~"]))
NUMBERS = st.one_of(st.floats(), st.integers(), st.sampled_from([0.0, -1.0, 5e-324, 1e308, math.nan, math.inf, 2**63, -(2**63)]))
SCALARS = st.one_of(st.none(), st.booleans(), NUMBERS, WORDS)
TREES = st.recursive(SCALARS, lambda inner: st.one_of(
    st.lists(inner, max_size=4), st.dictionaries(st.one_of(WORDS, st.integers(), st.booleans(), st.none()), inner, max_size=4)), max_leaves=12)

AXIS = yaml.safe_load(config_file("axis.yaml").read_text(encoding="utf-8"))
RUN = yaml.safe_load("{controller: {type: pid}, noise: {encoder_m: 1.0e-8}, limits: {velocity_m_s: 1.0e-3}, start: {friction: random}, program: "
                     "[{move_to_m: 1.0e-5, dwell_s: 0.01}, {sine: {amplitude_m: 1.0e-6, frequency_hz: 20, cycles: 1}}, "
                     "{scan: {to_m: 1.0e-5, speed_m_s: 1.0e-3}}]}")
LOG = {"time": {"column": "t", "unit": "s"}, "position": {"column": "x", "unit": "mm"}, "current": {"column": "i", "unit": "A"}}


def places(tree, here=()):
    """Paths to every entry of plain data."""
    entries = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    return [path for key, child in entries for path in ((*here, key), *places(child, (*here, key)))]


def replaced(tree, path, value):
    """Plain data with one entry replaced."""
    if not path:
        return value
    copy = dict(tree) if isinstance(tree, dict) else list(tree)
    copy[path[0]] = replaced(copy[path[0]], path[1:], value)
    return copy


def accepted(read, *arguments):
    """True if it was accepted, False if it was refused in one line; anything else fails the test."""
    try:
        read(*arguments)
    except InputError as error:
        assert "\n" not in str(error) and len(str(error)) < 2000
        return False
    return True


READ = {"axis": (AXIS, axis_from_dict), "run": (RUN, lambda tree: run_from_dict(tree).tables(1e-3)),
        "log": (LOG, lambda tree: description_of(tree, "LOG.yaml"))}


@pytest.mark.parametrize("kind", READ)
@given(data=st.data())
@FEW
def test_any_entry_replaced_by_anything(kind, data):
    good, read = READ[kind]
    assert accepted(read, good)
    accepted(read, replaced(good, data.draw(st.sampled_from(places(good))), data.draw(TREES)))
    accepted(read, data.draw(TREES))


@given(text=st.one_of(st.text(max_size=200), st.binary(max_size=200).map(lambda raw: raw.decode("latin-1"))))
@FEW
def test_any_text_as_yaml(text):
    accepted(yaml_tree, text, "here")


@given(raw=st.one_of(st.binary(max_size=300), st.text(alphabet="0123456789.,-e\n\rtx_sV\"'#; ", max_size=300).map(
    lambda text: ("t_s,encoder_m,reference_m,voltage_V\n" + text).encode())))
@FEW
def test_any_bytes_as_csv(tmp_path_factory, raw):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(raw)
    accepted(read_csv, path)
    accepted(read_log, path, description_of({name: dict(entry) for name, entry in LOG.items()}, "LOG.yaml"))


@given(raw=st.binary(max_size=400), head=st.booleans())
@FEW
def test_any_bytes_as_bag(tmp_path_factory, raw, head):
    path = tmp_path_factory.getbasetemp() / "any.mcap"
    path.write_bytes((b"\x89MCAP0\r\n" if head else b"") + raw)
    accepted(Bag, path)
    accepted(recover, path)


@given(*[NUMBERS.map(float)] * 4)
@settings(FEW, max_examples=300)
def test_any_goal(target, tolerance, settle_time, timeout):
    if accepted(check_move, target, tolerance, settle_time, timeout, (-0.025, 0.025)):
        assert abs(target) <= 0.025 and tolerance > 0.0 and 0.0 <= settle_time <= timeout <= 86_400.0


@given(*[NUMBERS.map(float)] * 5)
@settings(FEW, max_examples=200)
def test_any_motion(start, target, velocity, acceleration, jerk):
    with np.errstate(all="ignore"):
        try:
            positions = jerk_limited_move(start, target, 1e-3, MotionLimits(velocity, acceleration, jerk))
        except InputError:
            return
    assert np.isfinite(positions).all() and positions[-1] == target
    assert min(start, target) - 1e-9 * abs(start - target) <= positions.min() and positions.max() <= max(start, target) + 1e-9 * abs(start - target)


@given(st.integers(-2**63, 2**63), st.lists(NUMBERS.map(float), max_size=6))
@settings(FEW, max_examples=200)
def test_any_reference(start, positions):
    player = ReferencePlayer(1e-4, 0.02, 0.05)
    player.at(10, 1e-3)
    if accepted(lambda *given: player.follow(given[0], player.checked(given[1])), start, positions) and positions:
        assert all(map(math.isfinite, positions)) and max(map(abs, np.diff([1e-3, *positions])), default=0.0) <= 0.05 * 1e-4 + 1e-9
    reference, _ = player.at(11, 1e-3)
    assert abs(reference - 1e-3) <= 0.05 * 1e-4 + 1e-9


@pytest.mark.parametrize("end", ["\n", "\r", "\v", "\x1c", "\x85", "\u2028"])
def test_a_key_that_ends_a_line_is_shown_in_one(end):
    with pytest.raises(InputError) as caught:
        run_from_dict({"controller": {"type": "pid"}, "program": [], end: None})
    assert len(str(caught.value).splitlines()) == 1
