"""``test``: all the tests, with pytest; its options are passed on."""

import importlib.util
import os
import subprocess
import sys

from microstage_ros.commands.__main__ import which_ros
from microstage_ros.commands.project import environment
from microstage_ros.places import SOURCE
from microstage_ros.quantities.errors import InputError

USAGE = """usage: microstage test [options of pytest]

All the tests, two at a time. Examples: microstage test test/ros   microstage test -k lockstep -n 0
"""


def main(argv=None):
    """Run the command. Returns pytest's exit status."""
    arguments = list(argv or [])
    if arguments and arguments[0] in ("-h", "--help"):
        print(USAGE)
        return 0
    if not (SOURCE / "test").is_dir():
        raise InputError("microstage test", str(SOURCE), "a checkout with its folder test/")
    print(which_ros(), file=sys.stderr, flush=True)
    try:
        environment.add_test_tools(SOURCE)
    except environment.Failure as failure:
        print(f"microstage: {failure}", file=sys.stderr)
        return 1
    options = arguments
    if importlib.util.find_spec("xdist") and not any(option.startswith("-n") for option in arguments):
        options = ["-n", "2", "--dist", "loadfile", *arguments]
    variables = {**os.environ, "NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    return subprocess.call([sys.executable, "-m", "pytest", *options], cwd=SOURCE, env=variables)
