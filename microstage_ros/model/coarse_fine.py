"""A machine of two components: a coarse axis with a fine stage on top, each described by an axis file of its own.

    format: 1
    name: screw with a piezo on top
    components: {coarse: ../axis.yaml, fine: piezo.yaml}      # relative to this file

The fine stage moves relative to the coarse one. Its drive has to hold a position and be commanded in volts (piezo).
"""

import pathlib
from dataclasses import dataclass

from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.axis_file import FORMAT, Axis, axis_from_dict, load_axis
from microstage_ros.files import read_yaml
from microstage_ros.quantities.command import VOLTAGE
from microstage_ros.quantities.errors import InputError

COMPONENTS = ("coarse", "fine")
KEYS = ("format", "name", "components")
FINE_LAW = "pid"
"""It acts on what an interferometer sees of the top."""


@dataclass(frozen=True)
class CoarseFine:
    """Two axes, one on top of the other.

    Attributes
    ----------
    name : of the machine. coarse, fine : `Axis`; ``coarse`` carries the mass of ``fine`` beside its own.
    """

    name: str
    coarse: Axis
    fine: Axis

    @property
    def alone(self):
        """{component: `Axis`}, each as a machine of its own.

        The coarse one has the mass of both, the fine one the law that controls it.
        """
        mass = self.coarse.value("stage.mass") + self.fine.value("stage.mass")
        source = self.coarse.quantity("stage.mass").source
        return {"coarse": self.coarse.with_values({"stage.mass": mass}, source),
                "fine": self.fine.with_controller({"type": FINE_LAW})}


def load_machine(path):
    """Read an axis file of one component or of two.

    Returns
    -------
    `Axis`, or `CoarseFine` where the file has ``components``.

    Raises
    ------
    InputError : a file that cannot be read, or two components that do not fit each other.
    """
    path = pathlib.Path(path)
    tree = read_yaml(path, "an axis file")
    if not isinstance(tree, dict) or "components" not in tree:
        return axis_from_dict(tree, str(path))
    for key in tree:
        if key not in KEYS:
            raise InputError(f"{path}: {key}", "unknown key", "one of " + ", ".join(KEYS))
    if tree.get("format") != FORMAT:
        raise InputError(f"{path}: format", tree.get("format"), f"{FORMAT}")
    parts = tree["components"]
    if not isinstance(parts, dict) or set(parts) != set(COMPONENTS):
        raise InputError(f"{path}: components", parts, "{coarse: FILE, fine: FILE}")
    coarse, fine = (load_axis(path.parent / str(parts[name])) for name in COMPONENTS)
    actuator = actuator_of(fine)
    if not actuator.holds_position or actuator.command is not VOLTAGE:
        raise InputError(f"{fine.place}: drive.type", actuator.name,
                         "a drive in volts that holds a position, such as piezo, on top")
    if abs(fine.value("period") / coarse.value("period") - 1.0) > 1e-9:
        raise InputError(f"{fine.place}: period", fine.value("period"),
                         f"{coarse.value('period'):g} s, as in {coarse.place}")
    return CoarseFine(str(tree.get("name", path)), coarse, fine)
