"""The driver alone, as a process: every bad command ends in zero voltage and a named, latched fault."""

import math
import time

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from microstage_msgs.msg import AxisState, ServoTiming, VoltageCommand
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from ros_support import ask, spin_until
from std_srvs.srv import Trigger

from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.ros.launching.cell_processes import CellFailure, CellProcesses

FAULTS = {getattr(AxisState, name): name for name in dir(type(AxisState)) if name.startswith("FAULT_")}


class Commander:
    """Stands in for a controller."""

    def __init__(self, node):
        self.node, self.states = node, []
        self.publisher = node.create_publisher(VoltageCommand, "/axis/command", 100)
        node.create_subscription(AxisState, "/axis/state", self._answer, 1000)
        self.voltage = None

    def _answer(self, state):
        self.states.append(state)
        if self.voltage is not None and not state.fault:
            self.send(state.sequence, self.voltage)

    def send(self, sequence, voltage):
        self.publisher.publish(VoltageCommand(sequence=sequence, voltage=voltage, sender=VoltageCommand.SENDER_MANUAL))

    def hear_all(self):
        """Take the states that are still on their way, so that no old one is answered later."""
        count = -1
        for _ in range(20):
            if count == len(self.states):
                return
            count, end = len(self.states), time.monotonic() + 0.5
            spin_until(self.node, lambda: time.monotonic() > end)
        pytest.fail("an inactive driver without a fault goes on publishing")

    def wait_for_fault(self, name):
        spin_until(self.node, lambda: self.states and FAULTS[self.states[-1].fault] == name)
        faulted = len(self.states)
        spin_until(self.node, lambda: len(self.states) > faulted + 3)  # it goes on measuring
        assert all(s.applied_voltage == 0.0 and s.status & AxisState.STATUS_FAULT for s in self.states[faulted:])


def driver(tmp_path, **parameters):
    """The driver alone."""
    return CellProcesses("/axis", ("axis_driver",), {"axis_driver": {
        "expected_subscribers": 1, "followers": [""], **parameters}}, logs=tmp_path)


def reset(node):
    answer = ask(node, Trigger, "/axis/reset_fault", Trigger.Request())
    assert answer.success
    return answer.message.split(" (")[0].split(";")[0]


def test_bad_commands(node, tmp_path):
    """One process, one fault after the other."""
    with driver(tmp_path, resend_s=0.2, command_timeout_lockstep_s=60.0) as cell:
        commander = Commander(node)
        spin_until(node, lambda: commander.publisher.get_subscription_count() == 1)
        for _ in range(6):  # each is answered
            found = ask(node, GetState, "/axis/axis_driver/get_state", GetState.Request())
            assert found.current_state.label == "unconfigured"
        for wrong in (Transition(id=77), Transition(label="fly"), Transition(id=Transition.TRANSITION_ACTIVATE)):
            answer = ask(node, ChangeState, "/axis/axis_driver/change_state", ChangeState.Request(transition=wrong))
            assert not answer.success  # there is none from here; rclpy alone would never answer

        commander.send(5, 1.0)  # nobody asked for it
        commander.wait_for_fault("FAULT_COMMAND_INACTIVE")
        with pytest.raises(CellFailure, match="command_inactive"):
            cell.activate(node)
        assert reset(node) == "was: command_inactive"
        commander.hear_all()

        for bad, fault in ((math.nan, "FAULT_COMMAND_NOT_FINITE"), (math.inf, "FAULT_COMMAND_NOT_FINITE")):
            commander.voltage = 0.5
            _activate(node, cell)
            count = len(commander.states)
            # states of the fault may still be on their way: what counts are those that obey
            spin_until(node, lambda: sum(s.applied_voltage == 0.5 for s in commander.states[count:]) > 20)
            assert commander.states[-1].applied_voltage == 0.5 and commander.states[-1].position > 0.0
            commander.voltage = bad
            commander.wait_for_fault(fault)
            commander.voltage = None
            cell.deactivate(node)
            assert reset(node) == "was: command_not_finite"
            commander.hear_all()

        commander.voltage = 100.0  # beyond the limit: clipped, told, no fault
        _activate(node, cell)
        spin_until(node, lambda: commander.states[-1].applied_voltage == 6.0)
        assert commander.states[-1].status & AxisState.STATUS_SATURATED and not commander.states[-1].fault

        shorter = Parameter("command_timeout_lockstep_s", value=1.0).to_parameter_msg()
        assert ask(node, SetParameters, "/axis/axis_driver/set_parameters",
                   SetParameters.Request(parameters=[shorter])).results[0].successful
        commander.voltage = None  # commands stop
        commander.wait_for_fault("FAULT_COMMAND_TIMEOUT")
        reset(node)
        commander.send(commander.states[-1].sequence + 1000, 0.0)
        commander.wait_for_fault("FAULT_COMMAND_SEQUENCE")
        answer = ask(node, Trigger, "/axis/reset_fault", Trigger.Request())
        assert answer.message.startswith("was: command_sequence (a command answered period")


def _activate(node, cell):
    state = ask(node, GetState, "/axis/axis_driver/get_state", GetState.Request()).current_state.id
    if state == State.PRIMARY_STATE_UNCONFIGURED:
        cell.activate(node)
    elif state == State.PRIMARY_STATE_INACTIVE:
        answer = ask(node, ChangeState, "/axis/axis_driver/change_state",
                     ChangeState.Request(transition=Transition(id=Transition.TRANSITION_ACTIVATE)))
        assert answer.success


def slow_axis(tmp_path):
    """File of an axis of 50 Hz, at which a test can stand in for a controller on a busy computer too: at 10 kHz it fell so far behind
    that no command was valid within two seconds."""
    load_axis(config_file("axis.yaml")).with_values({"period": 0.02}, source="estimate").save(tmp_path / "axis.yaml")
    return str(tmp_path / "axis.yaml")


def test_paced_driver_stops_when_commands_stop(node, tmp_path):
    with driver(tmp_path, mode="paced", command_timeout_s=4.0, axis_file=slow_axis(tmp_path)) as cell:
        commander = Commander(node)
        commander.voltage = 0.3
        cell.activate(node)
        spin_until(node, lambda: any(s.applied_voltage == 0.3 for s in commander.states))
        commander.voltage = None
        commander.wait_for_fault("FAULT_COMMAND_TIMEOUT")
        late = [s for s in commander.states if s.status & AxisState.STATUS_COMMAND_LATE]
        assert late and not any(s.status & AxisState.STATUS_LOCKSTEP for s in commander.states)


class Careless(Commander):
    """Leaves out the answers to some periods, gives others late, twice, or in the wrong order."""

    def _answer(self, state):
        self.states.append(state)
        n, kind = state.sequence, state.sequence % 5
        if kind == 2:
            self.send(n - 1, 0.1)  # late: the period before had no answer, nor has this one
        elif kind in (0, 3, 4):
            self.send(n, 0.001 * kind)
            if kind == 3:
                self.send(n, 0.5)  # again
            elif kind == 4:
                self.send(n - 1, 0.6)  # older than one that was obeyed


@pytest.mark.parametrize("compiled_loop", [True, False])
def test_late_lost_repeated_and_old_commands_when_paced(node, tmp_path, compiled_loop):
    """Each is counted, none is a fault; late ones are obeyed, repeated and old ones never."""
    told = []
    node.create_subscription(ServoTiming, "/axis/timing", told.append, 10)
    with driver(tmp_path, mode="paced", command_timeout_s=100.0, axis_file=slow_axis(tmp_path),
                compiled_loop=compiled_loop) as cell:
        commander = Careless(node)
        cell.activate(node)
        spin_until(node, lambda: told and min(
            told[-1].answered, told[-1].late, told[-1].lost, told[-1].duplicated, told[-1].reordered) > 0)
        spin_until(node, lambda: any(s.applied_voltage == 0.1 for s in commander.states))
        assert not any(s.fault for s in commander.states)
        assert {round(s.applied_voltage, 4) for s in commander.states} <= {0.0, 0.003, 0.004, 0.1}
        assert any(s.status & AxisState.STATUS_COMMAND_LATE for s in commander.states)


def test_a_driver_that_nobody_reads_is_not_activated(node, tmp_path):
    with driver(tmp_path, followers=["bag_recorder"], ready_timeout_s=2.0) as cell:
        Commander(node)
        began = time.monotonic()
        with pytest.raises(CellFailure, match="no credit from.*bag_recorder"):
            cell.activate(node)
        assert time.monotonic() > began


def test_a_driver_that_nobody_commands_is_not_activated(node, tmp_path):
    """Activated without a commander it would obey whoever comes first."""
    with driver(tmp_path, ready_timeout_s=1.0) as cell:
        node.create_subscription(AxisState, "/axis/state", lambda state: None, 10)
        with pytest.raises(CellFailure, match="nobody publishes on command"):
            cell.activate(node)
