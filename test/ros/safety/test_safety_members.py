"""A backend with every member of the safety chain under a real driver: what is called when, and what an input does."""

import os
import textwrap
import time

import pytest
from microstage_msgs.msg import AxisState, DriverStatus
from ros_support import ros_node, spin_until
from test_driver_safety import Commander

from microstage_ros.hardware.command_gate import CommandGate
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.ros.launching.cell_processes import CellProcesses
from microstage_ros.ros.loops.driver_periods import DriverPeriods
from microstage_ros.ros.operator import Operator
from microstage_ros.ros.transport.topics import LATCHED

CARD = """
    from pathlib import Path
    from microstage_ros.hardware.simulated import SimulatedAxis

    class Card:
        simulated = False

        def __init__(self, setup):
            self._folder = Path(setup.options["folder"])
            self._inner = SimulatedAxis(type(setup)(setup.axis, 1, {}))

        def _note(self, text):
            with open(self._folder / "calls", "a") as file:
                file.write(text + "\\n")

        def open(self):
            self._note("open")
            self._inner.open()

        def read(self):
            return self._inner.read()

        def write(self, voltage):
            self._inner.write(voltage)

        def close(self):
            self._note("close")
            self._inner.close()

        def enable(self, on):
            self._note(f"enable {on}")

        def watchdog(self, seconds):
            self._note(f"watchdog {seconds:g}")

        def e_stop(self):
            return (self._folder / "e_stop").exists()

        def limit_switches(self):
            return (self._folder / "lower").exists(), (self._folder / "upper").exists()
"""


class Rail(DriverPeriods):
    """What `_write` needs of a driver, with a drive that holds a position."""

    def __init__(self):
        self.gate, self._switches, self._written = CommandGate(10.0, unit="rad", holds=True), (False, False), 0.0
        self.hardware = self.guard = self
        self.written = []

    def write(self, command):
        self.written.append(command)

    def put(self, command):
        pass


def test_a_limit_switch_of_a_drive_that_holds_a_position():
    """Towards the switch is a command below the last one, whatever its sign; then the last one stays."""
    rail = Rail()
    rail._make_safe()
    assert not rail.written  # nobody has said where it stands
    rail.gate.activate()
    for period, command in enumerate((-3.0, -2.0)):  # away from the lower switch
        rail.gate.begin(period)
        rail.gate.offer(period, command)
        rail._write(rail.gate.voltage)
        rail._switches = (True, False)
    assert rail.written == [-3.0, -2.0] and rail.gate.fault == "none"
    rail.gate.begin(2)
    rail.gate.offer(2, -2.5)
    rail._write(rail.gate.voltage)
    assert rail.written[-1] == -2.0 and rail.gate.fault == "limit_switch" and "-2.5 rad" in rail.gate.message
    rail._make_safe()
    assert rail.written[-1] == rail.gate.voltage == -2.0


@pytest.fixture
def cell(tmp_path, monkeypatch):
    (tmp_path / "safe_card.py").write_text(textwrap.dedent(CARD))
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    load_axis(config_file("axis.yaml")).with_values({"period": 5e-3}, source="estimate").save(tmp_path / "axis.yaml")
    driver = {"mode": "paced", "backend": "safe_card:Card", "backend_options": f"{{folder: {tmp_path}}}", "axis_file": str(tmp_path / "axis.yaml"),
              "expected_subscribers": 1, "followers": [""], "command_timeout_s": 10.0}
    with ros_node() as node:
        heard = []
        node.create_subscription(DriverStatus, "/axis/driver_status", heard.append, LATCHED)
        commander = Commander(node)
        commander.voltage = 0.2
        with CellProcesses("/axis", ("axis_driver",), {"axis_driver": driver}, logs=tmp_path / "logs") as processes:
            processes.activate(node)
            yield tmp_path, node, heard, processes, commander
        assert (tmp_path / "calls").read_text().split("\n")[-2] == "close"


def calls(folder):
    return (folder / "calls").read_text().splitlines()


def test_the_chain(cell):
    folder, node, heard, processes, commander = cell
    spin_until(node, lambda: any(state.applied_voltage == 0.2 for state in commander.states))
    assert calls(folder) == ["open", "watchdog 0.013", "enable True"]  # 2.5 periods and half a millisecond
    with Operator("/axis", node) as operator:
        (folder / "lower").touch()  # away from it is let through
        before = len(commander.states)
        spin_until(node, lambda: len(commander.states) > before + 40)
        assert not heard[-1].fault
        commander.voltage = -0.2
        spin_until(node, lambda: heard[-1].fault == AxisState.FAULT_LIMIT_SWITCH)
        assert "lower limit switch" in heard[-1].message and "-0.2 V" in heard[-1].message
        spin_until(node, lambda: calls(folder)[-1] == "enable False")
        (folder / "lower").unlink()
        operator.reset()
        spin_until(node, lambda: not heard[-1].fault)
        assert calls(folder)[-2:] == ["watchdog 0.013", "enable True"]
        (folder / "e_stop").touch()
        spin_until(node, lambda: heard[-1].fault == AxisState.FAULT_E_STOP)
        faulted = len(commander.states)
        spin_until(node, lambda: len(commander.states) > faulted + 3 and calls(folder)[-1] == "enable False")
        assert all(state.applied_voltage == 0.0 for state in commander.states[faulted + 1:])
        operator.reset()
        time.sleep(0.2)  # still pressed
        assert operator.status().driver.fault == AxisState.FAULT_E_STOP
        (folder / "e_stop").unlink()
        operator.reset()
        spin_until(node, lambda: not heard[-1].fault)
    processes.deactivate(node)
    assert calls(folder)[-2:] == ["enable False", "watchdog 0"]
