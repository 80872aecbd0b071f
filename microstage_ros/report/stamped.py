"""Tables of measured figures in the documentation: made by a function, stamped, and checked against the code they are
about.

In a page such a table stands between two comments that a reader of the rendered page does not see::

    <!-- figures: emps version=0.1.0 code=4f0c… made=2026-01-31 machine="AMD EPYC, 2 cores, Python 3.12" -->
    | … |
    <!-- end of figures: emps -->

``code`` is a digest of the source files that the figures are about. When these change, the digest no longer agrees: the
table is *stale*. A stale table is made anew (``./microstage figures NAME``), or says so to its reader
(``./microstage figures --mark NAME`` puts `MARK` under it); one that does neither fails the tests.
"""

import dataclasses
import datetime
import hashlib
import importlib
import os
import platform
import re
from pathlib import Path

from microstage_ros import __version__
from microstage_ros.quantities.errors import InputError

MARK = "*These figures were measured with an earlier state of the code; `./microstage figures {name}` makes them anew.*"
OPENING = re.compile(
    r"<!-- figures: (?P<name>[\w-]+) version=(?P<version>\S+) code=(?P<code>\w+) made=(?P<made>\S+)"
    r' machine="(?P<machine>[^"]*)" -->\n'
)


@dataclasses.dataclass(frozen=True)
class Table:
    """One stamped table.

    Attributes
    ----------
    name : its name in the page and on the command line.
    page : file of the page, relative to the checkout.
    maker : ``package.module:function``; called without arguments, returns the Markdown that stands between the
        comments.
    code : files and folders of ``microstage_ros`` that the figures are about.
    minutes : about how long it takes on one idle core.
    """

    name: str
    page: str
    maker: str
    code: tuple
    minutes: float = 1.0

    def make(self):
        """The Markdown text of the table, measured now."""
        module, _, function = self.maker.partition(":")
        return getattr(importlib.import_module(module), function)()


@dataclasses.dataclass(frozen=True)
class Stamp:
    """What the opening comment of a table says, and whether the table tells its reader that it is stale."""

    version: str
    code: str
    made: str
    machine: str
    marked: bool


def digest(root, code):
    """Digest of Python files below ``root``/microstage_ros: names and contents, in order (16 hexadecimal digits).

    Raises InputError: an entry that is no file or folder of the package.
    """
    total = hashlib.sha256()
    for entry in code:
        path = Path(root) / "microstage_ros" / entry
        if not path.exists():
            raise InputError("figures: code", entry, "a file or folder of microstage_ros")
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            total.update(str(file.relative_to(root)).encode() + b"\0" + file.read_bytes() + b"\0")
    return total.hexdigest()[:16]


def machine():
    """The machine in a few words: processor, cores, Python."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = re.findall(r"^model name\s*:\s*(.+)$", info.read_text(encoding="utf-8"), re.MULTILINE)
        name = names[0] if names else name
    return f"{name}, {os.cpu_count()} cores, Python {platform.python_version()}".replace('"', "'")


def _find(text, table, page):
    """(opening match, start and end of the body) of a table in a page's text."""
    for opening in OPENING.finditer(text):
        if opening["name"] == table.name:
            end = text.find(f"<!-- end of figures: {table.name} -->", opening.end())
            if end < 0:
                raise InputError(page, f"figures: {table.name} has no end", f"<!-- end of figures: {table.name} -->")
            return opening, opening.end(), end
    raise InputError(
        page, f"no figures: {table.name}", "the opening comment of the table (see microstage_ros.report.stamped)"
    )


def read_stamp(root, table):
    """`Stamp` of a table in its page. Raises `InputError` where the page has none."""
    page = Path(root) / table.page
    text = page.read_text(encoding="utf-8")
    opening, start, end = _find(text, table, page)
    return Stamp(opening["version"], opening["code"], opening["made"], opening["machine"],
                 MARK.format(name=table.name) in text[start:end])


def is_stale(root, table):
    """Whether the code that a table is about has changed since it was made."""
    return read_stamp(root, table).code != digest(root, table.code)


def write_table(root, table, body):
    """Put a freshly made table into its page, with a new stamp."""
    page = Path(root) / table.page
    text = page.read_text(encoding="utf-8")
    opening, _, end = _find(text, table, page)
    today = datetime.datetime.now(datetime.timezone.utc).date().isoformat()
    stamp = (
        f"<!-- figures: {table.name} version={__version__} code={digest(root, table.code)} made={today}"
        f' machine="{machine()}" -->\n'
    )
    page.write_text(text[:opening.start()] + stamp + body.strip("\n") + "\n" + text[end:], encoding="utf-8")


def mark_stale(root, table):
    """Make a stale table say so to its reader; nothing happens to one that is fresh or says so."""
    if not is_stale(root, table) or read_stamp(root, table).marked:
        return
    page = Path(root) / table.page
    text = page.read_text(encoding="utf-8")
    _, _, end = _find(text, table, page)
    page.write_text(text[:end] + "\n" + MARK.format(name=table.name) + "\n" + text[end:], encoding="utf-8")
