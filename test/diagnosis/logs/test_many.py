"""Logs of many machines: a folder each, here or on workers of their own processes, of which one is killed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from microstage_ros.commands.analysis.diagnose import main as diagnose
from microstage_ros.control.evaluation.comparison import QUICK, Evaluation
from microstage_ros.diagnosis import fleet
from microstage_ros.diagnosis.logs.batch import cases_of_logs, diagnose_log_batch
from microstage_ros.quantities.errors import InputError
from test.diagnosis.logs.test_file_kinds import motion

ROOT = Path(__file__).resolve().parents[3]
LOG = """time: {column: t, unit: s}
reference: {column: r, unit: mm}
position: {column: x, unit: mm}
current: {column: i, unit: A}
"""


def machine(folder, friction, seed):
    """A folder with three healthy logs and one of now."""
    folder.mkdir()
    for number, (name, level) in enumerate((("base1", 1.0), ("base2", 1.0), ("base3", 1.0), ("now", friction))):
        t, r, x, _, i = motion(10 * seed + number, level)
        rows = "\n".join(f"{a:.3f},{b:.5f},{c:.5f},{d:.4f}" for a, b, c, d in zip(t, r, x, i))
        (folder / f"{name}.csv").write_text(f"t,r,x,i\n{rows}\n")
    return str(folder)


@pytest.fixture
def machines(tmp_path):
    (tmp_path / "LOG.yaml").write_text(LOG)
    return [machine(tmp_path / f"m{k}", 1.6 if k % 2 else 1.0, k) for k in range(4)]


@pytest.fixture(scope="module")
def cluster():
    """(address, worker processes): a scheduler and two workers in processes of their own on the loopback."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]), "OPENBLAS_NUM_THREADS": "1"}
    start = lambda *words: subprocess.Popen([sys.executable, "-m", *words], env=environment, stderr=subprocess.PIPE, text=True)
    scheduler = start("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-jupyter")
    running, address = [scheduler], ""
    try:
        while not address:
            line = scheduler.stderr.readline()
            assert line, "the scheduler did not start"
            address = next((word for word in line.split() if word.startswith("tcp://127.0.0.1")), "")
        workers = [start("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard") for _ in range(2)]
        running += workers
        from distributed import Client
        with Client(address, timeout="60s") as client:
            client.wait_for_workers(2, timeout=120)
        yield address, workers
    finally:
        for process in running:
            process.kill()
            process.wait()


def test_a_killed_worker_loses_nothing(machines, cluster, tmp_path):
    address, workers = cluster
    cases = cases_of_logs(machines, str(tmp_path / "LOG.yaml"), (), "", str(tmp_path / "out"), 0)
    reports = {}
    for case, report in diagnose_log_batch(cases, scheduler=address):
        if not reports:
            workers[0].kill()
        reports[case.name] = report
        assert (tmp_path / "out" / case.name / "report.json").exists()
    assert sorted(reports) == ["m0", "m1", "m2", "m3"]
    assert not [report for report in reports.values() if isinstance(report, Exception)]
    assert [reports[f"m{k}"]["verdict"] == "agrees" for k in range(4)] == [True, False, True, False]


def test_what_compare_sends_can_be_sent(cluster):
    evaluated = Evaluation(None, QUICK, progress=lambda text, lock=open(os.devnull): None, elsewhere=None)
    assert fleet.in_order(lambda seed: seed + evaluated.extent.seeds, range(5), cluster[0]) == [QUICK.seeds + seed for seed in range(5)]


def test_each_folder_is_a_machine(machines, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m3" / "now.csv").write_text("t,r,x,strom\n0,0,0,0\n1,1,1,1\n")
    assert diagnose(["--log", "LOG.yaml", "--each", "m0", "m1", "m3", "--out", "out"]) == 1
    rows = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [row["case"] for row in rows] == ["m0", "m1", "m3"] and "strom" in rows[2]["error"] and rows[0]["verdict"] == "agrees"
    assert len(capsys.readouterr().out.strip().split("\n")) == 3


@pytest.mark.parametrize("words, says", [
    (["m0"], "--baseline"), (["--each", "nowhere"], "not a folder"), (["--each", "m0", "--over-time"], "one of the two"),
    (["--baseline", "m0/base1.csv", "--scheduler", "tcp://127.0.0.1:9", "m0/now.csv"], "--each")])
def test_wrong_words_are_one_line(machines, tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=says):
        diagnose(["--log", "LOG.yaml", "--out", "out", *words])


@pytest.fixture
def one_of_each(tmp_path):
    """Command line of one baseline log against one of now with more friction, and the file of the baseline."""
    (tmp_path / "LOG.yaml").write_text(LOG)
    folder = Path(machine(tmp_path / "m", 1.6, 1))
    return ["--log", str(tmp_path / "LOG.yaml"), "--baseline", str(folder / "base1.csv"), "--out", str(tmp_path / "out"),
            str(folder / "now.csv")], folder


@pytest.mark.parametrize("short, place", [("base1.csv", "--baseline"), ("now.csv", "records")])
def test_too_few_rows_are_told_as_such(one_of_each, short, place):
    line, folder = one_of_each
    text = (folder / short).read_text().split("\n")
    (folder / short).write_text("\n".join(text[:30]) + "\n")
    with pytest.raises(InputError, match=f"{place}: got '29 rows with a value of the effort .current.', expected 40 rows or more"):
        diagnose(line)


def test_few_repetitions_and_open_names_on_the_terminal(one_of_each, capsys):
    """One cycle as the baseline."""
    line, folder = one_of_each
    text = (folder / "base1.csv").read_text().split("\n")
    (folder / "base1.csv").write_text("\n".join(text[:402]) + "\n")
    assert diagnose(line) == 0
    assert "Few baseline repetitions (1): thresholds are wide." in capsys.readouterr().out


def test_a_bad_log_of_one_machine_is_told_in_its_own_words(tmp_path, machines, capsys):
    file = tmp_path / "m0" / "now.csv"
    lines = file.read_text().split("\n")
    lines[30] = "nan" + lines[30][lines[30].index(","):]
    file.write_text("\n".join(lines))
    assert diagnose(["--log", str(tmp_path / "LOG.yaml"), "--out", str(tmp_path / "out"), "--each", machines[0]]) == 1
    (row,) = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert row["error"].startswith(f"{file}: column t, row 30 of 2400: got 'no number'")
