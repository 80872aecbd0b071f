"""Tables of measured figures in the documentation, each between two comments, stamped, checked against its code.

In a page, the comments being invisible to a reader of the rendered page::

    <!-- compare: Sines, worst peak (nm) -->
    <!-- measured: version=0.1.0 code=4f0c… made=2026-01-31 machine="AMD EPYC, 2 cores, Python 3.12" -->
    | … |
    <!-- end -->

The first word is the command that makes the table. ``code`` is a digest of the source files that the figures are about,
without their comments and docstrings. When it no longer agrees the table is *stale*. A stale table is made anew, or
says so to its reader (`mark_stale` puts `MARK` under it); one that does neither fails the tests.
"""

import ast
import dataclasses
import datetime
import functools
import hashlib
import os
import platform
import re
from pathlib import Path

from microstage_ros import __version__
from microstage_ros.quantities.errors import InputError

MARK = "*Measured with an earlier state of the code; `{command}` measures it anew.*"
OPENING = re.compile(r"^<!-- (?P<owner>figures|compare|robustness): (?P<title>.+?) -->\n", re.MULTILINE)
STAMP = re.compile(
    r'<!-- measured: version=(?P<version>\S+) code=(?P<code>\w+) made=(?P<made>\S+) machine="(?P<machine>[^"]*)" -->\n'
)
END = "<!-- end -->"


@dataclasses.dataclass(frozen=True)
class Stamp:
    """What is known of the measurement of a table.

    Attributes
    ----------
    version : of the package. code : `digest`. made : date, ISO 8601. machine : processor, cores, Python.
    """

    version: str
    code: str
    made: str
    machine: str

    def __str__(self):
        return f'<!-- measured: version={self.version} code={self.code} made={self.made} machine="{self.machine}" -->\n'


UNKNOWN = Stamp("unknown", "0", "unknown", "not recorded")
"""Of a table without a stamp."""


@dataclasses.dataclass(frozen=True)
class Table:
    """One table as it stands in a page.

    Attributes
    ----------
    owner : the command that makes it. title : its name there. stamp : `Stamp`. body : Markdown between the comments.
    start, end : where stamp and body stand in the text of the page.
    """

    owner: str
    title: str
    stamp: Stamp
    body: str
    start: int
    end: int

    def says_that_it_is_stale(self, command: str) -> bool:
        """Whether `MARK` with this command stands under the table."""
        return MARK.format(command=command) in self.body


def _without_docstrings(tree):
    """The tree of a module, without the docstrings of its classes and functions and its own."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            if ast.get_docstring(node, clean=False) is not None:
                node.body = node.body[1:]
    return tree


@functools.cache
def _what_it_does(text: str) -> str:
    """A module's syntax tree without docstrings, as text; tables share most modules."""
    return ast.dump(_without_docstrings(ast.parse(text)))


def digest(root: Path | str, code: tuple) -> str:
    """Digest of Python files below ``root``/microstage_ros: names and what they do (16 hexadecimal digits).

    Comments, docstrings and the way in which lines are broken do not count: they change no figure.

    Parameters
    ----------
    root : of the checkout. code : files and folders of microstage_ros.

    Raises
    ------
    InputError : an entry that is no file or folder of the package.
    """
    total = hashlib.sha256()
    for entry in code:
        path = Path(root) / "microstage_ros" / entry
        if not path.exists():
            raise InputError("figures: code", entry, "a file or folder of microstage_ros")
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            does = _what_it_does(file.read_text(encoding="utf-8"))
            total.update(f"{file.relative_to(root)}\0{does}\0".encode())
    return total.hexdigest()[:16]


def machine() -> str:
    """The machine in a few words: processor, cores, Python."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = re.findall(r"^model name\s*:\s*(.+)$", info.read_text(encoding="utf-8"), re.MULTILINE)
        name = names[0] if names else name
    return f"{name}, {os.cpu_count()} cores, Python {platform.python_version()}".replace('"', "'")


def stamp_now(root: Path | str, code: tuple) -> Stamp:
    """`Stamp` of figures that were measured just now with the code of ``root``."""
    today = datetime.datetime.now(datetime.timezone.utc).date().isoformat()
    return Stamp(__version__, digest(root, code), today, machine())


def read_tables(page: Path | str) -> list[Table]:
    """All `Table` s of a page, in their order. Raises `InputError` where one has no end."""
    text, found = Path(page).read_text(encoding="utf-8"), []
    for opening in OPENING.finditer(text):
        end = text.find(END, opening.end())
        if end < 0:
            raise InputError(f"{page}: <!-- {opening['owner']}: {opening['title']} -->", "no <!-- end -->",
                             "<!-- end --> after the table")
        measured = STAMP.match(text, opening.end())
        stamp = Stamp(**measured.groupdict()) if measured else UNKNOWN
        body = text[measured.end() if measured else opening.end():end]
        found.append(Table(opening["owner"], opening["title"], stamp, body, opening.end(), end))
    return found


def find_table(page: Path | str, owner: str, title: str) -> Table:
    """The `Table` of this owner and title in a page. Raises `InputError` where the page has none."""
    for table in read_tables(page):
        if (table.owner, table.title) == (owner, title):
            return table
    raise InputError(str(page), f"no <!-- {owner}: {title} -->", "the opening comment of the table")


def write_table(page: Path | str, owner: str, title: str, body: str, stamp: Stamp) -> None:
    """Put a table that was just measured into its page. Raises `InputError` where the page has none of this title."""
    _replace(page, find_table(page, owner, title), body, stamp)


def is_stale(root: Path | str, table: Table, code: tuple) -> bool:
    """Whether the code that a `Table` is about has changed since it was measured."""
    return table.stamp.code != digest(root, code)


def mark_stale(root: Path | str, page: Path | str, table: Table, code: tuple, command: str) -> None:
    """Make a stale `Table` say so to its reader; nothing happens to one that is fresh or says so."""
    if is_stale(root, table, code) and not table.says_that_it_is_stale(command):
        body = re.sub(r"\n\*Measured with an earlier state of the code; `[^`]*` measures it anew\.\*\n", "", table.body)
        _replace(page, table, f"{body.rstrip()}\n\n{MARK.format(command=command)}\n", table.stamp)


def _replace(page, table, body, stamp):
    page = Path(page)
    text = page.read_text(encoding="utf-8")
    page.write_text(f"{text[:table.start]}{stamp}{body.strip(chr(10))}\n{text[table.end:]}", encoding="utf-8")
