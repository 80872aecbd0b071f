"""``experiment --running``: a program on a cell that runs, which goes on afterwards."""

import os
import signal
import subprocess
import sys
import time
import types

import numpy as np
import pytest
import rclpy
from microstage_msgs.msg import ControllerState
from ros_support import PATIENCE_S, ros_node, spin_until

from microstage_ros.commands.operation import experiment as command

from microstage_ros.records import read_record
from microstage_ros.records.bags.bag_record import FIELDS, own_definition
from microstage_ros.records.bags.bag_writer import BagWriter
from microstage_ros.records.bags.layout import layout_of_type
from microstage_ros.ros.launching.cell_processes import NODES, CellFailure, CellProcesses

RUN = "program:\n  - {move_to_m: 1.0e-5, dwell_s: 0.1}\n  - {move_to_m: 0.0, dwell_s: 0.1}\n"


def started(folder, *more, run=RUN):
    """The command in a process of its own."""
    (folder / "run.yaml").write_text(run)
    return subprocess.Popen([sys.executable, "-m", "microstage_ros.commands", "experiment", "--running", "--run", str(folder / "run.yaml"),
                             "--out", str(folder / "out"), *more], env=dict(os.environ), text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def experiment(folder, *more):
    """Run the command in a process of its own. Returns its status and what it said on standard error."""
    process = started(folder, *more)
    _, err = process.communicate(timeout=600)
    return types.SimpleNamespace(returncode=process.returncode, stderr=err)


def test_program_on_a_running_cell(tmp_path):
    nodes = [name for name in NODES if name not in ("bag_recorder", "interferometer_logger")]
    with ros_node() as node, CellProcesses("/axis", nodes, {"axis_driver": {"mode": "lockstep", "rate_limit": 1.0}}, tmp_path / "logs") as cell:
        cell.activate(node)
        done = experiment(tmp_path)
        assert done.returncode == 0, done.stderr
        cell.check()  # all its processes go on
    record = read_record(tmp_path / "out" / "bag")
    assert np.isfinite(record["reference_m"]).all() and record["reference_m"].max() == 1e-5
    assert np.flatnonzero(record["reference_m"])[0] >= command.LEAD_IN / record.period_s  # the rest before the programme
    rest = np.abs(record["encoder_m"][-300:] - record["reference_m"][-300:])
    assert rest.max() < 2e-7 and np.isfinite(record["encoder_m"]).all()


def test_the_programme_waits_for_every_topic_of_the_bag(tmp_path, monkeypatch):
    """The recorder may hear the axis before it has found the controller, or the observer."""
    monkeypatch.setattr(command, "LOOK", 0.0)
    monkeypatch.setattr(command, "STALLED", 0.2)
    turns = []
    with BagWriter(tmp_path / "bag") as bag:
        kinds = {topic: own_definition(FIELDS[topic][0]) for topic in ("state", "command", "simulation")}
        channels = {topic: bag.add_channel(f"/axis/{topic}", kind) for topic, kind in kinds.items()}

        def write(topic):
            bag.write(channels[topic], 1, layout_of_type(kinds[topic]).blank())
            bag.flush()

        def turn():
            turns.append(None)
            if len(turns) == 5:
                write("simulation")

        player = types.SimpleNamespace(turn=lambda: None, published=lambda: ({"/axis/state", "/axis/command"}, {"/axis/simulation"}))
        write("state")
        with pytest.raises(CellFailure, match="heard nothing of /axis/command for"):
            command._until_recorded(player, tmp_path / "bag")
        write("command")
        monkeypatch.setattr(command, "OTHERS", 0.05)
        command._until_recorded(player, tmp_path / "bag")  # a silent publisher is not waited for without end
        monkeypatch.setattr(command, "OTHERS", 600.0)
        monkeypatch.setattr(command, "STALLED", 600.0)
        player.turn = turn
        command._until_recorded(player, tmp_path / "bag")
    assert len(turns) >= 5


def test_without_a_cell(tmp_path):
    with ros_node():
        done = experiment(tmp_path, "--namespace", "/nobody")
    assert done.returncode == 1 and "/nobody" in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "out" / "bag").exists()  # so that the same command may be used again


def test_ctrl_c_stops_the_axis(tmp_path):
    """Reference for 40 s is queued; who interrupts the command expects the axis to stand."""
    run = "program:\n  - {sine: {amplitude_m: 2.0e-4, frequency_hz: 0.5, cycles: 20}}\n"
    nodes, heard = [name for name in NODES if name not in ("bag_recorder", "interferometer_logger")], []
    with ros_node() as node, CellProcesses("/axis", nodes, {"axis_driver": {"mode": "lockstep", "rate_limit": 1.0}}, tmp_path / "logs") as cell:
        cell.activate(node)
        node.create_subscription(ControllerState, "/axis/controller_state", lambda state: heard.append(state.reference), 10)
        process = started(tmp_path, run=run)
        spin_until(node, lambda: process.poll() is not None or (heard and abs(heard[-1]) > 5e-5))
        process.send_signal(signal.SIGINT)
        spin_until(node, lambda: process.poll() is not None, 60.0)
        out, err = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 1 and "the axis stops and holds" in err and "Traceback" not in err, err
        heard.clear()
        spin_until(node, lambda: len(heard) > 20)
        assert np.ptp(heard) == 0.0
    assert not (tmp_path / "out" / "bag").exists()


class Service:
    """The controller's service; it answers what it is asked, a reference with ``accepted`` as it was made."""

    def __init__(self, accepted=True):
        self.asked, self._accepted = [], accepted

    def service_is_ready(self):
        return True

    def call_async(self, request):
        self.asked.append(len(request.positions))
        answer = types.SimpleNamespace(accepted=self._accepted or not request.positions, start_sequence=10**8, rest_sequence=10**9,
                                       message="no")
        return types.SimpleNamespace(done=lambda: True, result=lambda: answer)


def player_of(service, came=(), check=lambda: None):
    """A player without any process, whose controller says that its reference stands at 0."""
    node = types.SimpleNamespace(create_client=lambda *_: service, create_subscription=lambda *_: None)
    player = command._Player(node, types.SimpleNamespace(check=check), 1e-3, came)
    player._hear(types.SimpleNamespace(reference=0.0, sequence=0))
    return player


@pytest.mark.parametrize(("publishers", "says"), [(1, "microstage reset"), (0, "microstage cell")])
def test_an_axis_that_was_stopped_is_not_taken_for_none(monkeypatch, publishers, says):
    monkeypatch.setattr(rclpy, "spin_once", lambda *_, **__: None)
    monkeypatch.setattr(command, "ANSWER", 0.05)
    monkeypatch.setattr(command, "SOUGHT", 0.05)
    node = types.SimpleNamespace(create_client=lambda *_: Service(), create_subscription=lambda *_: types.SimpleNamespace(topic_name="state"),
                                 count_publishers=lambda _: publishers)
    with pytest.raises(CellFailure, match=says):
        command._Player(node, types.SimpleNamespace(check=lambda: None), 1e-3).meet("/axis")


@pytest.mark.parametrize("place", [3e-6, None])
def test_a_program_that_another_ends_is_not_said_to_be_made(monkeypatch, place):
    """After an operator's hold the controller goes on to publish states: the record was said to hold the whole program."""
    sequence = [0]

    class Controller:
        """Plays what it is asked; ``place``: where somebody holds it, a tenth of a second into the program."""

        def __init__(self):
            self.plans = []

        def service_is_ready(self):
            return True

        def call_async(self, request):
            self.plans.append((sequence[0], list(request.positions)))
            answer = types.SimpleNamespace(accepted=True, start_sequence=sequence[0], rest_sequence=sequence[0] + len(request.positions))
            return types.SimpleNamespace(done=lambda: True, result=lambda: answer)

    def turn(*_, **__):
        sequence[0] += 10
        start, positions = service.plans[-1]
        reference = positions[min(sequence[0] - start, len(positions) - 1)]
        held = place is not None and len(service.plans) == 2 and sequence[0] - start > 150
        player._hear(types.SimpleNamespace(reference=place if held else reference, sequence=sequence[0]))

    service = Controller()
    player = player_of(service)
    monkeypatch.setattr(rclpy, "spin_once", turn)
    if place is None:
        player.play(np.linspace(0.0, 1e-5, 1000))
        return
    with pytest.raises(CellFailure, match="the program was ended by another .* the reference is at 3e-06 m where the program has"):
        player.play(np.linspace(0.0, 1e-5, 1000))
    assert len(service.plans) == 2  # what plays now is another's: it is not stopped


@pytest.mark.parametrize("end", ["signal", "recorder", "refusal"])
def test_whatever_ends_the_program_early_the_axis_is_asked_to_stop(monkeypatch, end):
    """Not where the reference was refused: then nothing of this command is under way."""
    came, service, turns = [], Service(accepted=end != "refusal"), []

    def check():
        turns.append(time.monotonic())
        if len(turns) > 3 and end == "recorder":
            raise CellFailure("bag_recorder ended with status 1")

    def turn(*_, **__):
        if len(turns) > 3 and end == "signal":
            came.append(signal.SIGINT)

    monkeypatch.setattr(rclpy, "spin_once", turn)
    monkeypatch.setattr(rclpy, "ok", lambda: True)
    with pytest.raises(KeyboardInterrupt if end == "signal" else CellFailure):
        player_of(service, came, check).play(np.linspace(0.0, 1e-5, 100))
    assert service.asked[0] > 0 and service.asked[1:] == ([] if end == "refusal" else [0])
