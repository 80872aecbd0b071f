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


AXIS = load_axis("config/axis.yaml")
ROWS = 4000


class InPython(SimulatedAxis):
    """The same machine, read and written period by period."""

    arrays = None


def played(backend, law, reference, disturbance, error, jump):
    """Machine and record of three runs, the first two without a pause; the record is None where a run was refused."""
    hardware = backend(Setup(AXIS, seed=11))
    hardware.open()
    machine, controller, records = Machine(hardware, AXIS), make_controller(law, AXIS), []
    machine.begin()
    machine.top_speed = jump
    for go_on in (True, False, False):
        controller.reset()
        try:
            command = LawCommand(controller, reference, 1e-4)
            records.append(machine.run(reference, command, disturbance, error=error, go_on=go_on))
        except Refused as refusal:
            records.append(refusal.check.says)
        records.append(machine.ended)
    return machine, records


@pytest.mark.parametrize("law", ["self_tuning", "self_tuning_observer"])
@pytest.mark.parametrize("error, jump, ended", [(1e-3, 1.0, "rows"), (1e-7, 1.0, "error"), (1e-3, -0.0099, "jumped")])
def test_the_same_to_the_last_bit(law, error, jump, ended):
    time = np.arange(ROWS) * AXIS.value("period")
    reference, disturbance = 2e-5 * np.sin(20.0 * time) ** 2, 0.4 * np.sin(30.0 * time)
    (quick, ours), (slow, theirs) = (
        played(backend, law, reference, disturbance, error, jump) for backend in (SimulatedAxis, InPython)
    )
    for name in ("rows", "position", "used", "most_command"):
        assert getattr(quick, name) == getattr(slow, name), name
    for one, other in zip(ours, theirs):
        if isinstance(one, str):
            assert one == other
            continue
        assert set(one.columns) == set(other.columns)
        for name in one.columns:
            np.testing.assert_array_equal(one[name], other[name], name)
    assert ended in ours[1] + str(ours[0])


def test_a_controller_with_a_step_of_its_own_takes_it():
    parameters = controller_parameters("self_tuning_observer", AXIS, {})
    command = LawCommand(HeldController("self_tuning_observer", parameters), np.zeros(50), 0.0)
    hardware = SimulatedAxis(Setup(AXIS, seed=1))
    hardware.open()
    machine = Machine(hardware, AXIS)
    machine.begin()
    machine.run(np.zeros(50), command)
    assert np.isinf(command.controller.memory["observer"]["running"])
