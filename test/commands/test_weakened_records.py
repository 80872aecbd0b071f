"""What weakens a record is said by the commands that read it."""

import types

import numpy as np

import pytest

from microstage_ros.commands.analysis import identify, tune
from microstage_ros.commands.messages import replay
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.monitoring.windows import windows_of
from microstage_ros.records import Record, read_record, write_record
from microstage_ros.records.bags import bag_writer
from microstage_ros.records.checks import check_record

AXIS = load_axis(config_file("axis.yaml"))


def moving(rows=20_000, period=1e-4, **more):
    """A record of some motion."""
    resolution, generator = AXIS.value("sensors.encoder.resolution"), np.random.default_rng(1)
    place = np.round(1e-3 * np.sin(np.arange(rows) * 1e-3) / resolution) * resolution
    volts = generator.normal(size=rows)
    return Record(period, {"encoder_m": place, "reference_m": place, "voltage_V": volts, "current_A": volts / 10}, **more)


def test_tuning_a_running_cell_says_what_weakens_its_record(tmp_path, monkeypatch, capsys):
    record = moving(period=2e-4, remarks=("bag: 1 stop of the host",))
    found = types.SimpleNamespace(estimates={}, to_axis=lambda axis: axis)
    monkeypatch.setattr("microstage_ros.commands.operation.experiment.recorded_beside", lambda *_: None)
    monkeypatch.setattr("microstage_ros.records.read_record", lambda _: record)
    monkeypatch.setattr("microstage_ros.identification.pipeline.identify", lambda records, *_: list(records) and found)
    asked = types.SimpleNamespace(record=str(tmp_path / "run"), force=False, namespace="/axis", seed=0)
    assert tune._identified_running(asked, AXIS) is AXIS
    said = capsys.readouterr().err
    assert "warning: bag: 1 stop of the host\n" in said and "sampled every 0.0002 s, the axis every 0.0001 s" in said


@pytest.fixture
def cut(tmp_path, monkeypatch):
    """A bag of 2 s of which the second half is lost."""
    monkeypatch.setattr(bag_writer, "CHUNK_BYTES", 100_000)
    write_record(moving(), tmp_path / "whole.mcap")
    raw = (tmp_path / "whole.mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(raw[: len(raw) // 2])
    return path


def test_a_bag_that_was_cut_off_is_read_with_a_warning(cut, capsys, monkeypatch):
    assert not read_record(cut.with_name("whole.mcap")).remarks
    record = read_record(cut)
    (remark,) = record.remarks
    assert remark.startswith(f"{cut}: cut off after ") and f"`microstage recover {cut}`" in remark
    assert check_record(record, AXIS, 0.1)[0] == remark
    list(windows_of(record, 0.5))
    monkeypatch.setattr(replay, "_replay", lambda *_: 0)
    replay.main([str(cut)])
    identify.tell(types.SimpleNamespace(estimates={}, remarks=()), cut, [remark])
    assert capsys.readouterr().err == 3 * f"warning: {remark}\n"
