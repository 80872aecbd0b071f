"""The arrows between the packages (``.importlinter``) and the size of files."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CEILING = 400


def test_rooms_import_only_what_is_below_them():
    linter = Path(sys.executable).with_name("lint-imports")
    if not linter.exists() and not shutil.which("lint-imports"):
        pytest.skip("import-linter is not installed")
    done = subprocess.run([str(linter) if linter.exists() else "lint-imports", "--no-cache"], cwd=ROOT,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_file_is_longer_than_the_ceiling():
    long = {str(path.relative_to(ROOT)): count for path in (ROOT / "microstage_ros").rglob("*.py")
            if (count := len(path.read_text(encoding="utf-8").splitlines())) > CEILING}
    assert not long


def test_every_command_and_node_is_listed_everywhere():
    """The table of commands, the files, the executables of the package."""
    from microstage_ros.commands import COMMANDS
    from microstage_ros.ros.launching.cell_processes import NODES

    setup = (ROOT / "setup.py").read_text(encoding="utf-8")
    for name in COMMANDS:
        assert f'"{name}"' in setup, name
    for name in NODES:
        assert f'"{name}"' in setup, name
        assert (ROOT / "microstage_ros" / "ros" / "nodes" / f"{name}.py").exists()
        assert (ROOT / "config" / f"{name}.yaml").exists()
