"""Results appear complete or not at all; earlier ones stay unless --force is given."""

import pickle

import pytest

from microstage_ros.files import (
    complete_file,
    complete_folder,
    keep_earlier,
    missing,
    unreadable,
    write_text,
)
from microstage_ros.quantities.errors import InputError


def test_an_interrupted_file_leaves_the_old_one(tmp_path):
    path = tmp_path / "run.csv"
    write_text(path, "old")
    with pytest.raises(KeyboardInterrupt), complete_file(path) as file:
        file.write("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_an_interrupted_folder_leaves_nothing(tmp_path):
    answer = tmp_path / "answer"
    with pytest.raises(KeyboardInterrupt), complete_folder(answer) as folder:
        (folder / "report.json").write_text("half")
        raise KeyboardInterrupt
    assert not answer.exists()


def test_a_folder_keeps_what_else_lies_there(tmp_path):
    (tmp_path / "rec.csv").write_text("mine")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "old").write_text("old")
    with complete_folder(tmp_path) as folder:
        (folder / "bag").mkdir()
        (folder / "bag" / "new").write_text("new")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["bag", "new", "rec.csv"]


def test_earlier_results_are_kept(tmp_path):
    write_text(tmp_path / "a.csv", "x")
    with pytest.raises(InputError, match="--out .*exists already; expected .*--force"):
        keep_earlier("--out", [tmp_path / "a.csv"])
    keep_earlier("--out", [tmp_path / "a.csv"], force=True)
    keep_earlier("--out", [tmp_path / "b.csv"])


def test_file_not_found_in_those_words(tmp_path):
    write_text(tmp_path / "axis.yaml", "")
    error = missing(tmp_path / "axs.yaml", "an axis file")
    assert "axs.yaml: file not found; expected an axis file; did you mean" in str(error) and "axis.yaml?" in str(error)
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    assert "there is no folder" in str(missing(tmp_path / "none" / "x", "a file"))
    assert "is a directory" in str(unreadable(tmp_path, IsADirectoryError(21, "Is a directory"), "a file"))


def test_a_place_that_cannot_be_written_is_said(tmp_path):
    write_text(tmp_path / "file", "")
    with pytest.raises(InputError, match="file"), complete_file(tmp_path / "file" / "below.csv"):
        pass
    with pytest.raises(InputError, match="is a folder"), complete_file(tmp_path):
        pass
    with pytest.raises(InputError), complete_folder(tmp_path / "file"):
        pass
