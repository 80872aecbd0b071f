"""A running cell under a flood of messages from a stranger: it must go on as if nobody had spoken."""

import tempfile
import time
from pathlib import Path

import rclpy
from microstage_msgs.msg import ServoTiming
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

from microstage_ros.ros.benchmarks.hostile.messages import flood
from microstage_ros.ros.benchmarks.trial_cell import NAMESPACE
from microstage_ros.ros.client import AxisClient
from microstage_ros.ros.launching.cell_processes import NODES, CellProcesses
from microstage_ros.ros.transport import topics

WITHOUT_RECORDER = tuple(name for name in NODES if name != "bag_recorder")


def flood_a_cell(count, seed):
    """Send ``count`` messages [1] to a lockstep cell, move before and after; the facts as plain data.

    ``seed``: of the messages [1].
    """
    with tempfile.TemporaryDirectory(prefix="microstage_flood_") as folder:
        node = rclpy.create_node("cell_starter", namespace=NAMESPACE)
        stranger_node = rclpy.create_node("stranger", namespace=NAMESPACE, context=another_context())
        try:
            with CellProcesses(
                NAMESPACE, WITHOUT_RECORDER, {"axis_driver": {"rate_limit": 1.0}}, logs=folder
            ) as cell:
                cell.activate(node)
                client = AxisClient(NAMESPACE, node, wait=60.0)
                timings = []
                node.create_subscription(ServoTiming, topics.TIMING, timings.append, 10)
                before = client.move(1e-5, timeout=20.0).reached
                began = time.monotonic()
                stranger = flood(stranger_node, count, seed, lambda: rclpy.spin_once(node, timeout_sec=0.0))
                took = time.monotonic() - began
                ended = [name for name, process in cell.processes.items() if process.poll() is not None]
                last = None if ended else client.move(-1e-5, timeout=20.0)
                after = last is not None and last.reached
                end = time.monotonic() + 1.5
                while time.monotonic() < end:
                    rclpy.spin_once(node, timeout_sec=0.05)
            said = [
                path.name
                for path in Path(folder).glob("*.log")
                if "Traceback" in path.read_text(encoding="utf-8", errors="replace")
            ]
        finally:
            stranger_node.destroy_node()
            node.destroy_node()
    short = [
        text
        for text, bad in (
            (f"ended: {', '.join(ended)}", ended),
            ("no move before", not before),
            (f"no move after ({last.message if last else chr(45)})", not after),
            (f"traceback of {', '.join(said)}", said),
        )
        if bad
    ]
    heard = {name: getattr(timings[-1], name) if timings else None for name in ("foreign", "malformed")}
    return {
        "sent": stranger.sent,
        "refused_by_the_driver": heard,
        "refused_by_the_middleware": stranger.refused,
        "commands_sent": stranger.commands,
        "commands_arrived": None if None in heard.values() else sum(heard.values()),
        "seconds": round(took, 2),
        "moved_before": bool(before),
        "moved_after": bool(after),
        "fell_short": "; ".join(short),
    }


def another_context():
    """A context of its own: another participant, as another process would have."""
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    return context
