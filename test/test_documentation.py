"""The documentation builds as a site without a warning: links, docstrings, the API reference of every module."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
MOST_SENTENCES = 3
PLACEHOLDER = r"NAME|DIR|\*|<|…"
FOLDERS = ("config/", "docs/", "test/", "launch/", "msg_defs/", "microstage_ros/")


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


def _page(path):
    return path.relative_to(ROOT).as_posix()


def first_paragraph(text):
    """The first paragraph below the title, as one line."""
    blocks = re.sub(r"```.*?```", "", text, flags=re.DOTALL).split("\n\n")
    return next(" ".join(block.split()) for block in blocks if block.strip() and not block.lstrip().startswith("#"))


@pytest.mark.parametrize("path", PAGES, ids=_page)
def test_a_page_begins_with_what_it_is_for_in_three_sentences(path):
    first = first_paragraph(path.read_text(encoding="utf-8"))
    sentences = [part for part in re.split(r"(?<=[.!?])\s+(?=[A-Z`\[*])", first) if part]
    assert len(sentences) <= MOST_SENTENCES, first


@pytest.mark.parametrize("path", PAGES, ids=_page)
def test_a_page_names_only_files_that_are_there(path):
    """Every module (`x/y.py`), every path that begins with a folder of the repository, and every relative link."""
    text = path.read_text(encoding="utf-8")
    modules = [file.relative_to(ROOT).as_posix() for folder in ("microstage_ros", "test", "launch", "docs")
               for file in (ROOT / folder).rglob("*.py")] + ["setup.py"]
    missing = []
    for name in re.findall(r"`([\w./*<>…-]+)`", text):
        if re.search(PLACEHOLDER, name):
            continue
        if name.endswith(".py"):
            missing += [name] if not any(f"/{module}".endswith(f"/{name}") for module in modules) else []
        elif name.startswith(FOLDERS):
            missing += [name] if not (ROOT / name).exists() else []
    for link in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", text):
        missing += [link] if not (path.parent / link).exists() else []
    assert not missing
