"""A lockstep cell at rest: it answers, times out, refuses a second owner, goes on after faults; one cell for all that leave it whole."""

import os
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
from microstage_msgs.action import MoveTo
from microstage_msgs.msg import AxisState, ControllerState, SimulationTruth
from ros_support import PATIENCE_S, spin_until
from running_cell import running_cell

from microstage_ros.ros.operator import Operator


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    with running_cell(tmp_path_factory.mktemp("cell"), "lockstep") as (cell, node, client, heard, _):
        yield SimpleNamespace(cell=cell, node=node, client=client, heard=heard)


@pytest.fixture
def resting(shared):
    """The cell, without a fault."""
    shared.cell.check()
    assert not shared.heard[-1].fault
    return shared


def test_a_move_that_timed_out_holds_and_the_next_one_goes(resting):
    result = resting.client.move(5e-3, timeout=0.2, max_velocity=1e-3)
    assert result.code == MoveTo.Result.CODE_TIMEOUT and "stopped in period" in result.message
    for target in (1e-5, 0.0):  # time went on between: the lockstep axis does not stand still after a move
        time.sleep(1.0)
        assert resting.client.move(target, timeout=20.0).reached


def test_two_owners_are_one_too_many(resting):
    commands = (["microstage_ros.commands", "cell"], ["microstage_ros.ros.nodes.axis_driver", "--ros-args", "-r", "__ns:=/axis"])
    others = [subprocess.Popen([sys.executable, "-m", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for words in commands]
    (cell, said), (driver, alone) = ((other, other.communicate(timeout=PATIENCE_S)[1]) for other in others)
    assert cell.returncode == 2 and len(said.strip().splitlines()) <= 3
    line = said.strip().splitlines()[-1]
    assert "namespace /axis" in line and f"process {os.getpid()}" in line and "since" in line
    assert driver.returncode == 2 and "namespace /axis" in alone and "Traceback" not in alone
    resting.cell.check()


def test_the_operator_is_answered(resting):
    with Operator("/axis", resting.node) as axis:
        assert resting.client.move(1e-5, timeout=20.0).reached
        status = axis.status()
        assert status.driver.active and status.driver.watched and status.driver.commander == "/axis/str_controller"
        assert abs(status.position - 1e-5) < 1e-6 and status.lifecycle == "active"
        jog = axis.jog(1e-3, 0.2)
        assert jog.accepted and abs(jog.target - 2.1e-4) < 1e-6
        assert not axis.jog(1.0, 0.2).accepted and not axis.jog(1e-3, 1e9).accepted
        assert axis.hold()[0] and axis.home()[0]
        stopped = axis.stop()
        assert stopped[0] and "voltage is zero" in stopped[1]
        assert axis.status().driver.fault == AxisState.FAULT_STOPPED and axis.status().voltage == 0.0
        spin_until(resting.node, lambda: not axis.home()[0])  # the move server hears of it a moment later
        assert axis.reset()[1].startswith("was: stopped")
        spin_until(resting.node, lambda: not resting.heard[-1].fault)
        assert resting.client.move(0.0, timeout=20.0).reached


def test_late_listeners_hear(resting):
    found = {}
    for kind, topic in ((ControllerState, "/axis/controller_state"), (SimulationTruth, "/axis/simulation")):
        resting.node.create_subscription(kind, topic, lambda message, topic=topic: found.setdefault(topic, message), 10)
    spin_until(resting.node, lambda: len(found) == 2)
