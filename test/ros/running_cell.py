"""A cell of a test's own, of which processes may be killed and stopped."""

from contextlib import contextmanager, nullcontext

from microstage_msgs.msg import DriverStatus
from ros_support import PATIENCE_S, real_time_place, ros_node

from microstage_ros.ros.client import AxisClient
from microstage_ros.ros.launching.cell_processes import NODES, QUICK, CellProcesses
from microstage_ros.ros.launching.supervision import Supervisor
from microstage_ros.ros.transport.topics import LATCHED

TRIP_S = 2.0
"""Silence of the commands that is a fault [s]: longer than the host keeps a controller of these tests from its processor."""

WITHOUT_RECORDER = tuple(name for name in NODES if name != "bag_recorder")


@contextmanager
def running_cell(tmp_path, mode="paced", nodes=WITHOUT_RECORDER, supervised=False, ahead=None, **driver):
    """A cell that holds a position with some voltage: cell, node, client, statuses heard.

    ``ahead``: periods that its move server grants while it rests, None: as shipped.
    """
    parameters = {"axis_driver": {"mode": mode, "rate_limit": 1.0 if mode == "lockstep" else 0.0,
                                  "command_timeout_s": TRIP_S, **driver},
                  "move_server": {"silence_timeout_s": 1.2 * TRIP_S, **({"idle_window": ahead} if ahead else {})},
                  "bag_recorder": {"directory": str(tmp_path / "bag")}}
    with ros_node() as node, real_time_place() if mode == "paced" else nullcontext():
        heard = []
        node.create_subscription(DriverStatus, "/axis/driver_status", heard.append, LATCHED)
        with CellProcesses("/axis", nodes, parameters, logs=tmp_path / "logs") as cell:
            made = Supervisor(cell, node, tell=lambda text: None) if supervised else None
            cell.activate(node)
            client = AxisClient("/axis", node, wait=PATIENCE_S) if "move_server" in nodes else None
            try:
                yield cell, node, client, heard, made
            finally:
                cell.stop(QUICK)  # who was killed acknowledges nothing: nobody waits for it
