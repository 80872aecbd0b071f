"""Typical mistakes on the command line: each one clear line and status 2, and nothing that was there is lost."""

import re

import pytest

from microstage_ros.commands.__main__ import main
from microstage_ros.places import config_file

AXIS = str(config_file("axis.yaml"))
RUN = "controller: {type: pid}\nprogram:\n  - {move_to_m: 1.0e-5, dwell_s: 0.01}\n"
RECORD = "t_s,encoder_m,reference_m,voltage_V\n" + "".join(f"{k * 1e-4:.4f},0,0,0\n" for k in range(20))


def changed(pattern, text):
    """The shipped axis file with one place changed."""
    new, count = re.subn(pattern, text, config_file("axis.yaml").read_text(encoding="utf-8"), count=1)
    assert count == 1
    return new


FILES = {
    "axis.yaml": lambda: config_file("axis.yaml").read_text(encoding="utf-8"),
    "run.yaml": lambda: RUN,
    "rec.csv": lambda: RECORD,
    "earlier.csv": lambda: "earlier\n",
    "earlier.yaml": lambda: "earlier: 1\n",
    "answer/report.json": lambda: "{}\n",
    "empty.csv": lambda: "",
    "semicolon.csv": lambda: RECORD.replace(",", ";"),
    "strange.csv": lambda: RECORD.replace("voltage_V", "Voltage"),
    "letters.csv": lambda: RECORD.replace("0.0003,0", "0.0003,abc"),
    "jumps.csv": lambda: RECORD.replace("0.0010,", "0.0030,"),
    "noheader.csv": lambda: RECORD.split("\n", 1)[1],
    "picture.csv": lambda: "\x89PNG\x00\x01",
    "plain.csv.gz": lambda: RECORD,
    "tabs.yaml": lambda: "controller:\n\t- {type: pid}\n",
    "list.yaml": lambda: "- 1\n- 2\n",
    "unit.yaml": lambda: changed(r"pitch: \{value: 2.0e-3, unit: m,", "pitch: {value: 2.0, unit: mm,"),
    "nounit.yaml": lambda: changed(r"pitch: \{value: 2.0e-3, unit: m,", "pitch: {value: 2.0e-3,"),
    "word.yaml": lambda: changed(r"mass: \{value: 3.06", "mass: {value: heavy"),
    "minus.yaml": lambda: changed(r"mass: \{value: 3.06", "mass: {value: -3.06"),
    "nopitch.yaml": lambda: changed(r"  pitch: [^\n]*\n", ""),
    "typo.yaml": lambda: changed("pitch:", "pich:"),
    "law.yaml": lambda: changed("law: maxwell_slip", "law: maxwell"),
    "controller.yaml": lambda: RUN.replace("pid", "pdi"),
    "effect.yaml": lambda: RUN + "effects: {backlsh: {width_rad: 0.01}}\n",
    "nogap.yaml": lambda: RUN + "effects: {backlash: {width_rad: 0.005}}\n",
    "coil.yaml": lambda: config_file("axes/voice_coil.yaml").read_text(encoding="utf-8"),
    "coilgap.yaml": lambda: config_file("axes/voice_coil.yaml").read_text(encoding="utf-8").replace(
        "effects: {}", "effects: {backlash: {width_rad: 0.005}}"),
    "size.yaml": lambda: RUN + "effects: {backlash: {width_rad: -1.0}}\n",
    "sizes.yaml": lambda: RUN + "effects: {torque_ripple: {amplitude_Nm: [1.0e-5, 1.0e-5], cycles_per_turn: [1, 2], phase_rad: [0, 0]}, backlash: {width_rad: [0.01, 0.02]}}\n",
    "far.yaml": lambda: RUN.replace("1.0e-5", ".nan"),
    "ten.yaml": lambda: RUN.replace("1.0e-5", "10.0"),
    "wide.yaml": lambda: RUN + "  - {sine: {amplitude_m: 3.0e-2, frequency_hz: 1.0, cycles: 1}}\n",
    "noprogram.yaml": lambda: "controller: {type: pid}\n",
    "nofile.yaml": lambda: "controller: {type: pid}\nprogram: [{reference_file: nowhere.csv}]\n",
    "leap.csv": lambda: "t_s,reference_m\n0,0\n0.0001,0\n0.0002,1e-3\n",
    "leap.yaml": lambda: "controller: {type: pid}\nprogram: [{reference_file: leap.csv}]\n",
    "sixty.yaml": lambda: RUN + "  - {sine: {amplitude_m: 1.0e-6, frequency_hz: 1.0, cycles: 12:30:45}}\n",
    "twice.yaml": lambda: RUN + "controller: {type: self_tuning}\n",
    "long.yaml": lambda: RUN.replace("0.01", "1.0e+6"),
    "slow.yaml": lambda: RUN.replace("dwell_s: 0.01", "velocity_m_s: 1.0e-9, acceleration_m_s2: 1.0e-6"),
    "nanmass.yaml": lambda: changed(r"mass: \{value: 3.06", "mass: {value: .nan"),
    "period.yaml": lambda: RUN + "period_s: 0\n",
    "double.csv": lambda: RECORD.replace("reference_m", "encoder_m"),
    "ragged.csv": lambda: RECORD.replace("0.0010,0,0,0", "0.0010,0,0"),
    "back.csv": lambda: RECORD.replace("0.0010,", "0.0002,"),
    "logs/examination.json": lambda: "{}\n",
    "failures/nominal_1/run.yaml": lambda: RUN,
    "targets.txt": lambda: "10um\nten\n",
}

SIMULATE = ["simulate", "--axis", "axis.yaml", "--run", "run.yaml", "--out", "o.csv"]


def simulate(**other):
    """The words of a simulation with some of them changed."""
    words = {"axis": "axis.yaml", "run": "run.yaml", "out": "o.csv", **other}
    return ["simulate", *(part for name, value in words.items() for part in (f"--{name}", value))]


MISTAKES = {
    "a command that there is not": (["simulte"], "did you mean simulate?"),
    "no command": (["--axis", "axis.yaml"], "there is no command"),
    "an option that there is not": ([*SIMULATE, "--sed", "1"], "did you mean --seed?"),
    "an option without its value": (["simulate", "--axis"], "expected one argument"),
    "a required option left out": (["simulate", "--axis", "axis.yaml"], "required: --run, --out"),
    "a word too many": ([*SIMULATE, "more"], "unexpected words: more"),
    "a seed that is no number": (simulate(seed="one"), "invalid int value: 'one'"),
    "a seed below zero": (simulate(seed="-1"), "--seed: got -1"),
    "a length with a wrong unit": (["move", "--to", "10xm"], "expected a length"),
    "a length with a comma": (["move", "--to", "1,5um"], "expected a length"),
    "a move beyond the travel": (simulate(run="ten.yaml"), "program[1].move_to_m: got 10"),
    "a sine beyond the travel": (simulate(run="wide.yaml"), "program: farthest reference: got"),
    "a fault campaign of nothing": (["faults", "--trials", "0"], "nothing is examined so"),
    "periods of nothing": (["faults", "--periods", "5"], "--periods: got 5, expected --healthy"),
    "fewer periods than none": (["faults", "--healthy", "5", "--periods", "-1"], "--periods: got -1"),
    "no target": (["move"], "one of the arguments --to --by --targets is required"),
    "two kinds of target": (["move", "--to", "1um", "--by", "1um"], "not allowed with argument"),
    "a tolerance of nothing": (["move", "--to", "1um", "--tolerance", "0"], "a length above 0"),
    "a time below zero": (["move", "--to", "1um", "--timeout", "-3"], "a time above 0"),
    "a file of targets that is not there": (["move", "--targets", "target.txt"], "file not found"),
    "a file of targets with a word": (["move", "--targets", "targets.txt"], "line 2: got 'ten'"),
    "an axis file that is not there": (simulate(axis="axs.yaml"), "axs.yaml: file not found"),
    "an axis file that is a folder": (simulate(axis="answer"), "is a directory"),
    "an axis file that is a record": (simulate(axis="rec.csv"), "rec.csv"),
    "a unit that is not SI": (simulate(axis="unit.yaml"), "transmission.pitch"),
    "a unit left out": (simulate(axis="nounit.yaml"), "transmission.pitch"),
    "a word for a number": (simulate(axis="word.yaml"), "stage.mass"),
    "a mass below zero": (simulate(axis="minus.yaml"), "stage.mass"),
    "a number left out": (simulate(axis="nopitch.yaml"), "transmission.pitch"),
    "a key with a slip": (simulate(axis="typo.yaml"), "pich"),
    "a law that there is not": (simulate(axis="law.yaml"), "contacts.guideway.law"),
    "a run file that is not there": (simulate(run="r.yaml"), "r.yaml: file not found"),
    "a run file with tabs": (simulate(run="tabs.yaml"), "valid YAML"),
    "a run file that is a list": (simulate(run="list.yaml"), "list.yaml"),
    "a controller that there is not": (simulate(run="controller.yaml"), "'pdi'"),
    "an effect that there is not": (simulate(run="effect.yaml"), "backlsh"),
    "an effect of an impossible size": (simulate(run="size.yaml"), "width_rad"),
    "a target that is no number": (simulate(run="far.yaml"), "move_to_m"),
    "a run file without a program": (simulate(run="noprogram.yaml"), "program"),
    "a reference file that is not there": (simulate(run="nofile.yaml"), "nowhere.csv"),
    "a record's name with a wrong ending": (simulate(out="o.txt"), "a file name ending in"),
    "earlier results in the way": (simulate(out="earlier.csv"), "exists already; expected a new name, or --force"),
    "an earlier axis file in the way": (["identify", "--axis", "axis.yaml", "rec.csv", "--out", "earlier.yaml"], "--force"),
    "an earlier answer in the way": (["diagnose", "--axis", "axis.yaml", "rec.csv", "--out", "answer"], "--force"),
    "a record that is not there": (["diagnose", "--axis", "axis.yaml", "rec1.csv", "--out", "new"], "rec1.csv: file not found"),
    "an empty record": (["identify", "--axis", "axis.yaml", "empty.csv", "--out", "n.yaml"], "an empty file"),
    "a record with semicolons": (["identify", "--axis", "axis.yaml", "semicolon.csv", "--out", "n.yaml"], "separated by commas"),
    "a record with a strange column": (["identify", "--axis", "axis.yaml", "strange.csv", "--out", "n.yaml"], "Voltage"),
    "a record with letters": (["identify", "--axis", "axis.yaml", "letters.csv", "--out", "n.yaml"], "line 5, field encoder_m"),
    "a record whose time jumps": (["identify", "--axis", "axis.yaml", "jumps.csv", "--out", "n.yaml"], "line"),
    "a record without a header": (["identify", "--axis", "axis.yaml", "noheader.csv", "--out", "n.yaml"], "names of the columns"),
    "a picture for a record": (["identify", "--axis", "axis.yaml", "picture.csv", "--out", "n.yaml"], "picture.csv"),
    "a plain file called compressed": (["identify", "--axis", "axis.yaml", "plain.csv.gz", "--out", "n.yaml"], "gz bytes"),
    "a page for an axis file": (["identify", "--axis", "axis.yaml", "rec.csv", "--out", "n.html"], "ending in .yaml"),
    "a bag that is not there": (["replay", "nowhere"], "file not found"),
    "a rate of nothing": (["replay", "nowhere", "--rate", "0"], "--rate"),
    "a namespace without its slash": (["cell", "--namespace", "axis"], "begins with a slash"),
    "a namespace with a space": (["cell", "--namespace", "/le ft"], "such as /axis"),
    "a namespace of a command with a space": (["stop", "--namespace", "/le ft"], "such as /axis"),
    "a step of 1 mm in one period": (simulate(run="leap.yaml"), "leap.csv, positions 2 and 3: got '10 m/s'"),
    "a number of cycles to the base of sixty": (simulate(run="sixty.yaml"), "'12:30:45'"),
    "a key that stands twice": (simulate(run="twice.yaml"), "stands twice"),
    "a dwell of thirty years": (simulate(run="long.yaml"), "control periods"),
    "a motion of thirty years": (simulate(run="slow.yaml"), "control periods"),
    "a backend that there is not": (["cell", "--backend", "simulatd"], "simulatd"),
    "a topic left out": (["topic", "echo"], "the name of a topic"),
    "a topic with a space": (["topic", "hz", "bad name"], "a name of letters"),
    "a topic with a space to show": (["topic", "echo", "bad name"], "a name of letters"),
    "no message at all": (["topic", "echo", "/axis/state", "-n", "0"], "1 or more messages"),
    "a shell that there is not": (["completion", "tcsh"], "invalid choice: 'tcsh'"),
    "a controller for tune that there is not": (["tune", "--axis", "axis.yaml", "--type", "pidd"], "did you mean pid?"),
    "a law for a cell that there is not": (["cell", "--controller", "self_tunning"], "did you mean self_tuning?"),
    "a law for the demo that there is not": (["demo", "--controller", "pdi"], "did you mean pid?"),
    "a speed that is a length": (["jog", "--speed", "1mm"], "such as 0.5mm/s"),
    "a speed in a word": (["jog", "--speed", "fast"], "such as 0.5mm/s"),
    "a jog without its speed": (["jog"], "required: --speed"),
    "a move at no speed": (["move", "--to", "1um", "--speed", "0"], "a speed above 0"),
    "no repeats": (["move", "--to", "1um", "--repeat", "0"], "1 or more"),
    "an empty target": (["move", "--to", ""], "expected a length"),
    "a step with a digit too many": (["move", "--by", "5nm5"], "expected a length"),
    "a mode that there is not": (["cell", "--mode", "fast"], "choose from 'lockstep', 'paced'"),
    "a verb with a slip": (["topic", "ecko"], "did you mean echo?"),
    "a run file for a bag": (["replay", "run.yaml"], "expected an MCAP file"),
    "a run file to recover": (["recover", "run.yaml"], "expected an MCAP file"),
    "a bag to recover that is not there": (["recover", "no.mcap"], "file not found"),
    "a run file for a log": (["log", "run.yaml", "--out", "x"], "rows of numbers"),
    "a run file for an axis file": (simulate(axis="run.yaml"), "run.yaml: format"),
    "an axis file for a run file": (simulate(run="axis.yaml"), "'unknown key'"),
    "an axis file for an experiment": (["experiment", "--run", "axis.yaml", "--out", "e"], "'unknown key'"),
    "no records": (["identify", "--axis", "axis.yaml", "--out", "n.yaml"], "required: RECORD"),
    "too many blocks": (["identify", "--axis", "axis.yaml", "rec.csv", "--blocks", "99", "--out", "n.yaml"], "from 1 to 8"),
    "a seed of the demo below zero": (["demo", "--seed", "-1"], "--seed: got -1"),
    "a mass that is no number": (simulate(axis="nanmass.yaml"), "a finite number > 0 in kg"),
    "an empty axis file": (simulate(axis="empty.csv"), "empty.csv"),
    "a period of nothing": (simulate(run="period.yaml"), "period_s"),
    "a seed with an exponent": (simulate(seed="1e3"), "invalid int value: '1e3'"),
    "a target that is infinite": (["move", "--to", "1e400"], "expected a length"),
    "a tolerance that is no number": (["move", "--to", "1um", "--tolerance", "nan"], "expected a length"),
    "a record for an axis file": (["commission", "--axis", "rec.csv", "--out", "c"], "a mapping of sections"),
    "a sketch over earlier results": (["commission", "--axis", "axis.yaml", "--out", "answer"], "without results of anything else"),
    "a file for the folder of a comparison": (["compare", "--out", "rec.csv"], "not a directory"),
    "a file for the folder of a demo": (["demo", "--out", "rec.csv"], "not a directory"),
    "a file for the folder of an experiment": (["experiment", "--run", "run.yaml", "--out", "rec.csv"], "not a directory"),
    "tuned gains under a record's name": (["tune", "--axis", "axis.yaml", "--out", "t.csv"], "ending in .yaml"),
    "an earlier campaign in the way": (["campaign", "--cases", "1", "--json", "answer/report.json"], "--force"),
    "an earlier examination of logs in the way": (["log", "--examine", "1", "--out", "logs"], "--force"),
    "failures of robustness in the way": (["robustness", "--out", "failures"], "--force"),
    "no random machine": (["robustness", "--random", "0"], "--random: got 0, expected 1 or more"),
    "no move": (["robustness", "--moves", "0"], "--moves: got 0, expected 1 or more"),
    "judged on what it learned from": (["diagnose", "--axis", "axis.yaml", "rec.csv", "--holdout", "./rec.csv", "--out", "new"], "given as RECORD too"),
    "a healthy axis with the fault": (["diagnose", "--axis", "axis.yaml", "rec.csv", "--baseline", "rec.csv", "--out", "new"], "given as RECORD too"),
    "a record given twice to identify": (["identify", "--axis", "axis.yaml", "rec.csv", "./rec.csv", "--out", "n.yaml"], "given twice"),
    "a record given twice to diagnose": (["diagnose", "--axis", "axis.yaml", "rec.csv", "rec.csv", "--out", "new"], "given twice"),
    "a baseline given twice": (["diagnose", "--axis", "axis.yaml", "rec.csv", "--baseline", "earlier.csv", "earlier.csv", "--out", "new"], "--baseline earlier.csv: got 'a record that is given twice'"),
    "a log for a LOG.yaml": (["diagnose", "--log", "rec.csv", "--baseline", "rec.csv", "--out", "new", "rec.csv"], "rec.csv"),
    "a holdout that is not there": (["diagnose", "--axis", "axis.yaml", "rec.csv", "--holdout", "r.csv", "--out", "new"], "not found"),
    "columns that stand twice": (["identify", "--axis", "axis.yaml", "double.csv", "--out", "n.yaml"], "every column once"),
    "a row too short": (["identify", "--axis", "axis.yaml", "ragged.csv", "--out", "n.yaml"], "line 12"),
    "time that runs back": (["identify", "--axis", "axis.yaml", "back.csv", "--out", "n.yaml"], "line 12"),
    "an earlier campaign of nothing": (["campaign", "--cases", "1", "--from", "answer/report.json"], "got 'no list of cases'"),
    "an earlier search that nothing uses": (["compare", "--found", "no.json", "--out", "new"], "--opponents N beside it"),
    "an earlier search that is not there": (["compare", "--opponents", "9", "--found", "no.json", "--out", "new"], "--found: got 'no.json'"),
    "a seed of a tuning below zero": (["tune", "--axis", "axis.yaml", "--seed", "-1"], "--seed: got -1"),
    "a seed of a diagnosis below zero": (["diagnose", "--axis", "axis.yaml", "rec.csv", "--out", "new", "--seed", "-1"], "--seed: got -1"),
    "a seed of an examined watch below zero": (["watch", "--axis", "axis.yaml", "--examine", "1", "--seed", "-1"], "--seed: got -1"),
    "false alarms that are no number": (["watch", "--axis", "axis.yaml", "--false-alarms", "nan"], "--false-alarms: got nan"),
    "a gap of a drive without a transmission, in a run file": (simulate(axis="coil.yaml", run="nogap.yaml"), "nogap.yaml: effects: backlash: got"),
    "two widths of one gap, beside a ripple of two terms": (simulate(run="sizes.yaml"), "sizes.yaml: effects: backlash: got {'width_rad': [0.01, 0.02]}"),
    "such a gap in an axis file": (simulate(axis="coilgap.yaml"), "coilgap.yaml: effects: backlash: got"),
    "such a gap in a machine file": ([*simulate(axis="coil.yaml"), "--machine", "coilgap.yaml"], "coilgap.yaml: effects: backlash: got"),
    "such a gap in a machine to compare on": (["compare", "--axis", "coil.yaml", "--machine", "coilgap.yaml", "--out", "new"], "coilgap.yaml: effects: backlash: got"),
    "such a gap in the axis file of a cell": (["cell", "--axis", "coilgap.yaml"], "coilgap.yaml: effects: backlash: got"),
    "such a gap in the machine of a cell": (["cell", "--axis", "coil.yaml", "--machine", "coilgap.yaml"], "coilgap.yaml: effects: backlash: got"),
    "such a gap in an axis file to diagnose": (["diagnose", "--axis", "coilgap.yaml", "rec.csv", "--out", "new"], "coilgap.yaml: effects: backlash: got"),
    "effects for a cell that runs": (["experiment", "--running", "--run", "nogap.yaml", "--out", "new"], "nogap.yaml: effects: got 'backlash', expected none"),
    "effects that the axis of an experiment cannot have": (["experiment", "--axis", "coil.yaml", "--run", "nogap.yaml", "--out", "new"], "nogap.yaml: effects: backlash: got"),
    "no cases": (["campaign", "--cases", "0"], "1 or more"),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the files that the mistakes name."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text(), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder):
    """{file: its bytes} below a folder."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line_and_status_2_and_nothing_is_lost(name, folder, capsys):
    words, said = MISTAKES[name]
    before = contents(folder)
    status = main(words)
    shown = capsys.readouterr()
    assert status == 2, shown.err
    assert said in shown.err and "Traceback" not in shown.err
    assert len([line for line in shown.err.splitlines() if not line.startswith("warning: ")]) == 1, shown.err
    assert contents(folder) == before


def test_earlier_campaigns_are_read_before_the_cases_are_run(folder, monkeypatch, capsys):
    monkeypatch.setattr("microstage_ros.diagnosis.validation.campaign.run", lambda *_: pytest.fail("the cases are run"))
    assert main(["campaign", "--cases", "1", "--from", "no.json"]) == 2
    assert "--from no.json: got 'No such file" in capsys.readouterr().err


def test_there_are_forty_and_more():
    assert len(MISTAKES) >= 95
