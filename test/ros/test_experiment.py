"""``experiment --running``: a program on a cell that runs, which goes on afterwards."""

import os
import subprocess
import sys

import numpy as np
from ros_support import ros_node

from microstage_ros.records import read_record
from microstage_ros.ros.launching.cell_processes import NODES, CellProcesses

RUN = "program:\n  - {move_to_m: 1.0e-5, dwell_s: 0.1}\n  - {move_to_m: 0.0, dwell_s: 0.1}\n"


def experiment(folder, *more):
    """Run the command in a process of its own. Returns it when it has ended."""
    (folder / "run.yaml").write_text(RUN)
    return subprocess.run([sys.executable, "-m", "microstage_ros.commands", "experiment", "--running", "--run", str(folder / "run.yaml"),
                           "--out", str(folder / "out"), *more], env=dict(os.environ), capture_output=True, text=True, timeout=600)


def test_program_on_a_running_cell(tmp_path):
    nodes = [name for name in NODES if name not in ("bag_recorder", "interferometer_logger")]
    with ros_node() as node, CellProcesses("/axis", nodes, {"axis_driver": {"mode": "lockstep", "rate_limit": 1.0}}, tmp_path / "logs") as cell:
        cell.activate(node)
        done = experiment(tmp_path)
        assert done.returncode == 0, done.stderr
        cell.check()  # all its processes go on
    record = read_record(tmp_path / "out" / "bag")
    assert np.isfinite(record["reference_m"]).all() and record["reference_m"].max() == 1e-5
    rest = np.abs(record["encoder_m"][-300:] - record["reference_m"][-300:])
    assert rest.max() < 2e-7 and np.isfinite(record["encoder_m"]).all()


def test_without_a_cell(tmp_path):
    with ros_node():
        done = experiment(tmp_path, "--namespace", "/nobody")
    assert done.returncode == 1 and "/nobody" in done.stderr and "Traceback" not in done.stderr
