"""Every code block of README and docs: YAML reads, Python compiles, command lines have the options they name; the tutorial's analysis runs.

A command line that starts nodes or takes minutes is read by its command's own parser, in place of being run.
"""

import importlib
import itertools
import re
import shlex
import subprocess
from pathlib import Path

import pytest
import yaml

from microstage_ros.commands import COMMANDS, module_of
from microstage_ros.commands.__main__ import main
from microstage_ros.commands.parser import parser_of

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
PASSED_ON = ("test", "shell")
"""Commands that pass their words on to another program."""


def blocks(page, kind):
    """Texts of the fenced blocks of one kind in a page, without their indentation."""
    found = re.findall(rf"^([ ]*)```{kind}[^\n]*\n(.*?)^\1```", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return [re.sub(rf"^{indent}", "", text, flags=re.M) for indent, text in found]


def command_lines(page):
    """Words of every ``./microstage`` line in the shell blocks of a page."""
    lines = [line for text in blocks(page, "sh") for line in text.replace("\\\n", " ").splitlines()]
    words = [shlex.split(line, comments=True) for line in lines if line.strip().startswith("./microstage")]
    return [list(itertools.takewhile(lambda word: word not in (">", "&"), line[1:])) for line in words]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_blocks_are_what_they_say(page):
    for text in blocks(page, "python"):
        compile(text, page.name, "exec")
    for text in blocks(page, "yaml"):
        assert yaml.safe_load(text) is not None
    for text in blocks(page, "sh"):
        subprocess.run(["bash", "-n", "-c", text], check=True)


@pytest.mark.parametrize("page", [page for page in PAGES if command_lines(page)], ids=lambda page: page.name)
def test_command_lines_name_options_that_there_are(page):
    for name, *words in command_lines(page):
        if name in ("--help", "--version") or name in PASSED_ON:
            continue
        assert name in COMMANDS, name
        parser = parser_of(importlib.import_module(module_of(name)).main, words)
        parser.parse_args([word for word in words if word != "…"])


def test_the_tutorials_records_are_made_as_printed(tmp_path, monkeypatch):
    """Its run file and the first of its simulations; README's run file too."""
    (tmp_path / "config").symlink_to(ROOT / "config")
    monkeypatch.chdir(tmp_path)
    lines = [words for words in command_lines(ROOT / "docs" / "tutorial.md") if words[0] == "simulate"]
    assert len(lines) == 3
    (tmp_path / "run.yaml").write_text(blocks(ROOT / "docs" / "tutorial.md", "yaml")[0], encoding="utf-8")
    assert main(lines[0]) == 0 and (tmp_path / "one.csv").exists()
    (tmp_path / "run.yaml").write_text(blocks(ROOT / "README.md", "yaml")[0], encoding="utf-8")
    first = next(words for words in command_lines(ROOT / "README.md") if words[0] == "simulate")
    assert main(first) == 0 and (tmp_path / "run.csv").exists()


def test_readmes_backend_is_a_backend():
    from microstage_ros.hardware.protocol import Setup

    names = {}
    exec(next(text for text in blocks(ROOT / "README.md", "python") if "class Card" in text), names)
    card = names["Card"](Setup(None, 0, {}))
    assert card.read().encoder == 0.0 and card.simulated is False
