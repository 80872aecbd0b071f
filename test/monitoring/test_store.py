"""The history outlives the process, and belongs to one axis."""

import sqlite3

import pytest

from microstage_ros.monitoring.health import ChannelHealth
from microstage_ros.monitoring.store import Store
from microstage_ros.quantities.errors import InputError


def test_what_is_kept_is_there_again(tmp_path):
    path = tmp_path / "health.sqlite"
    with Store(path, "left", 20.0) as store:
        for number in range(9):
            store.add_healthy(20.0 * number, "rec", {("torque", "level"): 0.01 * (-1) ** number})
        store.add_health(200.0, "rec", {"torque": ChannelHealth(1.2, "level", True, 180.0)})
    with Store(path, "left", 20.0) as store:
        reference = store.reference()
        assert reference.windows == 9 and set(reference.spread) == {("torque", "level")}
        assert store.history("torque") == [(200.0, "rec", "torque", 1.2, "level", 1, 180.0)]
        assert store.history("windup") == []
        store.add_health(0.0, "next", {"torque": ChannelHealth(1.5, "level", True, 180.0, "rec")})
        assert [row[:2] for row in store.history("torque")] == [(200.0, "rec"), (0.0, "next")]  # as they were judged


@pytest.mark.parametrize("axis, window_s, words", [("right", 20.0, "axis"), ("left", 10.0, "window_s")])
def test_another_axis_or_window_is_refused(tmp_path, axis, window_s, words):
    Store(tmp_path / "health.sqlite", "left", 20.0).close()
    with pytest.raises(InputError, match=words):
        Store(tmp_path / "health.sqlite", axis, window_s)


def test_a_file_that_is_no_history_is_refused(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("no database, but long enough to be mistaken for one\n" * 40)
    with pytest.raises(InputError, match="notes.txt"):
        Store(path, "left", 20.0)
    path.write_text("x")  # SQLite takes so short a file for an empty base, and wrote over it
    with pytest.raises(InputError, match="notes.txt"):
        Store(path, "left", 20.0)
    assert path.read_text() == "x"
    with pytest.raises(InputError, match="nowhere"):
        Store(tmp_path / "nowhere" / "health.sqlite", "left", 20.0)


def test_a_window_that_is_learned_again_counts_once(tmp_path):
    """The same command on the same history doubled the healthy windows, and the threshold was too narrow for it."""
    for _ in range(2):
        with Store(tmp_path / "health.sqlite", "left", 20.0) as store:
            for number in range(9):
                store.add_healthy(20.0 * number, "rec", {("torque", "level"): 0.01 * number})
    with Store(tmp_path / "health.sqlite", "left", 20.0) as store:
        assert len(store.healthy()) == 9


@pytest.mark.parametrize("statements, words", [
    (["CREATE TABLE cats (a TEXT)"], "tables cats"),  # of another program: it was given the tables of a history
    (["CREATE TABLE facts (a TEXT)", "CREATE TABLE healthy (a TEXT)", "CREATE TABLE health (time REAL)"], "no such column"),
    (["CREATE TABLE facts (name TEXT, value TEXT)", "CREATE TABLE healthy (a TEXT)", "CREATE TABLE health (time REAL)",
      "INSERT INTO facts VALUES ('axis', 'no JSON')"], "Expecting value")])
def test_a_database_that_is_no_history_is_refused_in_one_line(tmp_path, statements, words):
    path = tmp_path / "other.sqlite"
    with sqlite3.connect(path) as base:
        for statement in statements:
            base.execute(statement)
    base.close()
    before = path.read_bytes()
    with pytest.raises(InputError, match=f"other.sqlite.*{words}.*a history file of watch"):
        Store(path, "left", 20.0)
    assert words != "tables cats" or path.read_bytes() == before


def test_a_damaged_history_is_refused_in_one_line(tmp_path):
    path = tmp_path / "health.sqlite"
    with Store(path, "left", 20.0) as store:
        for number in range(200):
            store.add_healthy(20.0 * number, "rec", {("torque", "level"): 0.01 * number})
    whole = bytearray(path.read_bytes())
    whole[5000:9000] = b"\xff" * 4000
    path.write_bytes(whole)
    with pytest.raises(InputError, match="health.sqlite.*a history file of watch"):
        Store(path, "left", 20.0)
