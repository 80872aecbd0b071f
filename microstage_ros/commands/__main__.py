"""``./microstage COMMAND``: looks the command up, loads it alone, turns its errors into exit statuses.

0 done; 2 usage or bad input (one line on standard error); 1 anything else.
"""

import importlib
import os
import sys

from microstage_ros import __version__
from microstage_ros.commands import COMMANDS, module_of
from microstage_ros.quantities.errors import InputError


def usage():
    """The help text."""
    width = max(map(len, COMMANDS))
    lines = [f"usage: microstage COMMAND [options]      microstage_ros {__version__}", "",
             *(f"  {name:<{width}}  {text}" for name, text in COMMANDS.items()), "",
             "microstage COMMAND --help tells the options of a command.", which_ros()]
    return "\n".join(lines)


def which_ros():
    """Which ROS 2 this is, in one line."""
    return os.environ.get("MICROSTAGE_ROS") or f"ROS 2 {os.environ.get('ROS_DISTRO', '(none)')}, as sourced."


def run(name, arguments):
    """Run one command. Returns the exit status."""
    try:
        status = importlib.import_module(module_of(name)).main(arguments)
        sys.stdout.flush()
        return status or 0
    except InputError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # the reader of our output has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def main(arguments=None):
    """The command line. Returns the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(usage())
        return 0 if arguments else 2
    if arguments[0] == "--version":
        print(f"microstage_ros {__version__}\n{which_ros()}")
        return 0
    if arguments[0] not in COMMANDS:
        print(f"microstage: command: got {arguments[0]!r}, expected one of {', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    return run(arguments[0], arguments[1:])


def __getattr__(name):
    """The executable of each command, for ``ros2 run microstage_ros NAME``."""
    if name in COMMANDS:
        return lambda: run(name, sys.argv[1:])
    raise AttributeError(name)


if __name__ == "__main__":
    sys.exit(main())
