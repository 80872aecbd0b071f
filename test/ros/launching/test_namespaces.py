"""Two axes side by side in one domain do not hear each other."""

from microstage_msgs.msg import AxisState
from ros_support import ros_node, spin_until

from microstage_ros.ros.client import AxisClient
from microstage_ros.ros.launching.cell_processes import CellProcesses

NODES = ("str_controller", "move_server", "axis_driver")


def test_two_axes(tmp_path):
    parameters = {"move_server": {"pause_s": 600.0}, "axis_driver": {"command_timeout_lockstep_s": 60.0, "rate_limit": 1.0}}
    with ros_node(namespace="/") as node, CellProcesses("/left", NODES, parameters, tmp_path / "left") as left, \
            CellProcesses("/right", NODES, parameters, tmp_path / "right") as right:
        seen = {"/left": [], "/right": []}
        for name, states in seen.items():
            node.create_subscription(AxisState, f"{name}/state", states.append, 5000)
        left.activate(node)
        right.activate(node)
        clients = [AxisClient(name, node, wait=60.0) for name in ("/left", "/right")]
        assert clients[0].move(1e-5, settle_time=0.01).reached
        clients[0].wait_until_still()
        spin_until(node, lambda: seen["/left"][-1].position > 9e-6)       # a busy machine reads what was sent later
        assert max(abs(state.position) for state in seen["/right"]) < 2e-7
        assert clients[1].move(-1e-5, settle_time=0.01).reached
        clients[1].wait_until_still()
        spin_until(node, lambda: seen["/right"][-1].position < -9e-6)
        assert seen["/left"][-1].position > 9e-6
        assert not clients[1].statistics()[0].target > 0 and len(clients[0].statistics()) == 1
