"""``mutation``: do the tests notice when the code is wrong? Small faults are put in one by one, with cosmic-ray.

Each mutant changes one place of one file: an operator, a comparison, a number, a condition, a loop that does not run.
The tests of that part are run on it; a mutant on which they all pass has survived. Runs in copies of the checkout.
"""

import contextlib
import ctypes
import json
import multiprocessing
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time

from rich.console import Console
from rich.progress import track

from microstage_ros import __version__
from microstage_ros.commands.parser import Parser
from microstage_ros.metrology.rates import rate
from microstage_ros.places import SOURCE
from microstage_ros.quantities.errors import InputError

NO_SIMULATION = "judge judge_margins judge_scales selection_rules asked_again what_is_kept agreement own_shapes"
BY_HAND = (
    *(f"test/diagnosis/selection/test_{name}.py" for name in NO_SIMULATION.split()),
    "test/diagnosis/selection/rules",
)
AREAS = {
    "hardware": (["microstage_ros/hardware"], ["test/hardware"]),
    "judge": (["microstage_ros/diagnosis/selection/judge*.py"], [*BY_HAND, "test/diagnosis"]),
    "selection": (
        ["microstage_ros/diagnosis/selection"],
        [*BY_HAND, "test/diagnosis/selection/test_calibration.py", "test/diagnosis"],
    ),
    "diagnosis": (["microstage_ros/diagnosis"], ["test/diagnosis"]),
    "control": (["microstage_ros/control"], ["test/control"]),
    "records": (["microstage_ros/records"], ["test/records"]),
    "ros": (["microstage_ros/ros"], ["test/ros"]),
}
"""Part of the project to (what is mutated, the tests that should notice: the quick ones first, the first failure ends a
run)."""
OPERATORS = (
    "ReplaceBinaryOperator_Add_Sub",
    "ReplaceBinaryOperator_Sub_Add",
    "ReplaceBinaryOperator_Mul_Div",
    "ReplaceBinaryOperator_Div_Mul",
    "ReplaceBinaryOperator_Pow_Mul",
    "ReplaceBinaryOperator_FloorDiv_Mul",
    "ReplaceBinaryOperator_Mod_Mul",
    "ReplaceComparisonOperator_Eq_NotEq",
    "ReplaceComparisonOperator_NotEq_Eq",
    "ReplaceComparisonOperator_Lt_GtE",
    "ReplaceComparisonOperator_LtE_Gt",
    "ReplaceComparisonOperator_Gt_LtE",
    "ReplaceComparisonOperator_GtE_Lt",
    "ReplaceComparisonOperator_Is_IsNot",
    "ReplaceComparisonOperator_IsNot_Is",
    "ReplaceUnaryOperator_USub_UAdd",
    "ReplaceUnaryOperator_Delete_Not",
    "AddNot",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "ExceptionReplacer",
    "NumberReplacer",
    "ZeroIterationForLoop",
)
"""Faults that a person might make; what only ever raises a TypeError (``+`` to ``|``) would flatter the rate."""
PR_SET_PDEATHSIG = 1  # of prctl(2): the signal that a process gets when its parent ends
WITH_ITS_PARENT = f"""\
import ctypes, runpy, signal, sys
ctypes.CDLL(None).prctl({PR_SET_PDEATHSIG}, signal.SIGKILL)
del sys.argv[0]
runpy.run_module("pytest", run_name="__main__", alter_sys=True)
"""
LONGEST = 3600.0  # s, of the unchanged tests
SLOWEST = 5.0  # times the unchanged tests' time, after which a mutant counts as noticed (it hangs)


def main(argv=None):
    """Run the command. Returns 0; raises InputError for bad input."""
    parser = Parser(prog="microstage mutation", description=__doc__.split("\n\n")[1].replace("\n", " "))
    parser.add_argument("area", metavar="PART", help="one of " + ", ".join(AREAS) + ", or a file of the package")
    parser.add_argument(
        "--tests", nargs="+", metavar="PATH", help="the tests that should notice (default: those of the part)"
    )
    parser.add_argument("--sample", type=int, metavar="N", help="only so many mutants, drawn at random (default all)")
    parser.add_argument("--seed", type=int, default=1, help="of the draw (default 1)")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="copies that work side by side (default 1)")
    parser.add_argument("--json", metavar="FILE", help="write every mutant and what became of it")
    arguments = parser.parse_args(argv)
    modules, tests = _targets(arguments.area, arguments.tests)
    items = _items(modules)
    drawn = (
        items
        if arguments.sample is None
        else random.Random(arguments.seed).sample(items, min(max(arguments.sample, 0), len(items)))
    )
    outcomes = _examine(drawn, tests, arguments.jobs)
    _report(outcomes, len(items), arguments, tests)
    return 0


def _targets(area, tests):
    """([module paths relative to the checkout], [tests]) of a part or a file."""
    if area in AREAS:
        patterns, usual = AREAS[area]
    elif (SOURCE / area).is_file() and area.startswith("microstage_ros/"):
        patterns, usual = [area], None
    else:
        raise InputError(
            "mutation: PART",
            area,
            "one of " + ", ".join(AREAS) + ", or a file such as microstage_ros/hardware/command_gate.py",
        )
    tests = tests or usual
    if not tests:
        raise InputError("mutation: --tests", None, "the tests that should notice, for instance --tests test/hardware")
    for path in tests:
        if not (SOURCE / path.split("::")[0]).exists():
            raise InputError("mutation: --tests", path, "a test file or folder of this checkout")
    found = []
    for pattern in patterns:
        for path in sorted(SOURCE.glob(pattern)):
            found += sorted(path.rglob("*.py")) if path.is_dir() else [path]
    return [
        str(path.relative_to(SOURCE)) for path in found if path.name != "__init__.py" or path.stat().st_size > 500
    ], tests


def _items(modules):
    """Every mutation of these modules, as plain tuples (module, operator, occurrence, line)."""
    try:
        from cosmic_ray.commands.init import init
        from cosmic_ray.work_db import WorkDB, use_db
    except ImportError:
        raise InputError(
            "mutation", "cosmic-ray is not installed", "pip install cosmic-ray in this environment"
        ) from None
    with (
        tempfile.TemporaryDirectory() as folder,
        use_db(os.path.join(folder, "items.sqlite"), mode=WorkDB.Mode.create) as database,
    ):
        before = os.getcwd()
        os.chdir(SOURCE)
        try:
            init([pathlib.Path(module) for module in modules], database, {})
        finally:
            os.chdir(before)
        found = [item.mutations[0] for item in database.work_items]
    usual = {f"core/{name}" for name in OPERATORS}
    return sorted(
        (str(m.module_path), m.operator_name, m.occurrence, m.start_pos[0]) for m in found if m.operator_name in usual
    )


def _examine(items, tests, jobs):
    """[(item, outcome, diff)] of every mutant, on ``jobs`` copies of the checkout."""
    with tempfile.TemporaryDirectory(prefix="microstage-mutation-") as folder:
        fresh = multiprocessing.get_context("spawn")  # a fork of many threads may inherit a lock that nobody opens
        copies = fresh.Manager().Queue()
        for number in range(max(jobs, 1)):
            copies.put(_copy(pathlib.Path(folder) / str(number)))
        slow = SLOWEST * _unchanged(folder, tests) + 5.0
        work = [(copies, item, tests, slow) for item in items]
        with fresh.Pool(max(jobs, 1), _ends_with, (os.getpid(),)) as pool:
            bar = Console(stderr=True, quiet=not sys.stderr.isatty())
            found = list(track(pool.imap(_one, work), "mutants", total=len(items), console=bar))
            pool.close()  # the workers end by themselves: a signal at their end may find them waiting for ever
            pool.join()
            return found


def _copy(folder):
    """A copy of the files that git knows or does not ignore, as they are in the working tree, and the folder's path as
    text."""
    names = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=SOURCE,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split("\n")
    for name in filter(None, names):
        if (SOURCE / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(SOURCE / name, folder / name)
    if (SOURCE.parent / "shared").exists() and not (folder.parent / "shared").exists():
        (folder.parent / "shared").symlink_to(SOURCE.parent / "shared")  # measured data that some tests look for
    return str(folder)


def _command(folder, tests):
    """The test command of a copy, and its environment."""
    paths = [
        folder,
        *(p for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p and pathlib.Path(p) != SOURCE),
    ]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(paths),
        "MICROSTAGE_ROOT": folder,
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    arguments = ["pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    return [sys.executable, "-c", WITH_ITS_PARENT, *arguments], environment


def _leave(number, frame):
    """Exit by way of every ``finally``. A parent with threads sends its signal again as each of them ends: a second one
    would cut off what is cleaned up."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sys.exit(1)


def _ends_with(parent):
    """In a worker: when its parent ends, however it does, so does the worker, and with it what it runs."""
    signal.signal(signal.SIGTERM, _leave)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:  # it ended before
        sys.exit(1)


def _run(copy, tests, slow=None):
    """(exit status, output) of the tests in a copy; (None, "") after ``slow`` seconds. What they started ends with
    them."""
    command, environment = _command(copy, tests)
    process = subprocess.Popen(
        command,
        cwd=copy,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        output = process.communicate(timeout=slow)[0]
        return process.returncode, output
    except subprocess.TimeoutExpired:
        return None, ""
    finally:
        with contextlib.suppress(ProcessLookupError):  # a mutant may fork what never ends
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _unchanged(folder, tests):
    """Time of the tests on the unchanged code [s]; InputError if they fail."""
    copy = str(pathlib.Path(folder) / "0")
    for _ in range(2):  # the first run fills the cache of compiled code
        began = time.monotonic()
        status, output = _run(copy, tests, LONGEST)
        if status is None:
            raise InputError("mutation: --tests", " ".join(tests), f"tests that end within {LONGEST:.0f} s")
        if status:
            raise InputError(
                "mutation: --tests", " ".join(tests), "tests that pass on the unchanged code: " + output[-300:]
            )
    return time.monotonic() - began


def _one(work):
    """(item, outcome, diff) of one mutant in a copy that is free."""
    from cosmic_ray.mutating import use_mutation
    from cosmic_ray.plugins import get_operator

    copies, item, tests, slow = work
    copy = copies.get()
    try:
        path = pathlib.Path(copy) / item[0]
        with use_mutation(path, get_operator(item[1])(), item[2]) as (before, after):
            if after is None:
                return item, "no mutant", ""
            changed = [line for line in after.splitlines() if line not in set(before.splitlines())]
            status = _run(copy, tests, slow)[0]
            outcome = "survived" if status == 0 else "timed out" if status is None else "noticed"
        return item, outcome, " / ".join(line.strip() for line in changed[:2])
    finally:
        copies.put(copy)


def _report(outcomes, total, arguments, tests):
    """Survivors and the rate on standard output; everything as JSON if asked."""
    judged = [entry for entry in outcomes if entry[1] in ("survived", "noticed")]
    late = sum(entry[1] == "timed out" for entry in outcomes)
    survivors = [entry for entry in judged if entry[1] == "survived"]
    for (module, operator, _, line), _, change in survivors:
        print(f"survived  {module}:{line}  {operator.split('/')[1]}  {change}")
    found = rate(len(judged) - len(survivors), len(judged))
    print(
        f"{arguments.area}: the tests notice {found} of the mutants tried; {total} there are; tests: {' '.join(tests)}"
        + (f"; {late} did not end in time and do not count" if late else "")
    )
    if arguments.json:
        rows = [
            {"file": i[0], "operator": i[1], "occurrence": i[2], "line": i[3], "outcome": o, "change": d}
            for i, o, d in outcomes
        ]
        pathlib.Path(arguments.json).write_text(
            json.dumps(
                {
                    "format": 1,
                    "version": __version__,
                    "seed": arguments.seed,
                    "part": arguments.area,
                    "tests": tests,
                    "mutants": total,
                    "tried": found.cases,
                    "timed_out": late,
                    "noticed": found.hits,
                    "ci95": [found.low, found.high],
                    "rows": rows,
                },
                indent=1,
            ),
            encoding="utf-8",
        )
