"""Files of results: written beside and renamed when complete, never replaced unasked; files that are missing.

    with complete_file("run.csv", "wb") as file:      # Ctrl-C in here leaves no run.csv, and an old one as it was
        file.write(rows)
    with complete_folder("answer") as folder:         # the same for several files of one answer
        (folder / "report.json").write_text(text)

Every error is an `InputError` of one line.
"""

import difflib
import errno
import os
import shutil
from contextlib import contextmanager
from pathlib import Path

from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.yaml_text import yaml_tree

PARTIAL = ".partial"
"""End of the name of what is not complete yet."""


class FileProblem(InputError):
    """A file or folder that cannot be used, in the words of a file manager: ``run.csv: file not found; expected …``."""

    def __init__(self, place, problem, expected):
        super().__init__(place, problem, expected)
        self.args = (f"{place}: {problem}; expected {expected}",)

    def __reduce__(self):
        """Pickled as it was made."""
        return FileProblem, (self.place, self.value, self.expected)


def unreadable(path, error, expected):
    """The error for a file that could not be opened.

    Parameters
    ----------
    path : as the user gave it. error : the `OSError`. expected : what would be right, such as "an axis file".

    Returns
    -------
    FileProblem : "file not found" with the nearest name in that folder, or the system's reason.
    """
    if error.errno not in (errno.ENOENT, errno.ENOTDIR):
        return FileProblem(path, (error.strerror or str(error)).lower(), expected)
    return missing(path, expected)


def read_yaml(path, expected):
    """Plain data of a YAML file (`quantities.yaml_text`).

    Parameters
    ----------
    path : of the file. expected : what it should be, such as "an axis file".

    Raises
    ------
    FileProblem : it cannot be read. InputError : it is no YAML.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise unreadable(path, error, expected) from None
    except UnicodeDecodeError as error:
        raise InputError(str(path), " ".join(str(error).split())[:160], "valid YAML") from None
    return yaml_tree(text, str(path))


def missing(path, expected):
    """The error for a file that is not there, with the nearest name in its folder."""
    path = Path(path)
    if not path.parent.is_dir():
        return FileProblem(path, f"file not found (there is no folder {path.parent})", expected)
    try:
        near = difflib.get_close_matches(path.name, os.listdir(path.parent), 1, 0.7)
    except OSError:
        near = []
    return FileProblem(path, "file not found", expected + (f"; did you mean {path.parent / near[0]}?" if near else ""))


def unwritable(path, error):
    """The error for a file that could not be written."""
    return FileProblem(path, (error.strerror or str(error)).lower(), "a place that can be written")


def keep_earlier(option, paths, force=False):
    """Refuse to replace results that are there already, and places that no file can be written to, before any work.

    Parameters
    ----------
    option : that named them, for the message. paths : files that would be written. force : replace them.

    Raises
    ------
    InputError : one of them exists and ``force`` is not set, or its folder cannot be made or written.
    """
    for path in paths:
        place = Path(path).absolute().parent
        while not os.path.lexists(place):
            place = place.parent
        if not place.is_dir():
            raise FileProblem(f"{option} {place}", "not a directory", "a place that can be written")
        if not os.access(place, os.W_OK | os.X_OK):
            raise FileProblem(f"{option} {place}", "permission denied", "a place that can be written")
        if not force and Path(path).exists():
            raise FileProblem(f"{option} {path}", "exists already", "a new name, or --force to replace it")


@contextmanager
def complete_file(path, mode="w"):
    """A file to write that gets its name only when it is complete.

    Parameters
    ----------
    path : its name; the folder is made if need be. mode : "w" (UTF-8) or "wb".

    Raises
    ------
    FileProblem : the place cannot be written. Whatever is raised inside passes through; nothing is left behind then.
    """
    path = Path(path)
    beside = path.with_name(f".{path.name}.{os.getpid()}{PARTIAL}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a folder")
        file = open(beside, mode, encoding=None if "b" in mode else "utf-8")
    except OSError as error:
        raise unwritable(path, error) from None
    try:
        with file:
            yield file
        os.replace(beside, path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


@contextmanager
def complete_folder(folder):
    """A folder to write into whose files come to ``folder`` only when all are complete. What else lies there stays.

    Raises
    ------
    FileProblem : the place cannot be written. Whatever is raised inside passes through; nothing is left behind then.
    """
    folder = Path(folder)
    beside, made = folder / f".{os.getpid()}{PARTIAL}", not folder.exists()
    try:
        beside.mkdir(parents=True)
    except OSError as error:
        raise unwritable(folder, error) from None
    try:
        yield beside
        for entry in sorted(beside.iterdir()):
            if (folder / entry.name).is_dir() and entry.is_dir():
                shutil.rmtree(folder / entry.name)
            os.replace(entry, folder / entry.name)
        beside.rmdir()
    except BaseException:
        shutil.rmtree(beside, ignore_errors=True)
        if made:
            _remove_empty(folder)
        raise


def _remove_empty(folder):
    """Remove a folder that this run made, if nothing lies in it."""
    try:
        folder.rmdir()
    except OSError:
        pass


def write_text(path, text):
    """Write a text file that gets its name only when it is complete. Raises `FileProblem`."""
    with complete_file(path) as file:
        file.write(text)
