"""The command prints the table, and its Markdown is the page in docs."""

import pathlib
import re

import pytest

from microstage_ros.commands.analysis import laws
from microstage_ros.model.friction.properties.table import measure

PAGE = pathlib.Path(__file__).resolve().parents[2] / "docs" / "evidence" / "friction_laws.md"


NUMBER = re.compile(r"-?\d+\.\d+(?= %)")


@pytest.fixture(scope="module")
def table():
    return measure()


@pytest.fixture(autouse=True)
def measured_once(monkeypatch, table):
    monkeypatch.setattr(laws, "measure", lambda progress: table)


def test_the_page_in_docs_is_what_the_command_writes(capsys):
    """Word for word; the measured numbers may differ in their last digit from machine to machine."""
    assert laws.main(["--markdown"]) == 0
    written, page = capsys.readouterr().out, PAGE.read_text(encoding="utf-8")
    assert NUMBER.sub("#", written) == NUMBER.sub("#", page)
    numbers = [[float(number) for number in NUMBER.findall(text)] for text in (written, page)]
    assert numbers[0] == pytest.approx(numbers[1], rel=0.02, abs=0.02)


def test_the_table_is_plain_text_in_a_pipe(capsys):
    assert laws.main([]) == 0
    out = capsys.readouterr().out
    assert "\x1b" not in out
    assert max(map(len, out.splitlines())) <= 160
    for words in ("Stribeck curve", "LuGre", "GMS", "DISAGREES", "stick-slip"):
        assert words in out


def test_an_unknown_option_ends_with_status_2(capsys):
    with pytest.raises(SystemExit) as end:
        laws.main(["--colour"])
    assert end.value.code == 2
    assert "--colour" in capsys.readouterr().err
