"""Every kind of file that drives and controllers write: `log FILE` proposes a LOG.yaml that `diagnose --log` accepts.

Header lines read at their source: TwinCAT Scope (exports of version 3.4.3145.3 in the tests of CagtayFabry/pytcs); halscope (LinuxCNC, src/hal/utils/scope_files.c:
``Sampling period is %i ns``, then ``label %+.14f`` per channel); moteus (names of fields, mjbots/moteus utils). Laid out from
descriptions, not checked against a file of the maker's: EPOS Studio data recorder, camonitor (name, stamp, value, alarm), ODrive (a column
per property, named by its path), the header line of moteus. By the library that writes them: MATLAB level 5 (scipy.io); MCAP with sensor_msgs/JointState.
"""

import json

import numpy as np
import pytest

from microstage_ros.commands.analysis.diagnose import main as diagnose
from microstage_ros.commands.analysis.log import main as log
from microstage_ros.commands.__main__ import main as microstage
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.logs.description import load_description
from microstage_ros.records.logs.log import read_table

RATE = 100.0


def motion(seed, friction=1.0):
    """Time [s], set point [mm], position [mm], speed [mm/s], current [A] of moves back and forth with friction."""
    rng = np.random.default_rng(seed)
    n = 2400
    t = np.arange(n) / RATE
    cycle = np.mod(t, 4.0)
    speed = np.where(cycle < 1.5, 10.0, np.where((cycle >= 2.0) & (cycle < 3.5), -10.0, 0.0))
    speed = np.convolve(np.pad(speed, 5, mode="edge"), np.ones(11) / 11.0, mode="valid")
    reference = np.cumsum(speed) / RATE
    current = 0.5 * friction * np.sign(np.round(speed, 6)) + 0.01 * speed + 0.01 * rng.standard_normal(n) + 0.01 * rng.standard_normal()
    position = reference - 0.02 * current + 0.0005 * rng.standard_normal(n)
    return t, reference, position, speed, current


def epos(path, t, reference, position, speed, current):
    head = ['Date:;2024-03-11 09:12:00', 'EPOS Studio Version:;3.7.1.0', 'Sampling period:;10.000', '"Trigger:;0;0.0;""Channel 1"""',
            ';Position demand value;Position actual value;Current actual value', 'ms;mm;mm;mA']
    rows = [f"{1e3 * a:.3f};{b:.5f};{c:.5f};{1e3 * d:.1f}" for a, b, c, d in zip(t, reference, position, current)]
    path.write_text("\n".join(head + rows) + "\n")


def twincat(path, t, reference, position, speed, current):
    names, units = ("SetPos", "ActPos", "ActCurrent"), ("mm (Length)", "mm (Length)", "A (Current)")
    line = lambda key, values: ";".join(f"{key};{value}" for value in values)
    head = ["Name;Axis 1;", "File;C:\\scope\\axis1.csv;", "Starttime of export;132959733843760000;Montag, 2. Mai 2022;15:56:24.376",
            "Endtime of export;132959733853750000;Montag, 2. Mai 2022;15:56:48.375", "", "", line("Name", names), line("SymbolComment", [""] * 3),
            line("Data-Type", ["REAL64"] * 3), line("SampleTime[ms]", ["10"] * 3), line("VariableSize", ["8"] * 3), line("SymbolBased", ["True"] * 3),
            line("SymbolName", [f"Axes.Axis 1.{n}" for n in names]), line("Port", ["501"] * 3), line("Offset", ["0"] * 3),
            line("ScaleFactor", ["1"] * 3), line("BitMask", ["0xffffffffffffffff"] * 3), line("Unit", units), line("Unit ScaleFactor", ["1"] * 3),
            line("Unit Offset", ["0"] * 3), ""]
    rows = [";".join(f"{1e3 * a:g};{v:.5f}" for v in values) for a, *values in zip(t, reference, position, current)]
    path.write_text("\n".join([*head, *rows, "EOF"]) + "\n")


def halscope(path, t, reference, position, speed, current):
    rows = [f"joint.0.motor-pos-cmd {a:+.14f} joint.0.motor-pos-fb {b:+.14f} joint.0.f-error {a - b:+.14f} " for a, b in zip(reference, position)]
    path.write_text("Sampling period is 10000000 ns \n\n" + "\n".join(rows))


def camonitor(path, t, reference, position, speed, current):
    stamps = np.datetime64("2024-05-01T12:00:00") + (1e6 * t).astype("timedelta64[us]")
    lines = ["BL1:MTR1:TEMP                  *** Not connected (PV not found)"]
    for stamp, a, b, c in zip(stamps, reference, position, current):
        when = str(stamp).replace("T", " ")
        lines += [f"BL1:MTR1.DRBV {when} {b:.5f}  ", f"BL1:MTR1:POSREF {when} {a:.5f}  ", f"BL1:MTR1:CURRENT {when} {c:.4f} HIGH MINOR"]
    path.write_text("\n".join(lines) + "\n")


def odrive(path, t, reference, position, speed, current):
    head = "timestamp,axis0.controller.pos_setpoint,axis0.pos_estimate,axis0.vel_estimate,axis0.motor.foc.Iq_measured"
    rows = [f"{a:.4f},{b / 5.0:.6f},{c / 5.0:.6f},{d / 5.0:.5f},{e:.4f}" for a, b, c, d, e in zip(t, reference, position, speed, current)]
    path.write_text("\n".join([head, *rows]) + "\n")


def moteus(path, t, reference, position, speed, current):
    head = "timestamp,servo_control.position,servo_stats.position,servo_stats.velocity,servo_stats.q_A,servo_stats.torque_Nm"
    rows = [f"{1.7e9 + a:.4f},{b / 5.0:.6f},{c / 5.0:.6f},{d / 5.0:.5f},{e:.4f},{0.03 * e:.5f}"
            for a, b, c, d, e in zip(t, reference, position, speed, current)]
    path.write_text("\n".join([head, *rows]) + "\n")


def matlab(path, t, reference, position, speed, current):
    from scipy.io import savemat
    savemat(path, {"data": {"time": t, "pos_ref": reference, "pos_act": position, "current": current}, "machine": "stage 4"})


JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def joint_states(path, t, reference, position, speed, current):
    from mcap_ros2.writer import Writer
    with open(path, "wb") as file, Writer(file) as writer:
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for a, b, c, d in zip(t, position, speed, current):
            nanoseconds = int(round(1e9 * a))
            stamp = {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
            writer.write_message("/joint_states", schema, {
                "header": {"stamp": stamp, "frame_id": ""}, "name": ["slide"], "position": [1e-3 * b], "velocity": [1e-3 * c], "effort": [30.0 * d]},
                nanoseconds, nanoseconds)


#: kind → (writer, suffix, what the reader calls it, quantities that the proposal must hold)
KINDS = {
    "EPOS Studio": (epos, ".csv", "EPOS Studio", {"time", "reference", "position", "current"}),
    "TwinCAT Scope": (twincat, ".csv", "TwinCAT Scope", {"time", "reference", "position", "current"}),
    "halscope": (halscope, ".log", "halscope", {"time", "reference", "position", "following_error"}),
    "camonitor": (camonitor, ".txt", "camonitor", {"time", "reference", "position", "current"}),
    "ODrive": (odrive, ".csv", "text", {"time", "reference", "position", "velocity", "current"}),
    "moteus": (moteus, ".csv", "text", {"time", "reference", "position", "velocity", "current"}),
    "MATLAB": (matlab, ".mat", "MATLAB", {"time", "reference", "position", "current"}),
    "MCAP": (joint_states, ".mcap", "MCAP", {"time", "position", "velocity", "torque"}),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_proposal_is_accepted(kind, tmp_path):
    write, suffix, told, quantities = KINDS[kind]
    files = [tmp_path / f"{name}{suffix}" for name in ("b1", "b2", "b3", "now")]
    for seed, file in enumerate(files):
        write(file, *motion(seed, 1.6 if file.stem == "now" else 1.0))
    assert log([str(files[0]), "--out", str(tmp_path / "first")]) == 0
    import yaml
    proposed = yaml.safe_load((tmp_path / "first" / "LOG.yaml").read_text())
    assert told in read_table(files[0]).kind and quantities <= set(proposed)
    assert diagnose(["--log", str(tmp_path / "first" / "LOG.yaml"), "--baseline", *map(str, files[:3]), "--out", str(tmp_path / "answer"), str(files[3])]) == 0
    report = json.loads((tmp_path / "answer" / "report.json").read_text())
    names = {c["id"] for c in report["causes"]} | {i for r in report["rivals"] for i in r["ids"]}
    assert report["verdict"] != "agrees"
    assert kind != "TwinCAT Scope" or "a guess" not in (tmp_path / "first" / "LOG.yaml").read_text()
    assert kind != "MCAP" or proposed["position"]["unit"] == "m"
    columns = {name: str(proposed[name]["column"]).lower() for name in quantities}
    assert not {"reference", "position"} <= quantities or "ref" not in columns["position"] and "control" not in columns["position"]
    assert kind not in ("ODrive", "moteus") or proposed["position"]["unit"] == "turn" and proposed["velocity"]["unit"] == "turn/s"
    if "current" in proposed or "torque" in proposed:
        assert "friction_level_change" in names


@pytest.mark.parametrize("name, content, says", [
    ("a.csv", b"", "empty file"), ("a.csv", b"hello\nworld\n", "rows of numbers"), ("a.log", b"Sampling period is 1000000 ns \n\n", "no samples"),
    ("a.log", b"Sampling period is 1000000 ns \n\nx +1.0 x +2.0\n", "every label once"), ("a.mat", b"MATLAB 5.0 MAT-file" + bytes(300), "MATLAB file"),
    ("a.mat", b"\x89HDF\r\n\x1a\n", "MATLAB file"), ("a.mcap", b"\x89MCAP0\r\n" + bytes(50), "MCAP bag"), ("a.mcap", b"t,x\n1,2\n", "MCAP bag"),
    ("a.csv", b"Name;S;\nStarttime of export;1\n\nName;P\nSymbolName;M.P\nSampleTime[ms];1\n", "rows of numbers"),
    ("a.txt", b"M1.RBV *** Not connected (PV not found)\n", "rows of numbers"), ("a.csv.gz", b"\x1f\x8bxx", "gz")])
def test_wrong_input_is_one_line(name, content, says, tmp_path, capsys):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=says) as told:
        log([str(tmp_path / name)])
    assert "\n" not in str(told.value)
    assert microstage(["log", str(tmp_path / name)]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_a_bag_without_a_summary_is_read_through(tmp_path):
    """A footer whose summary begins at byte 0: there is none (mcap.dev/spec, Footer)."""
    path = tmp_path / "now.mcap"
    joint_states(path, *motion(1))
    raw, whole = path.read_bytes(), read_table(path)
    data, footer, magic = raw[:int.from_bytes(raw[-28:-20], "little")], raw[-37:-28], raw[-8:]
    path.write_bytes(data + footer + bytes(20) + magic)
    found = read_table(path)
    assert set(found.columns) == set(whole.columns)
    np.testing.assert_array_equal(found.columns["slide.position"], whole.columns["slide.position"])


@pytest.mark.parametrize("options, says", [
    (["FILE", "--separator", ";;"], "--separator: got ';;', expected one character"), (["FILE", "--separator", '"'], "--separator"),
    (["FILE", "--separator", "·"], "--separator"), (["FILE", "--skip-rows", "-1"], "--skip-rows: got -1, expected .* 0 or more"),
    (["--examine", "2", "--seed", "-1"], "--seed: got -1, expected a whole number from 0"),
    (["--examine", "2", "--strength", "-1"], "--strength: got -1.0"), (["--examine", "2", "--strength", "nan"], "--strength: got nan"),
    (["FILE", "--examine", "3"], "FILE: got .*now.csv', expected no file together with --examine")])
def test_wrong_options_are_one_line(options, says, tmp_path):
    (tmp_path / "now.csv").write_text("t,x,i\n" + "".join(f"{0.1 * k},{k},{k % 3}\n" for k in range(50)))
    with pytest.raises(InputError, match=says):
        log([str(tmp_path / "now.csv") if word == "FILE" else word for word in options])


def test_a_named_separator_is_written_as_its_character(tmp_path):
    (tmp_path / "now.txt").write_text("t\tx\ti\n" + "".join(f"{0.1 * k}\t{k}\t{k % 3}\n" for k in range(50)))
    assert log([str(tmp_path / "now.txt"), "--separator", "tab", "--out", str(tmp_path / "first")]) == 0
    assert load_description(tmp_path / "first" / "LOG.yaml").separator == "\t"


def test_one_row_is_refused_and_an_empty_column_is_not_proposed(tmp_path, recwarn):
    (tmp_path / "one.csv").write_text("t,x,i\n0,1,2\n")
    with pytest.raises(InputError, match="got '1 row', expected at least two rows"):
        log([str(tmp_path / "one.csv")])
    (tmp_path / "now.csv").write_text("t,x,i\n" + "".join(f"{0.1 * k},{k},nan\n" for k in range(50)))
    assert log([str(tmp_path / "now.csv"), "--out", str(tmp_path / "first")]) == 0
    assert "current:" not in (tmp_path / "first" / "LOG.yaml").read_text()
    assert not [w for w in recwarn if issubclass(w.category, RuntimeWarning)]
