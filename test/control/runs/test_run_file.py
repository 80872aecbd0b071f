"""Run files: what is accepted becomes the right tables, what is wrong is named."""

import numpy as np
import pytest

from microstage_ros.control.runs.run_file import load_run, run_from_dict
from microstage_ros.quantities.errors import InputError

T = 1e-4


def test_segments_follow_each_other():
    run = run_from_dict({"program": [
        {"move_to_m": 1e-5, "dwell_s": 0.05},
        {"sine": {"amplitude_m": 2e-6, "frequency_hz": 20.0, "cycles": 1}},
        {"scan": {"to_m": 0.0, "speed_m_s": 1e-3}, "dwell_s": 0.01},
    ]})
    tables = run.tables(T)
    reference = tables["reference"]
    assert tables["start"] == 0.0 and reference[0] == 0.0 and reference[-1] == 0.0
    assert np.abs(np.diff(reference)).max() < 2e-3 * T  # no segment steps
    assert reference.max() == pytest.approx(1.2e-5, rel=1e-3)
    assert np.all(reference[-100:] == 0.0)
    assert not tables["open_loop"].any() and not tables["disturbance"].any()


def test_tables_come_from_files_beside_the_run_file(tmp_path):
    (tmp_path / "r.csv").write_text("# comment\nt_s,reference_m,disturbance_V\n0,1e-6,0\n0.0001,2e-6,0.5\n0.0002,2e-6,\n".replace("2e-6,\n", "2e-6,0\n"))
    (tmp_path / "u.csv").write_text("t_s,voltage_V\n0,0.1\n0.0001,0.2\n")
    (tmp_path / "a.yaml").write_text("program:\n  - {reference_file: r.csv}\n  - {move_to_m: 2.0e-6, dwell_s: 0.0002}\n")
    tables = load_run(tmp_path / "a.yaml").tables(T)
    np.testing.assert_array_equal(tables["reference"][:3], [1e-6, 2e-6, 2e-6])
    np.testing.assert_array_equal(tables["disturbance"][:3], [0, 0.5, 0])
    assert tables["start"] == 1e-6
    (tmp_path / "b.yaml").write_text("controller: {type: none}\nprogram:\n  - {voltage_file: u.csv}\n")
    np.testing.assert_array_equal(load_run(tmp_path / "b.yaml").tables(T)["open_loop"], [0.1, 0.2])
    (tmp_path / "c.yaml").write_text("program:\n  - {voltage_file: u.csv}\n")
    with pytest.raises(InputError, match="none"):
        load_run(tmp_path / "c.yaml")
    with pytest.raises(InputError, match="period"):
        load_run(tmp_path / "b.yaml").tables(1e-3)


MOVE = [{"move_to_m": 1e-6}]


@pytest.mark.parametrize("tree, place", [
    ({"program": MOVE, "speed": 1}, "speed"),
    ({"program": []}, "program"),
    ({"program": [{"jump_to_m": 1.0}]}, "program[1]"),
    ({"program": [{"move_to_m": "far"}]}, "program[1].move_to_m"),
    ({"program": [{"move_to_m": 1e-6, "dwell_s": -1}]}, "program[1].dwell_s"),
    ({"program": MOVE + [{"sine": {"amplitude_m": 1e-6, "cycles": 1}}]}, "program[2].sine.frequency_hz"),
    ({"program": [{"sine": {"amplitude_m": 1e-6, "frequency_hz": 0, "cycles": 1}}]}, "sine.frequency_hz"),
    ({"program": [{"voltage_file": "absent.csv"}]}, "voltage_file"),
    ({"program": MOVE, "period_s": 0}, "period_s"),
    ({"program": MOVE, "controller": []}, "controller"),
    ({"program": MOVE, "noise": 0}, "noise"),
    ({"program": MOVE, "effects": False}, "effects"),
    ({"program": MOVE, "limits": ""}, "limits"),
    ({"program": MOVE, "noise": {"encoder": 1e-9}}, "noise: encoder"),
    ({"program": MOVE, "noise": {"encoder_m": -1e-9}}, "noise.encoder_m"),
    ({"program": MOVE, "controller": {"type": "magic"}}, "controller.type"),
    ({"program": MOVE, "effects": {"ghosts": {}}}, "effects: ghosts"),
    ({"program": MOVE, "limits": {"velocity_m_s": 0}}, "limits.velocity_m_s"),
    ([], "run"),
])
def test_what_is_wrong_is_named(tree, place):
    with pytest.raises(InputError) as caught:
        run_from_dict(tree)
    assert place in caught.value.place and "\n" not in str(caught.value)


def test_unreadable_files_are_told_in_one_line(tmp_path):
    (tmp_path / "bad.yaml").write_text("program: [\n")
    for name in ("bad.yaml", "absent.yaml"):
        with pytest.raises(InputError) as caught:
            load_run(tmp_path / name)
        assert name in str(caught.value) and "\n" not in str(caught.value)


def test_contacts_begin_loaded_where_friction_is_random_and_relaxed_where_it_is_not(axis):
    """The friction felt in the first row: drawn by the seed, or none."""
    from microstage_ros.control.runs.simulate import simulate

    still = {"encoder_m": 0.0, "voltage_V": 0.0, "interferometer_m": 0.0}
    tree = {"controller": {"type": "none"}, "noise": still, "program": [{"move_to_m": 0.0, "dwell_s": 0.001}]}

    def first(seed=1, **more):
        columns = simulate(axis, run_from_dict({**tree, **more}), seed)
        return columns["actuator_friction_Nm"][0], columns["guideway_friction_N"][0]

    loaded = np.array([first(seed) for seed in range(8)])
    assert len(np.unique(loaded[:, 0])) == 8 and np.any(loaded > 0) and np.any(loaded < 0)
    assert np.all(np.abs(loaded[:, 0]) < 219e-6 * 1.15) and np.all(np.abs(loaded[:, 1]) < 0.9 * 1.15)
    assert first(3) == first(3)
    nothing = pytest.approx((0.0, 0.0), abs=1e-15)  # N m, N: what the last bits of a first state may make
    assert first(noise={**still, "friction_relative": 0.0}) == nothing
    assert first(start={"friction": "relaxed"}) == nothing
    assert first(noise={**still, "friction_relative": 0.0}, start={"friction": "random"}) != nothing


@pytest.mark.parametrize("start, words", [
    ({"friction": "loaded"}, ("start.friction", "loaded", "random, relaxed")),
    ({"position": 1.0}, ("start", "position", "friction")),
    ("random", ("start", "random", "friction")),
])
def test_a_bad_start_is_refused_in_one_line(start, words):
    with pytest.raises(InputError) as refused:
        run_from_dict({"program": [{"move_to_m": 0.0}], "start": start})
    assert all(word in str(refused.value) for word in words) and "\n" not in str(refused.value)
