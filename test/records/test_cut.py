"""``cut``: rows between two times, of any record to any kind of record."""

import numpy as np
import pytest

from microstage_ros.commands.messages.cut import between, main
from microstage_ros.identification.intake import take_in
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import Record, read_record, write_record

ROWS, PERIOD = 20_000, 1e-4


@pytest.fixture
def record():
    """Two seconds, of which a tenth of one has no reference: what a stop leaves."""
    time = PERIOD * np.arange(ROWS)
    reference = 1e-4 * np.sin(2.0 * np.pi * 2.0 * time)
    columns = {"encoder_m": reference + 1e-9, "reference_m": np.where((time > 1.5) & (time < 1.6), np.nan, reference),
               "voltage_V": 0.1 * np.cos(time), "current_A": 0.01 * np.sin(time)}
    return Record(PERIOD, columns, "stopped.csv", {"seed": 3})


@pytest.mark.parametrize("given", [".csv", ".mcap", ".csv.gz"])
@pytest.mark.parametrize("wanted", [".csv", ".mcap"])
def test_what_lies_between_two_times_is_the_same_in_every_kind_of_file(record, tmp_path, given, wanted, capsys):
    file, out = tmp_path / f"whole{given}", tmp_path / f"part{wanted}"
    write_record(record, file)
    assert main([str(file), "--from", "0.25", "--to", "1500ms", "--out", str(out)]) == 0
    assert "12500 rows, 0.25 to 1.4999 s" in capsys.readouterr().out
    part, rows = read_record(out), slice(2500, 15_000)
    for name in ("encoder_m", "reference_m", "voltage_V", "current_A"):
        assert part[name] == pytest.approx(record[name][rows], abs=1e-10 if name.endswith(("_V", "_A")) else 1e-13)
    assert part["t_s"][0] == (0.25 if wanted == ".csv" else 0.0) and part.period_s == pytest.approx(PERIOD)


def test_a_record_with_a_stop_is_of_use_up_to_it(record):
    """The refusal says at what time to cut."""
    axis = load_axis(config_file("axis.yaml"))
    with pytest.raises(InputError, match=r"reference_m, row 15002 \(1\.5001 s\).*microstage cut"):
        take_in(record, axis)
    assert len(take_in(between(record, end=1.5), axis)[0]) == 15_000
    assert len(between(record)) == ROWS and len(between(record, first=1.0)) == 10_000
    assert len(between(record, 0.1, 0.1002)) == 2      # both times as written in decimals


@pytest.mark.parametrize(("words", "says"), [
    (["--from", "3"], "goes from 0 to 1.9999 s"), (["--to", "0"], "goes from 0 to 1.9999 s"),
    (["--from", "1", "--to", "0.5"], "--to: got 0.5"), (["--from", "nan"], "a time such as")])
def test_times_that_leave_nothing_are_refused(record, tmp_path, words, says, capsys):
    write_record(record, tmp_path / "whole.csv")
    with pytest.raises((InputError, SystemExit)) as refusal:
        main([str(tmp_path / "whole.csv"), "--out", str(tmp_path / "part.csv"), *words])
    assert says in f"{refusal.value}{capsys.readouterr().err}"
    assert not (tmp_path / "part.csv").exists()


def test_a_record_is_not_written_over(record, tmp_path):
    file = tmp_path / "whole.csv"
    write_record(record, file)
    for words, says in ((["--out", str(file), "--force"], "another file"), (["--out", str(tmp_path / "x.txt")], ".mcap, .csv")):
        with pytest.raises(InputError, match=says):
            main([str(file), *words])
    (tmp_path / "part.csv").write_text("mine")
    with pytest.raises(InputError, match="--force"):
        main([str(file), "--out", str(tmp_path / "part.csv")])
    assert (tmp_path / "part.csv").read_text() == "mine" and len(read_record(file)) == ROWS
