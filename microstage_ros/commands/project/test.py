"""``test``: all the tests, with pytest; its options are passed on."""

import importlib.util
import os
import subprocess
import sys

from microstage_ros.commands.__main__ import which_ros
from microstage_ros.commands.project import environment
from microstage_ros.numerics.compiled import cache_folder
from microstage_ros.places import SOURCE
from microstage_ros.quantities.errors import InputError

USAGE = """usage: microstage test [--all] [--last-bits] [--seeds K] [options of pytest]

The tests that a commit has to pass, two at a time on two processors, else three. Examples:
microstage test --all   microstage test test/ros   microstage test -k lockstep -n 0

  --all        also the long ones of test/commit_set.py, which any other choice of tests includes
  --last-bits  simulated machines begin with last bits that differ (by 10^-15), as on another processor
  --seeds K    every noise of simulated machines from the K-th other set of seeds, K = 1, 2, ...
"""


COMPILED_FIRST = ("ros.nodes.axis_driver:warm_up", "ros.nodes.str_controller:warm_up",
                  "commands.project.compile_ahead:other_law")
"""Functions of this package that load compiled code of many tests."""


def main(argv=None):
    """Run the command. Returns pytest's exit status.

    Raises InputError: there is no folder test/ (an installed package).
    """
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
    arguments = _commit_set(arguments) + arguments
    variables = _other_trajectories(arguments)
    options = arguments
    # Tests of one file may share a cell, so a file stays with one worker. A cell computes as long as its test waits,
    # which takes longer with a third worker on two processors.
    if importlib.util.find_spec("xdist"):
        workers = "3" if (os.cpu_count() or 1) > 2 else "2"
        options = ["-n", workers, "--dist", "loadfile", "--no-loadscope-reorder", *arguments]
    variables = {**os.environ, **variables}
    variables |= {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    if not argv and not os.path.isdir(cache_folder("ros")):
        _compile_first(variables)
    return subprocess.call([sys.executable, "-m", "pytest", *options], cwd=SOURCE, env=variables)


def _compile_first(variables):
    """Compile for `COMPILED_FIRST`, a process each: where nothing is compiled yet, workers that begin together would
    each compile the same."""
    code = "from microstage_ros.{} import {name}; {name}()"
    processes = []
    for module, name in (place.split(":") for place in COMPILED_FIRST):
        if not module.startswith("ros.") or importlib.util.find_spec("rclpy"):
            command = [sys.executable, "-c", code.format(module, name=name)]
            processes.append(subprocess.Popen(command, cwd=SOURCE, env=variables))
    for process in processes:
        process.wait()


def _commit_set(arguments):
    """Options that put in `test/commit_set.py` where no test is chosen; ``--all`` is taken out of ``arguments``.

    An option and no variable: tests that run pytest themselves would inherit it.
    """
    chosen = bool({"--all", "-k", "-m", "--seeds", "--last-bits"} & set(arguments))
    chosen = chosen or any(os.path.exists(SOURCE / place.partition("::")[0]) for place in arguments)
    if "--all" in arguments:
        arguments.remove("--all")
    return [] if chosen else ["-p", "test.commit_set"]


def _other_trajectories(arguments):
    """Environment of `test/last_bits.py`; its options are taken out of ``arguments``, and its plugin put in."""
    variables = {}
    if "--last-bits" in arguments:
        arguments.remove("--last-bits")
        variables["MICROSTAGE_LAST_BITS"] = "1"
    if "--seeds" in arguments:
        at = arguments.index("--seeds")
        number = arguments[at + 1] if at + 1 < len(arguments) else ""
        if not number.isdecimal():
            raise InputError("microstage test --seeds", number, "a whole number")
        del arguments[at:at + 2]
        variables["MICROSTAGE_SEEDS"] = number
    if variables:
        arguments += ["-p", "test.last_bits"]
    return variables
