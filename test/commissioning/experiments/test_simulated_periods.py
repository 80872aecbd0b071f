"""A simulated machine in compiled code does what it does period by period, to the last bit."""

import numpy as np
import pytest

from microstage_ros.commissioning.experiments.machine import Machine
from microstage_ros.commissioning.experiments.measured_loop import HeldController
from microstage_ros.commissioning.experiments.simulated_periods import LawCommand
from microstage_ros.commissioning.findings import Refused
from microstage_ros.control.laws.controller import controller_parameters, make_controller
from microstage_ros.hardware.protocol import Setup
from microstage_ros.hardware.simulated import SimulatedAxis
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file


AXIS = load_axis(config_file("axis.yaml"))
ROWS = 4000


class InPython(SimulatedAxis):
    """The same machine, read and written period by period."""

    arrays = None


def played(backend, law, allowed):
    """Machine after three runs, the second of which goes on where the first ends: its records, and why each ended."""
    time = np.arange(ROWS) * AXIS.value("period")
    reference, disturbance = 2e-5 * np.sin(20.0 * time) ** 2, 0.4 * np.sin(30.0 * time)
    hardware = backend(Setup(AXIS, seed=11))
    hardware.open()
    machine, controller, records, ends = Machine(hardware, AXIS), make_controller(law, AXIS), [], []
    machine.begin()
    machine.count, machine.top_speed = 0.0, allowed.get("speed", 1.0)
    for go_on in (True, False, False):
        controller.reset()
        try:
            machine.run(reference, LawCommand(controller, reference, 1e-4), disturbance, allowed.get("window"),
                        allowed.get("error", 1e-3), go_on=go_on)
            ends.append(machine.ended)
        except Refused as refusal:
            ends.append(refusal.check.says)
        records.append(machine.last)
    return machine, records, ends


@pytest.mark.parametrize("law", ["self_tuning", "self_tuning_observer"])
@pytest.mark.parametrize("allowed, ended", [
    ({}, "rows"), ({"error": 7e-8}, "error"), ({"speed": 2.2e-4}, "jumped"), ({"window": (-1e-5, 1e-5)}, "left the part"),
])
def test_the_same_to_the_last_bit(law, allowed, ended):
    (quick, ours, ends), (slow, theirs, others) = (played(backend, law, allowed) for backend in (SimulatedAxis, InPython))
    for name in ("rows", "position", "used", "most_command"):
        assert getattr(quick, name) == getattr(slow, name), name
    assert ends == others and ended in ends[0]
    for one, other in zip(ours, theirs):
        assert set(one.columns) == set(other.columns)
        for name in one.columns:
            np.testing.assert_array_equal(one[name], other[name], name)
    assert ended == "rows" or 5 < len(ours[0]["encoder_m"]) < ROWS      # after some periods


def test_a_controller_with_a_step_of_its_own_takes_it():
    parameters = controller_parameters("self_tuning_observer", AXIS, {})
    command = LawCommand(HeldController("self_tuning_observer", parameters), np.zeros(50), 0.0)
    hardware = SimulatedAxis(Setup(AXIS, seed=1))
    hardware.open()
    machine = Machine(hardware, AXIS)
    machine.begin()
    machine.run(np.zeros(50), command)
    assert np.isinf(command.controller.memory["observer"]["running"])
