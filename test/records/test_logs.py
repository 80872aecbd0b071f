"""Logs of other machines are read as they are: formats, units, and what is odd about them."""

import contextlib

import numpy as np
import pytest
from scipy.io import savemat

from microstage_ros.commands.analysis import log as log_command
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.logs import read_log, text_table
from microstage_ros.records.logs.description import description_of
from microstage_ros.records.logs.log import read_table
from microstage_ros.records.logs.propose import propose
from microstage_ros.records.logs.units import known_unit
from test.diagnosis.logs.test_file_kinds import joint_states

BASIC = {"time": {"column": "t", "unit": "s"}, "position": {"column": "x", "unit": "mm"}, "current": {"column": "i", "unit": "A"}}


def described(**changes):
    """A description of the basic log with changes."""
    return description_of({**BASIC, **changes}, "LOG.yaml")


def rows(n=200, rate=100.0):
    """Time [s], place [mm], current [A] of a slow sine."""
    t = np.arange(n) / rate
    return t, 10.0 * np.sin(t), 0.3 * np.sign(np.cos(t)) + 0.01 * np.sin(37.0 * t)


def write(path, header, columns, separator=",", preamble="", number="{:.9g}".format):
    """A text file of columns."""
    lines = [separator.join(number(v) for v in row) for row in zip(*columns)]
    path.write_text(preamble + header + "\n" + "\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("unit, dimension, factor", [
    ("mm", "length", 1e-3), ("µm", "length", 1e-6), ("rpm", "angular speed", 2 * np.pi / 60), ("kgf", "force", 9.80665), ("lbf", "force", 4.4482216),
    ("mN m", "torque", 1e-3), ("mNm", "torque", 1e-3), ("deg", "angle", np.pi / 180), ("%", "ratio", 0.01), ("ms", "time", 1e-3), ("lbf in", "torque", 0.1129848)])
def test_units_of_people(unit, dimension, factor):
    found = known_unit(unit)
    assert found[0] == dimension and found[1] == pytest.approx(factor, rel=1e-6)


@pytest.mark.parametrize("separator, comma", [(",", False), (";", False), (";", True), ("\t", True), (" ", False)])
def test_any_separator_and_decimal_comma(tmp_path, separator, comma):
    t, x, i = rows()
    number = (lambda v: f"{v:.9g}".replace(".", ",")) if comma else "{:.9g}".format
    path = write(tmp_path / "log.txt", separator.join(["t", "x", "i"]), (t, x, i), separator, "Exported by a drive\nof 2024\n\n", number)
    log = read_log(path, described())
    assert len(log) == 200 and log.signals["position"] == pytest.approx(1e-3 * x, abs=1e-9)
    assert log.period == pytest.approx(0.01)


def test_epos_preamble_and_units_line(tmp_path):
    text = 'Date:;2020-07-08 22:13:00\nEPOS Studio Version:;3.6.1.0\nSampling period:;10.000\n"Trigger:;0;0.0;""Channel 1"""\n;Velocity;Torque\nms;rpm;%\n'
    text += "".join(f"{10 * k}.000;{60 if k % 20 < 10 else -60};{25.0 + k % 3:.1f}\n" for k in range(100))
    (tmp_path / "1.csv").write_text(text)
    log = read_log(tmp_path / "1.csv", description_of({
        "time": {"column": "time", "unit": "ms"}, "velocity": {"column": "Velocity", "unit": "rpm"}, "torque": {"column": "Torque", "unit": "%"},
        "nominal_torque": {"value": 10, "unit": "mN m"}, "lead": {"value": 2, "unit": "mm"}}, "LOG.yaml"))
    assert np.abs(log.signals["velocity"]).max() == pytest.approx(2e-3)          # one turn a second on a lead of 2 mm
    assert log.signals["torque"][0] == pytest.approx(2.5e-3) and log.effort_unit == "N m"


def test_halscope(tmp_path):
    text = "Sampling period is 1000000 ns \n\n" + "\n".join(f"pos {0.1 * k:+.6f} ferror {0.001 * (k % 7):+.6f} " for k in range(60))
    (tmp_path / "scope.log").write_text(text)
    log = read_log(tmp_path / "scope.log", description_of({
        "time": {"column": "time", "unit": "s"}, "reference": {"column": "pos", "unit": "mm"}, "following_error": {"column": "ferror", "unit": "mm"}}, "L"))
    assert log.period == pytest.approx(1e-3) and log.signals["position"][10] == pytest.approx(1e-3 * (1.0 - 0.003))


def test_camonitor_holds_values(tmp_path):
    lines = []
    for k in range(60):
        lines.append(f"M1.RBV 2024-05-01 12:00:{k // 2:02d}.{500000 * (k % 2):06d} {0.1 * k:.3f}")
        if k % 3 == 0:
            lines.append(f"M1:CUR 2024-05-01 12:00:{k // 2:02d}.{500000 * (k % 2) + 100000:06d} {0.5 + 0.01 * k:.3f} NO_ALARM NO_ALARM")
    lines.append("M1:STAT *** Not connected")
    (tmp_path / "pv.txt").write_text("\n".join(lines))
    log = read_log(tmp_path / "pv.txt", description_of({
        "time": {"column": "time", "unit": "s"}, "position": {"column": "M1.RBV", "unit": "mm"}, "current": {"column": "M1:CUR", "unit": "A"}}, "L"))
    assert np.nanmax(log.signals["current"]) == pytest.approx(0.5 + 0.57) and log.time[-1] == pytest.approx(29.0, abs=1.0)


def test_twincat_scope(tmp_path):
    head = "Name\tScope\nFile\tC:\\a.sv\nStarttime of export\t132000000000\n\nName\tActPos\tName\tActCur\nSymbolName\tMAIN.ActPos\tSymbolName\tMAIN.ActCur\nUnit\tmm\tUnit\tA\n\n"
    body = "\n".join(f"{2 * k}\t{0.5 * k:.3f}\t{2 * k}\t{0.1 * (k % 5):.3f}".replace(".", ",") for k in range(80)) + "\nEOF\n"
    (tmp_path / "scope.csv").write_text(head + body)
    log = read_log(tmp_path / "scope.csv", description_of({
        "time": {"column": "time", "unit": "s"}, "position": {"column": "ActPos", "unit": "mm"}, "current": {"column": "ActCur", "unit": "A"}}, "L"))
    assert log.period == pytest.approx(2e-3) and log.signals["position"][-1] == pytest.approx(0.5e-3 * 79)


def test_matlab(tmp_path):
    from scipy.io import savemat
    t, x, i = rows()
    savemat(tmp_path / "a.mat", {"t": t, "d": {"x": x, "i": i}, "name": "machine"})
    log = read_log(tmp_path / "a.mat", described(position={"column": "d.x", "unit": "mm"}, current={"column": "d.i", "unit": "A"}))
    assert len(log) == 200 and log.signals["position"] == pytest.approx(1e-3 * x)


def test_restarts_gaps_and_repeated_stamps(tmp_path):
    t, x, i = rows()
    t = t.copy()
    t[100:] += 2.0            # a gap
    t[150:] -= t[150]         # time begins again
    t[20] = t[19]             # a repeated stamp
    log = read_log(write(tmp_path / "a.csv", "t,x,i", (t, x, i)), described())
    assert log.piece.max() == 2 and len(log) == 199
    assert any("begins again" in n for n in log.notes) and any("gap" in n for n in log.notes) and any("repeat" in n for n in log.notes)


def test_outliers_and_saturation_are_left_out_and_told(tmp_path):
    t, x, i = rows(2000)
    i = np.clip(i + 0.3 * np.sin(3.0 * t), -0.4, 0.4)
    x = x.copy()
    x[500] += 50.0
    log = read_log(write(tmp_path / "a.csv", "t,x,i", (t, x, i)), described())
    assert np.isnan(log.signals["position"][500]) and np.isnan(log.signals["current"]).sum() > 50
    assert any("saturated" in n for n in log.notes) and any("single samples" in n for n in log.notes)


def test_shifted_levels_show_in_the_digits(tmp_path):
    rng = np.random.default_rng(3)
    i = np.round(0.5 + 0.1 * rng.standard_normal(900), 3)
    i[300:600] += 0.01234567
    i[600:] -= 0.00456789
    t = np.arange(900) * 0.01
    log = read_log(write(tmp_path / "a.csv", "t,x,i", (t, np.sin(t), i), number=lambda v: repr(float(v))), described())
    assert log.shift is not None and len(np.unique(log.shift)) == 3
    whole = read_log(write(tmp_path / "b.csv", "t,x,i", (t, np.sin(t), np.round(i, 3)), number=lambda v: repr(float(v))), described())
    assert whole.shift is None


def test_uneven_sampling_is_made_even(tmp_path):
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.005, 0.015, 1000))
    log = read_log(write(tmp_path / "a.csv", "t,x,i", (t, 10 * np.sin(t), np.cos(t))), described())
    assert np.diff(log.time) == pytest.approx(log.period) and np.abs(log.signals["position"] - 0.01 * np.sin(log.time + t[0])).max() < 1e-5


@pytest.mark.parametrize("change, says", [
    ({"current": {"column": "i", "unit": "mm"}}, "a unit of current"), ({"posiiton": {"column": "x", "unit": "mm"}}, "position"),
    ({"current": {"column": "i"}}, "unit"), ({"lead": 5}, "mapping"), ({"run": 3.5}, "column names"), ({"format": "xls"}, "csv, table, mat, mcap"),
    ({"following_error": {"column": "e", "unit": "mm", "sign": 2}}, "1 or -1"), ({"lead": {"value": -5, "unit": "mm"}}, "above 0")])
def test_bad_description_is_one_line(change, says):
    with pytest.raises(InputError, match=says):
        described(**change)


def test_missing_column_names_what_there_is(tmp_path):
    path = write(tmp_path / "a.csv", "t,x,strom", rows())
    with pytest.raises(InputError, match="strom"):
        read_log(path, described())


def test_counts_need_counts_per_turn(tmp_path):
    path = write(tmp_path / "a.csv", "t,x,i", rows())
    with pytest.raises(InputError, match="counts_per_turn"):
        read_log(path, described(position={"column": "x", "unit": "counts"}))
    log = read_log(path, described(position={"column": "x", "unit": "counts"}, counts_per_turn=10, lead={"value": 4, "unit": "mm"}))
    assert log.place_unit == "m" and log.signals["position"].max() == pytest.approx(4e-3, rel=1e-3)


def test_a_cut_last_line_is_left_out_and_told(tmp_path):
    path = write(tmp_path / "a.csv", "t,x,i", rows())
    path.write_text(path.read_text().rstrip("\n").rpartition("\n")[0] + "\n1.9")
    log = read_log(path, described())
    assert len(log) == 199 and any("last line is cut (1 of 3 fields)" in n for n in log.notes)


@pytest.mark.parametrize("hand", [False, True])
@pytest.mark.parametrize("text, shown", [("nan", "no number"), ("", "no number"), ("Paused", "Paused")])
def test_a_row_without_time_is_named(tmp_path, monkeypatch, hand, text, shown):
    if hand:
        monkeypatch.setattr("microstage_ros.records.logs.text_table.polars_or_none", lambda: None)
    path = write(tmp_path / "a.csv", "t,x,i", rows())
    lines = path.read_text().split("\n")
    lines[50] = text + lines[50][lines[50].index(","):]
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match=f"a.csv: column [t1], row 50 of 200: got '{shown}'"):
        read_log(path, described(time={"column": 1, "unit": "s"}) if hand else described())


def test_a_bad_stamp_is_named(tmp_path):
    stamps = [f"2024-05-01 12:00:{k:02d}" for k in range(50)]
    stamps[20] = "later"
    path = tmp_path / "a.csv"
    path.write_text("t,x,i\n" + "".join(f"{stamp},{k},{k}\n" for k, stamp in enumerate(stamps)))
    with pytest.raises(InputError, match="column t, row 21 of 50: got 'later'"):
        read_log(path, described(time={"column": "t", "unit": "iso"}))


@pytest.mark.parametrize("column, says", [(0, "column t: got 'a time that does not advance in 200 rows'"),
                                          (2, "current: column i: got 'no number in 200 rows'")])
def test_a_column_that_tells_nothing_is_named(tmp_path, column, says):
    columns = list(rows())
    columns[column] = np.full(200, 0.0 if column == 0 else np.nan)
    with pytest.raises(InputError, match=says):
        read_log(write(tmp_path / "a.csv", "t,x,i", columns), described())


def test_one_row_is_too_few(tmp_path):
    with pytest.raises(InputError, match="got '1 row', expected at least two rows"):
        read_log(write(tmp_path / "a.csv", "t,x,i", [c[:1] for c in rows()]), described())


@pytest.mark.parametrize("names, wanted", [
    ("t_s,actuator_level,encoder_m,reference_m,voltage_V,current_A,interferometer_m,guideway_level",
     {"time": "t_s s", "position": "encoder_m m", "reference": "reference_m m", "voltage": "voltage_V V", "current": "current_A A"}),
    ("t_s,encoder_m,current_A,stage_velocity_m_s,actuator_level",
     {"time": "t_s s", "position": "encoder_m m", "current": "current_A A", "velocity": "stage_velocity_m_s m/s"}),
    ("status_flag,t_ms,travel,amplitude,activity,ActVelo,SetPos,ActPos,ActCurrent",
     {"time": "t_ms ms", "velocity": "ActVelo mm/s", "reference": "SetPos mm", "position": "ActPos mm", "current": "ActCurrent A"}),
    ("time,cmdpos,actpos,actvel,motorcurrent,poslag",
     {"time": "time s", "reference": "cmdpos mm", "position": "actpos mm", "velocity": "actvel mm/s", "current": "motorcurrent A",
      "following_error": "poslag mm"})])
def test_names_are_matched_by_their_words_and_without_units(tmp_path, names, wanted):
    t = np.arange(200) * 0.01
    columns = [t if name in ("t_s", "t_ms", "time") else 10.0 * np.sin(t + k) for k, name in enumerate(names.split(","))]
    tree = propose(read_table(write(tmp_path / "a.csv", names, columns))).tree
    assert {key: f"{v['column']} {v['unit']}" for key, v in tree.items() if isinstance(v, dict)} == wanted
    assert "sampling_hz" not in tree


@pytest.mark.parametrize("hand", [False, True])
@pytest.mark.parametrize("odd, left_out", [("{t:.2f},7,{x:.4f},{i:.4f}", 10), ("{t:.2f},{x:.4f}", 10), ("{t:.2f},1,{x:.4f},{i:.4f}", 10)])
def test_rows_of_another_number_of_fields_are_left_out_and_told(tmp_path, monkeypatch, hand, odd, left_out):
    """With a field too many, as from a thousands separator, the numbers beside it were read in wrong columns."""
    if hand:
        monkeypatch.setattr(text_table, "polars_or_none", lambda: None)
    t, x, i = rows()
    lines = [(odd if n % 20 == 7 else "{t:.2f},{x:.4f},{i:.4f}").format(t=t[n], x=x[n], i=i[n]) for n in range(len(t))]
    path = tmp_path / "log.csv"
    path.write_text("t,x,i\n" + "\n".join(lines) + "\n")
    table = read_table(path, described())
    assert table.notes == [f"{left_out} lines with another number of fields are left out"] and table.rows == len(t) - left_out
    kept = np.arange(len(t)) % 20 != 7
    assert np.allclose(table.columns["x"], x[kept], atol=1e-4) and np.allclose(table.columns["i"], i[kept], atol=1e-4)


def test_decimal_commas_after_a_long_rest_of_whole_numbers(tmp_path):
    t, x, i = rows()
    comma = [f"{v:.4f}".replace(".", ",") for v in np.concatenate([x, i])]
    rest = "".join(f"{k};0;0\n" for k in range(6000))
    moving = "".join(f"{6000 + k};{comma[k]};{comma[len(x) + k]}\n" for k in range(len(x)))
    path = tmp_path / "log.csv"
    path.write_text("t;x;i\n" + rest + moving)
    table = read_table(path, described())
    assert not table.notes and np.allclose(table.columns["x"][6000:], x, atol=1e-4)


def test_quoted_decimal_commas(tmp_path):
    t, x, i = rows()
    path = tmp_path / "log.csv"
    path.write_text("t;x;i\n" + "".join('"{:.2f}";"{:.4f}";"{:.4f}"\n'.format(*row).replace(".", ",") for row in zip(t, x, i)))
    assert np.allclose(read_table(path, described()).columns["x"], x, atol=1e-4)


def test_thousands_commas_beside_decimal_points_are_refused(tmp_path):
    t, x, i = rows()
    path = tmp_path / "log.csv"
    path.write_text("t;x;i\n" + "".join(f"{a:.2f};{round(200 * b):,};{c:.4f}\n" for a, b, c in zip(t, x, i)))
    with pytest.raises(InputError, match=r"column 1, and -?\d,\d{3}', expected decimal points or decimal commas, and no thousands separators"):
        read_table(path, described())


def test_a_version_with_a_point_beside_decimal_commas_is_no_mixture(tmp_path):
    t, x, i = rows()
    path = tmp_path / "log.csv"
    path.write_text("t;x;i;v\n" + "".join("{:.2f};{:.4f};{:.4f};".format(*row).replace(".", ",") + "2.1\n" for row in zip(t, x, i)))
    assert np.allclose(read_table(path, described()).columns["x"], x, atol=1e-4)


@pytest.mark.parametrize("separator, remark", [(";", "axes 1,2 see 3,4"), ("\t", "axes:1,2;3,4"), ("\t", "axes 1 2 3 4 5 6 7 8")])
def test_commas_in_texts_beside_decimal_points_are_no_mixture(tmp_path, separator, remark):
    t, x, i = rows()
    path = tmp_path / "log.csv"
    lines = [separator.join((f"{a:.2f}", f"{b:.4f}", f"{c:.4f}", remark)) for a, b, c in zip(t, x, i)]
    path.write_text(separator.join(("t", "x", "i", "remark")) + "\n" + "\n".join(lines) + "\n")
    columns = read_table(path, described()).columns
    assert np.allclose(columns["x"], x, atol=1e-4) and set(columns["remark"]) == {remark}


def test_what_was_left_out_is_shown_when_a_log_is_looked_at(tmp_path, capsys):
    t, x, i = rows()
    path = write(tmp_path / "log.csv", "t [s],x [mm],i [A]", (t, x, i))
    path.write_text(path.read_text() + "1,2,3,4\n5,6,7\n")
    assert log_command.main([str(path)]) == 0
    assert "# 1 lines with another number of fields are left out" in capsys.readouterr().out


@pytest.mark.parametrize("suffix", ["mat", "mcap"])
def test_a_damaged_file_is_one_line(tmp_path, suffix):
    """Each byte in turn: whatever a library says of it, it is an `InputError`, or is read."""
    path = tmp_path / f"log.{suffix}"
    if suffix == "mat":
        savemat(path, {"t": np.arange(50.0), "x": np.sin(np.arange(50.0))}, do_compression=True)
    else:
        t = np.arange(50.0)
        joint_states(path, t, t, 0.1 * t, t, t)
    whole = path.read_bytes()
    for place in range(0, len(whole), max(len(whole) // 150, 1)):
        damaged = bytearray(whole)
        damaged[place] ^= 0x55
        path.write_bytes(damaged)
        with contextlib.suppress(InputError):
            read_table(path, described())
