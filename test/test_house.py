"""How the code is kept: linter, type checker, sizes of files, lines and folders; docstrings have `test_docstrings`."""

import collections
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from microstage_ros.numerics.compiled import cache_folder

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "microstage_ros"
MOST_LINES = 400
MOST_FILES = 15
MOST_COLUMNS = 120


def _our_files():
    """Every file of the package and of its tests."""
    return [*PACKAGE.rglob("*.py"), *(ROOT / "test").rglob("*.py")]


def _tool(name):
    beside = Path(sys.executable).with_name(name)
    found = str(beside) if beside.exists() else shutil.which(name)
    if not found:
        pytest.skip(f"{name} is not installed")
    return found


def test_linter_finds_nothing():
    done = subprocess.run([_tool("ruff"), "check", "--no-cache", "."], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_types_are_right():
    """From nothing the checker takes 12 to 35 s of processor; what has not changed since its last run, in whatever clone, comes from its cache."""
    done = subprocess.run([_tool("mypy"), "--cache-dir", str(Path(cache_folder("ros")).with_name("mypy"))], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_file_is_too_long():
    long = {str(path.relative_to(ROOT)): count for path in _our_files()
            if (count := len(path.read_text(encoding="utf-8").splitlines())) > MOST_LINES}
    assert not long


def test_lines_are_no_longer_than_agreed():
    """Python's by the linter too, which does not read the page's style and script and skips lines with an address."""
    files = [path for path in PACKAGE.rglob("*") if path.suffix in (".py", ".css", ".js", ".html")]
    assert not {f"{path.relative_to(PACKAGE)}:{number}" for path in files
                for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1) if len(line) > MOST_COLUMNS}


def test_no_folder_holds_too_many_files():
    """Counted on one level, without the ``__init__.py`` that makes the folder a package; folders of data and pages too."""
    data = [path for folder in ("config", "docs", "launch", "msg_defs") for path in (ROOT / folder).rglob("*") if path.is_file()]
    every = {*_our_files(), *PACKAGE.rglob("*.c"), *(path for path in data if path.suffix != ".pyc")}
    files = collections.Counter(path.parent.relative_to(ROOT).as_posix() for path in every if path.name != "__init__.py")
    assert not {folder: count for folder, count in files.items() if count > MOST_FILES}
