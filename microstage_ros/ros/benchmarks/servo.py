"""How fast the loop over topics is: the cell itself, process by process, and peers on the same machine.

`bench()` yields dicts: ``name``, ``value``, ``unit``, ``note``, and where there is one ``peer`` and ``peer_value``.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
import yaml
from microstage_msgs.msg import AxisState, ServoTiming, VoltageCommand

from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.ros.launching.cell_processes import NODES, CellProcesses
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.codec import Codec
from microstage_ros.ros.transport.servo_path import make_servo_path, reader_qos

PAIR = ("axis_driver", "str_controller")
TICKS = os.sysconf("SC_CLK_TCK")
ROUND_TRIPS, WARM_UP = 5000, 100
MOVING_WINDOW = 100
"""Of the move server while a move is under way: its parameter ``window``."""
SHORT = 8.0
"""Seconds of wall clock for one measurement of a running cell."""


def bench():
    """Yield all measurements, about a minute."""
    rclpy.init()
    try:
        node = rclpy.create_node("servo_bench", namespace="/bench")
        yield from round_trips(node)
        yield start(node, PAIR)
        yield start(node, NODES)
        yield from lockstep(node, PAIR, SHORT)
        yield from lockstep(node, NODES, SHORT)
        yield from lockstep(node, NODES, SHORT, moving=True)
        yield from paced(node, NODES, SHORT, 1e-3)
        yield from paced(node, NODES, SHORT, 1e-4)
    finally:
        rclpy.try_shutdown()


def bench_paced(seconds):
    """Yield the figures of ``seconds`` [s] at 10 kHz, and before and after it what the machine keeps without ROS."""
    rclpy.init()
    try:
        yield from bare_machine("before")
        yield from paced(rclpy.create_node("servo_bench", namespace="/bench"), NODES, seconds, 1e-4)
        yield from bare_machine("after")
    finally:
        rclpy.try_shutdown()


def bare_machine(when):
    """The bounds of `ros.benchmarks.bare_machine`."""
    done = subprocess.run(
        [sys.executable, "-m", "microstage_ros.ros.benchmarks.bare_machine", str(SHORT)],
        check=True,
        stdout=subprocess.PIPE,
    )
    found = json.loads(done.stdout)
    return [
        row(f"no ROS, 50 µs of work, {when}: {words}", found[key], unit)
        for key, words, unit in (
            ("rate", "periods", "1/s"),
            ("in_time", "done within the period", "1"),
            ("within_two", "done within two", "1"),
        )
    ]


def row(name, value, unit, note="", **peer):
    """One measurement: its name, ``value`` in ``unit``, a note, and a peer's if there is one."""
    return {"name": name, "value": float(value), "unit": unit, "note": note, **peer}


def start(node, nodes):
    """Wall clock from starting the processes of ``nodes`` (names) to the first command, one `row`."""
    heard = []
    watch = node.create_subscription(
        VoltageCommand, f"/bench/{topics.COMMAND}", lambda _: heard.append(time.monotonic()), 10
    )
    with tempfile.TemporaryDirectory() as folder:
        began = time.monotonic()
        with CellProcesses(
            "/bench", nodes, {"bag_recorder": {"directory": f"{folder}/bag"}}, Path(folder) / "logs"
        ) as cell:
            cell.activate(node)
            _spin(node, lambda: heard)
            cell.deactivate(node)
    node.destroy_subscription(watch)
    return row(f"start to the first controlled sample, {_which(nodes)}", heard[0] - began, "s")


def _which(nodes):
    return "driver and controller" if nodes == PAIR else f"all {len(nodes)} nodes, everything recorded"


def lockstep(node, nodes, seconds, moving=False):
    """Simulated time per wall clock of the running cell over ``seconds`` [s]; ``moving``: no further ahead than a
    cancelled move allows."""
    name = f"lockstep, {_which(nodes)}" + (", credit as during moves" if moving else "")
    with tempfile.TemporaryDirectory() as folder:
        parameters: dict[str, dict] = {"bag_recorder": {"directory": f"{folder}/bag"}}
        if moving:
            parameters["move_server"] = {"idle_window": MOVING_WINDOW}
        first, last, wall, shares = _observed(node, nodes, parameters, seconds, Path(folder))
    rate = (last.periods - first.periods) / wall
    return [
        row(f"{name}: times real time", rate * 1e-4, "1"),
        row(f"{name}: periods", rate, "1/s"),
        *_responses(name, last),
        *_shares(name, shares),
    ]


def paced(node, nodes, seconds, period):
    """Keeping time at the wall clock for ``seconds`` [s] at a control ``period`` [s]."""
    name = f"paced at {1e-3 / period:g} kHz, all {len(nodes)} nodes"
    with tempfile.TemporaryDirectory() as folder:
        axis = load_axis(config_file("axis.yaml")).with_values({"period": period}, source="estimate")
        axis.save(f"{folder}/axis.yaml")
        file = {"axis_file": f"{folder}/axis.yaml"}
        parameters = {
            "axis_driver": {"mode": "paced", "command_timeout_s": 10.0, **file},
            "str_controller": file,
            "gms_observer": file,
            "bag_recorder": {"directory": f"{folder}/bag", "log_time": "arrival"},
        }
        first, last, wall, shares = _observed(node, nodes, parameters, seconds, Path(folder))
        recorded = yaml.safe_load((Path(folder) / "bag" / "metadata.yaml").read_text(encoding="utf-8"))
    periods = last.periods - first.periods
    missing = recorded["rosbag2_bagfile_information"]["custom_data"]["missing_messages"]
    return [
        row(f"{name}: periods", periods / wall, "1/s"),
        row(f"{name}: answered within the period", (last.answered - first.answered) / periods, "1"),
        row(
            f"{name}: answered within two periods",
            _within(first, last, 2 * period),
            "1",
            note="by the histogram's bins",
        ),
        row(f"{name}: overruns", last.overruns - first.overruns, "1", note=f"of {periods} periods"),
        row(f"{name}: messages missing in the bag", sum(yaml.safe_load(missing).values()), "1"),
        *_responses(name, last),
        *_shares(name, shares),
    ]


def _responses(name, timing):
    return [
        row(f"{name}: response, {words}", value, "s")
        for words, value in (
            ("median", timing.response_median),
            ("99 %", timing.response_p99),
            ("99.99 %", timing.response_p9999),
        )
    ]


def _within(first, last, longest):
    """Share of the periods whose command came within ``longest`` [s], by the whole bins of the histogram below it."""
    counts = np.array(last.response_histogram) - np.array(first.response_histogram)
    edges = 10.0 ** (-5.0 + np.arange(1, len(counts) + 1) / 16)
    return float(counts[edges <= longest * 1.0001].sum()) / (last.periods - first.periods)


def _shares(name, shares):
    """One row for each process: cores, and of them the loop, the threads that bring it messages, all others."""
    return [
        row(
            f"{name}: {process}",
            sum(parts),
            "cores",
            note="loop {:.2f}, messages {:.2f}, other threads {:.2f}".format(*parts),
        )
        for process, parts in shares.items()
    ]


def _observed(node, nodes, parameters, seconds, folder):
    """First and last timing message over ``seconds``, the wall clock between, and the cores each process took."""
    heard = []
    watch = node.create_subscription(
        ServoTiming, f"/bench/{topics.TIMING}", lambda m: heard.append((time.monotonic(), m)), 10
    )
    with CellProcesses("/bench", nodes, parameters, folder / "logs") as cell:
        cell.activate(node)
        _spin(node, lambda: len(heard) > 1 and heard[-1][1].periods > 1)
        begin, before = len(heard) - 1, _cpu(cell)
        end = time.monotonic() + seconds
        _spin(node, lambda: time.monotonic() > end, seconds + 1.0)
        after = _cpu(cell)
        (t0, first), (t1, last) = heard[begin], heard[-1]
        cell.deactivate(node)
    node.destroy_subscription(watch)
    return first, last, t1 - t0, {name: (after[name] - before[name]) / seconds for name in nodes}


def _cpu(cell):
    """Processor time of every process so far [s]: its main thread, those that bring messages, all others."""
    times = {}
    for name, process in cell.processes.items():
        times[name] = np.zeros(3)
        for thread in Path(f"/proc/{process.pid}/task").iterdir():
            head, tail = (thread / "stat").read_text(encoding="utf-8", errors="replace").rsplit(")", 1)
            fields = tail.split()
            kind = 0 if thread.name == str(process.pid) else 1 if "(dds.dsha" in head else 2
            times[name][kind] += (int(fields[11]) + int(fields[12])) / TICKS
    return times


def _spin(node, condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)


def round_trips(node):
    """State there, command back, between two processes and nothing else; the peer is rclpy's own executor."""
    ours, theirs = _round_trip_times(node, "waitset"), _round_trip_times(node, "executor")
    peer = "SingleThreadedExecutor"
    return [
        row(f"round trip of a state and its command: {words}", of(ours), unit, peer=peer, peer_value=of(theirs))
        for words, of, unit in (
            ("rate", lambda t: 1.0 / t.mean(), "1/s"),
            ("median", np.median, "s"),
            ("99 %", lambda t: np.quantile(t, 0.99), "s"),
        )
    ]


def _round_trip_times(node, way):
    """Times [s] of the round trips that came back."""
    path = make_servo_path(node, plain=way == "executor")
    reader = path.reader(VoltageCommand, "/bench/echo/command", reader_qos(100, reliable=False))
    publisher = node.create_publisher(AxisState, "/bench/echo/state", topics.SERVO)
    send, raw = path.writer(publisher), Codec("AxisState").pack(0, 0, 0.0, 0.0, 0.0, 0.0, 0, 0)
    with subprocess.Popen([sys.executable, "-m", "microstage_ros.ros.benchmarks.servo", way]) as child:
        _spin(node, lambda: publisher.get_subscription_count() > 0 and reader.publishers > 0)
        times = []
        for _ in range(ROUND_TRIPS):
            began = time.perf_counter()
            send(raw)
            path.wait((reader,), 0.5)
            if reader.take() is not None:
                times.append(time.perf_counter() - began)
        child.terminate()
    node.destroy_publisher(publisher)
    return np.array(times[WARM_UP:])


def _echo(way):
    """The other process of `round_trips`."""
    rclpy.init()
    node = rclpy.create_node("echo", namespace="/bench")
    path = make_servo_path(node, plain=way == "executor")
    reader = path.reader(AxisState, "/bench/echo/state", reader_qos(100, reliable=False))
    send = path.writer(node.create_publisher(VoltageCommand, "/bench/echo/command", topics.SERVO))
    raw = Codec("VoltageCommand").pack(0, 0, 0.0, 0.0, 0.0, 1)
    try:
        while rclpy.ok():
            path.wait((reader,), 0.1)
            while reader.take() is not None:
                send(raw)
    except Exception:  # noqa: BLE001 - asked to stop in the middle of a call
        if rclpy.ok():
            raise


if __name__ == "__main__":
    _echo(sys.argv[1])
