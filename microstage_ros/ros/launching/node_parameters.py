"""The parameters of every node of an axis, asked for over their services while a bag is recorded."""

import json
import time
from pathlib import Path

import rclpy.parameter
from rcl_interfaces.srv import GetParameters, ListParameters

from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file


READING = ((ListParameters, "list_parameters"), (GetParameters, "get_parameters"))
"""What is asked of a node; rclpy's own client of parameters may set them, too, which a recorder's key must not."""

ASK_AGAIN_S = 0.5
"""An answer that has not come after so long [s] was lost, as happens while processes discover each other."""


class ParameterCollector:
    """Asks every node until it has answered.

    Attributes
    ----------
    found : full name of a node to its parameters, name to value.
    """

    def __init__(self, node):
        self._node = node
        self._asked, self._clients = {}, {}
        self.found = {node.get_fully_qualified_name(): {name: p.value for name, p in node._parameters.items()}}

    def look(self, prefix):
        """Ask nodes below ``prefix`` that have not been asked."""
        for name, namespace in self._node.get_node_names_and_namespaces():
            full = f"{namespace.rstrip('/')}/{name}"
            if (
                not full.startswith(prefix)
                or full in self.found
                or time.monotonic() - self._asked.get(full, -ASK_AGAIN_S) < ASK_AGAIN_S
            ):
                continue
            if full not in self._clients:
                self._clients[full] = tuple(self._node.create_client(kind, f"{full}/{name}") for kind, name in READING)
            if all(client.service_is_ready() for client in self._clients[full]):
                self._asked[full] = time.monotonic()
                asked = self._clients[full][0].call_async(ListParameters.Request(depth=10))
                asked.add_done_callback(lambda f, full=full: self._listed(full, f))

    def _listed(self, full, future):
        names = future.result().result.names
        self._clients[full][1].call_async(GetParameters.Request(names=names)).add_done_callback(
            lambda f: self.found.__setitem__(full, _values(names, f.result().values)))

    def run_facts(self):
        """Seed, axis file and kind of command of the run, from the driver's parameters."""
        for name, values in self.found.items():
            if name.endswith("/axis_driver"):
                path = Path(values["axis_file"] or config_file("axis.yaml"))
                command = actuator_of(load_axis(path)).command
                return {"seed": str(values["seed"]), "axis_file": path.read_text(encoding="utf-8"),
                        "command": json.dumps(command.as_dict())}
        return {}


def _values(names, values):
    found = {}
    for name, value in zip(names, values):
        plain = rclpy.parameter.parameter_value_to_python(value)
        found[name] = list(plain) if isinstance(plain, (list, tuple)) or hasattr(plain, "tolist") else plain
    return found
