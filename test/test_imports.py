"""The arrows between the packages (``.importlinter``)."""

import ast
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


def _names(module):
    """Names that a module binds anywhere."""
    found = set()
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found.add(node.name)
        elif isinstance(node, ast.Name):
            found.add(node.id)
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            found |= {(alias.asname or alias.name).split(".")[0] for alias in node.names}
    return found


def test_every_import_inside_a_function_finds_its_module_and_name():
    """A module that moved is missed by those who import it late, and only when they do."""
    wrong, known = [], {}
    for folder in ("microstage_ros", "test", "launch", "docs"):
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if not (isinstance(node, ast.ImportFrom) and (node.module or "").startswith("microstage_ros")):
                    continue
                place = ROOT / node.module.replace(".", "/")
                module = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
                if module not in known:
                    known[module] = _names(module) if module.exists() else set()
                for alias in node.names:
                    there = alias.name in known[module] or (place / alias.name).is_dir() or (place / f"{alias.name}.py").exists()
                    wrong += [] if there else [f"{path.relative_to(ROOT)}:{node.lineno}: {node.module}.{alias.name}"]
    assert not wrong


def _executables():
    """Names of the executables that setup.py declares."""
    asked = ("import setuptools; setuptools.setup = lambda **facts: print(*(line.split(' = ')[0] for line in facts['entry_points']['console_scripts'])); "
             "import runpy; runpy.run_path('setup.py')")
    return subprocess.run([sys.executable, "-c", asked], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()


def test_every_command_and_node_is_listed_everywhere():
    """The table of commands, the files, the executables of the package."""
    from microstage_ros.commands import COMMANDS, module_of
    from microstage_ros.ros.launching.cell_processes import BYSTANDERS, NODES

    made = _executables()
    assert set(made) == {*COMMANDS, *NODES, *BYSTANDERS}
    for name in COMMANDS:
        assert (ROOT / (module_of(name).replace(".", "/") + ".py")).exists(), name
    for name in (*NODES, *BYSTANDERS):
        assert (ROOT / "microstage_ros" / "ros" / "nodes" / f"{name}.py").exists()
        assert (ROOT / "config" / f"{name}.yaml").exists()
