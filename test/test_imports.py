"""The arrows between the packages (``.importlinter``)."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def test_packages_import_only_what_is_below_them():
    linter = Path(sys.executable).with_name("lint-imports")
    if not linter.exists() and not shutil.which("lint-imports"):
        pytest.skip("import-linter is not installed")
    done = subprocess.run([str(linter) if linter.exists() else "lint-imports", "--no-cache"], cwd=ROOT,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


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
