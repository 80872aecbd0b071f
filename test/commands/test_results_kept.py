"""Recordings of an earlier run are replaced only with --force, and come back where the new one does not begin."""

import pytest

from microstage_ros.commands.__main__ import main
from microstage_ros.commands.operation.cell import earlier_aside, is_bag

RUN = "controller: {type: pid}\nprogram:\n  - {move_to_m: 1.0e-5, dwell_s: 0.01}\n"


@pytest.fixture
def bag(tmp_path, monkeypatch):
    """A folder ``old/bag`` that looks like a bag, in the current folder."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "old" / "bag"
    folder.mkdir(parents=True)
    (folder / "bag_0.mcap").write_bytes(b"earlier")
    (tmp_path / "run.yaml").write_text(RUN)
    return folder


@pytest.mark.parametrize("words", [["demo", "--out", "old"], ["experiment", "--run", "run.yaml", "--out", "old"],
                                   ["cell", "--record", "old/bag"]], ids=lambda words: words[0])
def test_refused_without_force(bag, capsys, words):
    assert main(words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "exists already" in said and "--force" in said
    assert (bag / "bag_0.mcap").read_bytes() == b"earlier"


def test_force_does_not_replace_what_is_no_bag(bag, capsys):
    (bag / "notes.txt").write_text("mine")
    assert not is_bag(bag) and main(["cell", "--record", str(bag), "--force"]) == 2
    assert "nothing but a bag" in capsys.readouterr().err and (bag / "notes.txt").exists()


def test_earlier_bag_comes_back_unless_the_new_one_begins(bag):
    with pytest.raises(KeyboardInterrupt), earlier_aside(bag):
        assert not bag.exists()
        bag.mkdir()
        (bag / "bag_0.mcap").write_bytes(b"half")
        raise KeyboardInterrupt
    assert (bag / "bag_0.mcap").read_bytes() == b"earlier"
    with earlier_aside(bag) as begun:
        bag.mkdir()
        (bag / "bag_0.mcap").write_bytes(b"new")
        begun()
    assert (bag / "bag_0.mcap").read_bytes() == b"new" and [p.name for p in bag.parent.iterdir()] == ["bag"]
