"""What weakens a record is said by the commands that read it."""

import types

import numpy as np

from microstage_ros.commands.analysis import tune
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.records import Record

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
