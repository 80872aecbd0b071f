"""The options ``--backend`` and ``--backend-options`` of the commands that drive an axis."""

from dataclasses import dataclass, field
from pathlib import Path

import yaml

from microstage_ros.files import read_yaml
from microstage_ros.hardware import BACKENDS, make_hardware
from microstage_ros.hardware.protocol import Setup
from microstage_ros.quantities.errors import InputError

SIMULATED = "simulated"
# topics of which a bag may lose nothing, where no instrument reads a truth: nobody publishes the other two
WITHOUT_INSTRUMENTS = ("state", "command", "controller_state", "friction")


@dataclass(frozen=True)
class ChosenBackend:
    """A backend as the user chose it, checked.

    Attributes
    ----------
    name : as given. options : of the backend. simulated : what it says of itself.
    instruments : it offers the truth that simulated instruments read.
    """

    name: str = SIMULATED
    options: dict = field(default_factory=dict)
    simulated: bool = True
    instruments: bool = True

    @property
    def mode(self):
        """How time passes unless something else is asked for."""
        return "lockstep" if self.simulated else "paced"

    @property
    def driver_parameters(self):
        """Parameters of the node ``axis_driver``."""
        return {"backend": self.name, "backend_options": yaml.safe_dump(self.options, default_flow_style=True).strip()}

    @property
    def recorder_parameters(self):
        """Parameters of the node ``bag_recorder``, which waits in lockstep until each of its topics has a publisher."""
        return {} if self.instruments else {"servo_topics": list(WITHOUT_INSTRUMENTS)}

    def nodes(self, names):
        """Those of the nodes that have something to do with this backend."""
        return tuple(name for name in names if self.instruments or name != "interferometer_logger")

    def mode_or(self, asked):
        """The mode that was asked for, or this backend's own. Raises `InputError` for lockstep with real time."""
        if asked == "lockstep" and not self.simulated:
            raise InputError("--mode", asked, f"paced: backend {self.name} has its own time")
        return asked or self.mode

    def words(self, axis_name, seed):
        """What is driven, in one sentence, with the axis's name and the ``seed`` [1] of a simulation."""
        if self.simulated:
            whose = "" if self.name == SIMULATED else f", backend {self.name}"
            return f"The axis is simulated ({axis_name}, seed {seed}{whose}); nothing moves."
        return f"Backend {self.name} drives the axis ({axis_name}): it moves."


def add_backend(parser):
    """Add the two options to a parser."""
    parser.add_argument("--backend", default=SIMULATED, metavar="NAME",
                        help=f"{', '.join(BACKENDS)}, an entry point, or package.module:Class from PYTHONPATH "
                             f"(default {SIMULATED})")
    parser.add_argument("--backend-options", metavar="FILE", help="YAML file with the options of the backend")
    parser.add_argument(
        "--machine",
        metavar="FILE",
        help="axis file of the machine that is simulated, where it is not the "
        "one that the controller is given (backend simulated only)",
    )


def load_options(path):
    """The mapping in a file of backend options; empty without a file. Raises `InputError`."""
    if not path:
        return {}
    found = read_yaml(path, "a YAML file of backend options")
    if found is not None and not isinstance(found, dict):
        raise InputError(str(path), found, "a mapping of option names to values")
    return found or {}


def backend_options(arguments):
    """The options of the backend from the parsed ``--backend-options`` and ``--machine``. Raises `InputError`."""
    options = load_options(arguments.backend_options)
    machine = getattr(arguments, "machine", None)
    if machine and arguments.backend != SIMULATED:
        raise InputError("--machine", machine, f"the backend {SIMULATED}: {arguments.backend} has a machine of its own")
    if machine:
        options = {**options, "machine": str(Path(machine).resolve())}
    return options


def chosen_backend(arguments, axis):
    """`ChosenBackend` of the parsed options; the class is made once, not opened, to see that it can be."""
    options = backend_options(arguments)
    if arguments.backend == SIMULATED and not options:
        return ChosenBackend()
    made = make_hardware(arguments.backend, Setup(axis, getattr(arguments, "seed", 0), options))
    return ChosenBackend(arguments.backend, options, bool(made.simulated),
                         bool(getattr(made, "has_truth", made.simulated)))
