"""A cell on a backend from outside: the command, what it says, a move."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from microstage_msgs.msg import DriverStatus
from ros_support import PATIENCE_S, own_domain, real_time_place, spin_until

from microstage_ros.commands.backend import ChosenBackend
from microstage_ros.files import read_yaml
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.records import read_record
from microstage_ros.ros.client import AxisClient
from microstage_ros.ros.operator import Operator
from microstage_ros.ros.transport.topics import LATCHED

MACHINE = """
    from pathlib import Path

    from microstage_ros.hardware.simulated import SimulatedAxis

    class Machine:
        simulated = {simulated}

        def __init__(self, setup):
            self._inner = SimulatedAxis(setup)
            self.open = self._inner.open
            self.reads = self.writes = 0

        def read(self):
            self.reads += 1
            return tuple(self._inner.read())

        def write(self, voltage):
            self.writes += 1
            self._inner.write(voltage)

        def close(self):
            self._inner.close()
            if self.reads:
                Path(__file__).with_name("counts.txt").write_text(f"{{self.reads}} {{self.writes}}")
"""


@pytest.mark.parametrize("simulated", [False, True])
def test_the_cell_drives_it(tmp_path, simulated):
    """One write to a read; more where a command comes late, two to one before. A bag is recorded of a machine that is stepped, although
    it tells no truth and nobody publishes what instruments read: the recorder gave no credit, and the cell ended after 150 s."""
    (tmp_path / "bench_machine.py").write_text(textwrap.dedent(MACHINE).format(simulated=simulated))
    axis = load_axis(config_file("axis.yaml"))
    if not simulated:  # 10 kHz by the wall clock in plain Python would be late
        axis = axis.with_values({"period": 2e-3}).with_controller({"type": "self_tuning_observer"})
    axis.save(tmp_path / "axis.yaml")
    (tmp_path / "options.yaml").write_text("position: 2.0e-5\n")
    with own_domain(), real_time_place():
        environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
        process = subprocess.Popen(
            [sys.executable, "-m", "microstage_ros.commands", "cell", "--axis", str(tmp_path / "axis.yaml"), "--backend",
             "bench_machine:Machine", "--backend-options", str(tmp_path / "options.yaml"), *(["--record", str(tmp_path / "bag")] * simulated)],
            env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            line = process.stdout.readline()
            assert "is active" in line, process.stderr.read()
            assert ("lockstep, simulated" if simulated else "paced, bench_machine:Machine") in line
            _check(simulated)
        finally:
            process.send_signal(signal.SIGINT)
            _, told = process.communicate(timeout=240)
    assert ("simulated" in told) == simulated and "Traceback" not in told
    reads, writes = map(int, (tmp_path / "counts.txt").read_text().split())
    assert 0.9 * reads < writes < (1.5 if not simulated else 1.01) * reads + 10, (reads, writes)
    if simulated:
        record = read_record(tmp_path / "bag")
        assert "interferometer_m" not in record and np.isfinite(record["encoder_m"]).mean() > 0.99


def test_the_recorder_waits_for_what_somebody_publishes():
    """A backend without a truth has neither an interferometer nor a simulation topic."""
    assert ChosenBackend().recorder_parameters == {}
    known = read_yaml(config_file("bag_recorder.yaml"), "parameters")["servo_topics"]["default"]
    assert set(known) - set(ChosenBackend("my:Card", instruments=False).recorder_parameters["servo_topics"]) == {"interferometer", "simulation"}


def _check(simulated):
    rclpy.init()
    node = rclpy.create_node("tester", namespace="/axis")
    try:
        seen = []
        node.create_subscription(DriverStatus, "driver_status", seen.append, LATCHED)
        spin_until(node, lambda: seen)
        assert seen[-1].backend == "bench_machine:Machine" and seen[-1].simulated == simulated
        result = AxisClient("/axis", node, wait=240.0).move(3e-5, tolerance=1e-6, settle_time=0.05, timeout=10.0)
        assert result.reached or not simulated, result.message
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def test_the_cell_over_the_wire_to_an_emulated_card(tmp_path):
    """Backend mesa at 1 kHz, the simulated axis behind the card's registers: a move, and zero volts at the end."""
    axis = load_axis(config_file("axis.yaml")).with_values({"period": 1e-3}).with_controller({"type": "self_tuning"})
    axis.save(tmp_path / "axis.yaml")
    emulator = subprocess.Popen(
        [sys.executable, str(Path(__file__).parents[1] / "hardware" / "mesa_emulator.py"), "--axis", str(config_file("axis.yaml")),
         "--clock", "1e-3", "--priority", "10"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    port = int(emulator.stdout.readline())
    (tmp_path / "options.yaml").write_text(f"{{host: 127.0.0.1, port: {port}, watchdog_s: 0.2, wait_share: 20.0}}\n")
    with own_domain(), real_time_place():
        process = subprocess.Popen(
            [sys.executable, "-m", "microstage_ros.commands", "cell", "--axis", str(tmp_path / "axis.yaml"), "--backend", "mesa",
             "--backend-options", str(tmp_path / "options.yaml")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            line = process.stdout.readline()
            assert "paced, mesa" in line, process.stderr.read()
            rclpy.init()
            node = rclpy.create_node("tester", namespace="/axis")
            try:
                client = AxisClient("/axis", node, wait=240.0)
                end = time.monotonic() + 0.5 * PATIENCE_S
                while True:  # where real-time priorities are not permitted, a busy machine keeps the card's answers back
                    result = client.move(2e-5, tolerance=2e-6, settle_time=0.02, timeout=20.0)
                    if result.reached or "error level" not in result.message or time.monotonic() > end:
                        break
                    with Operator("/axis", node) as operator:
                        operator.reset()
                assert abs(result.final_error) < 5e-6, result.message
            finally:
                node.destroy_node()
                rclpy.try_shutdown()
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=240)
    emulator.stdin.close()
    found = json.loads(emulator.stdout.readline())
    emulator.wait(120)
    assert found["volts"] == 0.0 and found["most_voltage"] > 0.02
