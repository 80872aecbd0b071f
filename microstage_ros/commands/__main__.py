"""``./microstage COMMAND``: looks the command up, loads it alone, turns its errors into exit statuses.

0 done; 2 usage or bad input (one line on standard error); 1 anything else, an interruption too.
"""

import errno
import importlib
import os
import sys

from microstage_ros import __version__
from microstage_ros.commands import COMMANDS, answer, module_of
from microstage_ros.commands.parser import nearest
from microstage_ros.quantities.errors import InputError


def usage():
    """The help text."""
    width = max(map(len, COMMANDS))
    lines = [f"usage: microstage COMMAND [options]      microstage_ros {__version__}", "",
             *(f"  {name:<{width}}  {text}" for name, text in COMMANDS.items()), "",
             "microstage COMMAND --help lists the options of a command.", which_ros()]
    return "\n".join(lines)


def which_ros():
    """Which ROS 2 this is, in one line."""
    return os.environ.get("MICROSTAGE_ROS") or f"ROS 2 {os.environ.get('ROS_DISTRO', '(none)')}, as sourced."


def run(name, arguments):
    """Run one command. Returns the exit status."""
    # the threads of the linear algebra wait for one another on the processor: where two other programs keep both cores
    # busy, a diagnosis takes 29 and 34 s with two of them, 16 and 17 s with one; on idle cores 12 s with either
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    answer.begin()
    status = 1
    try:
        status = _run(name, arguments)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of our output has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    finally:
        _finish(name, status)
    return status


def _finish(name, status):
    """Print the answer of --json, if anybody still reads."""
    try:
        answer.finish(name, status)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _run(name, arguments):
    """Run one command, its errors as exit statuses and single lines."""
    try:
        return importlib.import_module(module_of(name)).main(arguments) or 0
    except SystemExit as ended:  # usage error or --help
        return ended.code or 0
    except (Exception, KeyboardInterrupt) as error:
        if _is_interruption(error):
            print(f"{os.linesep if sys.stderr.isatty() else ''}microstage {name}: interrupted", file=sys.stderr)
            return 1
        status = _said(name, error)
        if status is None:
            raise
        return status


def _is_interruption(error):
    """True for Ctrl-C, also where it was raised within compiled code, which makes a SystemError of it."""
    seen = set()
    while error is not None and id(error) not in seen:
        if isinstance(error, KeyboardInterrupt):
            return True
        seen.add(id(error))
        error = error.__cause__ or error.__context__
    return False


def _said(name, error):
    """Say in one line what is wrong with the input or with a file. Returns the exit status; None for other errors."""
    if isinstance(error, InputError):
        says = " ".join(str(error).split())
        answer.state(error={"place": error.place, "value": error.value, "expected": error.expected, "says": says})
        print(says, file=sys.stderr)
        return 2
    if not isinstance(error, OSError) or isinstance(error, BrokenPipeError) or error.errno is None:
        return None
    says = f"microstage {name}: {error.filename or 'input or output'}: {(error.strerror or str(error)).lower()}"
    answer.state(error={"place": str(error.filename), "says": says})
    print(says, file=sys.stderr)
    return 2 if error.errno in BAD_PLACES else 1


BAD_PLACES = (errno.ENOENT, errno.EACCES, errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.EROFS, errno.EPERM)
"""Errors of the system that mean: another place was to be named."""


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
        print(f"microstage: there is no command {arguments[0]!r}{nearest(arguments[0], COMMANDS)} "
              f"(commands: {', '.join(COMMANDS)})", file=sys.stderr)
        return 2
    return run(arguments[0], arguments[1:])


def __getattr__(name):
    """The executable of each command, for ``ros2 run microstage_ros NAME``."""
    if name in COMMANDS:
        return lambda: _end(name, run(name, sys.argv[1:]))
    raise AttributeError(name)


def _end(name, status):
    """End the process. After a cell there is nothing left to do, and to unload all libraries takes a second."""
    if name == "cell":
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


if __name__ == "__main__":
    _end(sys.argv[1] if len(sys.argv) > 1 else "", main())
