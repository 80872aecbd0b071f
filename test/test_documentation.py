"""The documentation builds as a site without a warning: links, docstrings, the API reference of every module."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.skipif(not importlib.util.find_spec("mkdocs"), reason="mkdocs is not installed")
def test_documentation_builds_without_a_warning(tmp_path):
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT,
        env={**os.environ, "DISABLE_MKDOCS_2_WARNING": "true"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, "\n".join(
        line for line in built.stderr.splitlines() if "WARNING" in line or "ERROR" in line
    )
    pages = {
        path.parent.relative_to(tmp_path / "site" / "api").as_posix()
        for path in (tmp_path / "site" / "api").rglob("index.html")
    }
    assert {
        "microstage_ros/model/axis_file",
        "microstage_ros/control/laws/pid",
        "microstage_ros/records/record",
    } <= pages
