"""Every shipped kind of drive in a cell, lockstep: a move reaches its target, and status, faults and the bag say the command's unit."""

from pathlib import Path

import numpy as np
import pytest
from microstage_msgs.msg import DriverStatus
from microstage_msgs.srv import GetStatus
from ros_support import ask, ros_node, spin_until

from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.axis_file import load_axis
from microstage_ros.records import read_record
from microstage_ros.ros.client import AxisClient
from microstage_ros.ros.launching.cell_processes import CellProcesses
from microstage_ros.ros.operator import Operator
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.topics import LATCHED

AXES = Path(__file__).resolve().parents[2] / "config" / "axes"
#: Axis: move [m], and the tolerance that its sensor's noise and its microsteps allow [m].
MOVES = {"current_motor": (1e-3, 2e-7), "voice_coil": (1e-3, 1e-7), "stepper": (1e-3, 1e-6), "piezo": (3e-6, 2e-8)}


@pytest.mark.parametrize("name", MOVES)
def test_a_move_in_the_unit_of_the_drive(name, tmp_path):
    path = AXES / f"{name}.yaml"
    axis = load_axis(path)
    command, (target, tolerance) = actuator_of(axis).command, MOVES[name]
    own = {"axis_file": str(path)}
    parameters = {"axis_driver": {**own, "seed": 2, "command_timeout_lockstep_s": 60.0, "rate_limit": 1.0}, "str_controller": own, "gms_observer": own,
                  "move_server": {"pause_s": 600.0}, "bag_recorder": {"directory": str(tmp_path / "bag")}}
    with ros_node() as node, CellProcesses("/axis", parameters=parameters, logs=tmp_path / "logs") as cell:
        cell.activate(node)
        seen = []
        node.create_subscription(DriverStatus, "driver_status", seen.append, LATCHED)
        result = AxisClient("/axis", node, wait=60.0).move(target, tolerance=tolerance, settle_time=0.02)
        assert result.reached, result.message
        spin_until(node, lambda: seen)
        assert (seen[-1].command_quantity, seen[-1].command_unit) == (command.quantity, command.unit)
        assert seen[-1].voltage_limit == pytest.approx(actuator_of(axis).command_limit(axis))
        status = ask(node, GetStatus, topics.STATUS, GetStatus.Request())
        assert status.driver.command_unit == command.unit
        with Operator("/axis", node) as operator:
            stopped = operator.stop()
            assert stopped[0] and actuator_of(axis).holds_on_fault == ("keeps its last value" in stopped[1])
            first = operator.status()
            spin_until(node, lambda: operator.status().driver.sequence > first.driver.sequence + 50)
            last = operator.status()
        if actuator_of(axis).holds_on_fault:  # zero would be a move back
            assert last.voltage == first.voltage != 0.0 and abs(last.position - target) < 3 * tolerance
        else:
            assert last.voltage == 0.0
        cell.deactivate(node)
    record = read_record(tmp_path / "bag")
    assert record.metadata["command"] == command.as_dict()
    assert command.column in record and (command.unit == "V") == ("voltage_V" in record)
    assert np.nanmax(np.abs(record[command.column])) <= actuator_of(axis).command_limit(axis)
    if actuator_of(axis).holds_position:
        reached = record["encoder_m"][np.isfinite(record["encoder_m"])]
        assert np.abs(reached[-50:] - target).max() < 3 * tolerance  # also under the fault
    assert ("current_A" in record) == actuator_of(axis).measures_current     # no sensor, no column
