"""The history of an axis's health in one SQLite file: healthy windows to judge by, and every window that was judged."""

import json
import os
import sqlite3

from microstage_ros import __version__
from microstage_ros.monitoring.health import Reference
from microstage_ros.quantities.errors import InputError

HISTORY = "a history file of watch that can be written, or a new file in an existing folder"
MAGIC = b"SQLite format 3\0"
"""With which every file of SQLite begins."""

TABLES = """
CREATE TABLE IF NOT EXISTS facts (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS healthy (id INTEGER PRIMARY KEY, time REAL, source TEXT, traits TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS health (
    time REAL, source TEXT, channel TEXT, score REAL, trait TEXT, alarm INTEGER, since REAL);
CREATE INDEX IF NOT EXISTS health_time ON health (time);
"""


class Store:
    """A history file. Use as a context manager.

    Parameters
    ----------
    path : of the file, made if it is not there; ``":memory:"`` keeps nothing.
    axis : name of the axis; a file of another axis is refused. window_s : length of a window [s], as it was when begun.

    Raises
    ------
    InputError : a file that is no history, or that of another axis or window.
    """

    def __init__(self, path, axis, window_s):
        self.path, self._axis, self._window = str(path), axis, float(window_s)
        _refuse_another_kind(self.path)
        try:
            self._base = sqlite3.connect(self.path, isolation_level=None)
            self._begin({"axis": axis, "window_s": self._window})
        except InputError:
            raise
        except (sqlite3.Error, ValueError, TypeError) as error:
            raise InputError(self.path, str(error), HISTORY) from None

    def _begin(self, facts):
        """Make the tables of a new history, or see that the file is one, whole and of these facts."""
        tables = {name for (name,) in self._base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if tables and not tables >= {"facts", "healthy", "health"}:
            self._base.close()
            raise InputError(self.path, f"a database with the tables {', '.join(sorted(tables))}", HISTORY)
        ((state,),) = self._base.execute("PRAGMA quick_check(1)").fetchall()
        if state != "ok":
            self._base.close()
            raise InputError(self.path, f"a damaged file ({state})", HISTORY)
        self._base.executescript(TABLES)
        self._agree(facts)
        self._base.execute("INSERT OR REPLACE INTO facts VALUES ('version', ?)", (json.dumps(__version__),))

    def _agree(self, facts):
        for name, value in facts.items():
            row = self._base.execute("SELECT value FROM facts WHERE name = ?", (name,)).fetchone()
            if row is None:
                self._base.execute("INSERT INTO facts VALUES (?, ?)", (name, json.dumps(value)))
            elif json.loads(row[0]) != value:
                self._base.close()
                raise InputError(f"{self.path}: {name}", value, f"{json.loads(row[0])}, as the history was begun")

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def hold(self, machine):
        """Let a machine use the sensors with which this history was begun; begin it with the machine's where it is new.

        Parameters
        ----------
        machine : `traits.Machine`. Raises InputError where it lacks one of the history's sensors.
        """
        row = self._base.execute("SELECT value FROM facts WHERE name = 'sensors'").fetchone()
        if row is not None:
            machine.hold_to(json.loads(row[0]), self.path)
        elif machine.sensors is not None:
            self._base.execute("INSERT INTO facts VALUES ('sensors', ?)", (json.dumps(machine.sensors),))

    def add_healthy(self, time, source, traits):
        """Keep one healthy window's traits {(channel, trait): size}; it begins at ``time`` [s].

        A window of the same time whose traits are here already, to the last digit, is the same one: counted twice it
        would make the spread too narrow.
        """
        if not self.has_learned(time, traits):
            row = (time, source, _text(traits))
            self._base.execute("INSERT INTO healthy (time, source, traits) VALUES (?, ?, ?)", row)

    def has_learned(self, time, traits):
        """Whether the window that began at ``time`` [s], with these traits, is one of the healthy ones."""
        sought = "SELECT 1 FROM healthy WHERE time = ? AND traits = ?"
        return self._base.execute(sought, (time, _text(traits))).fetchone() is not None

    def healthy(self):
        """List of the healthy windows' traits."""
        rows = self._base.execute("SELECT traits FROM healthy ORDER BY id").fetchall()
        return [{(channel, trait): size for channel, trait, size in json.loads(text)} for (text,) in rows]

    def reference(self):
        """`Reference` of the healthy windows; InputError while there are too few."""
        return Reference.of(self.healthy(), self._window)

    def add_health(self, time, source, health):
        """Keep what was said of one window, {channel: `ChannelHealth`}; it begins at ``time`` [s]."""
        self._base.executemany(
            "INSERT INTO health VALUES (?, ?, ?, ?, ?, ?, ?)",
            [(time, source, channel, h.score, h.trait, int(h.alarm), h.since) for channel, h in health.items()],
        )

    def history(self, channel=None):
        """Rows (time, source, channel, score, trait, alarm, since) in the order in which they were judged.

        Not in that of their times: every record of a file counts its time from zero.
        """
        if channel is None:
            return self._base.execute("SELECT * FROM health ORDER BY rowid").fetchall()
        return self._base.execute("SELECT * FROM health WHERE channel = ? ORDER BY rowid", (channel,)).fetchall()

    def close(self):
        """Close the file; everything is in it already."""
        self._base.close()


def _text(traits):
    """Traits {(channel, trait): size} as they are kept."""
    return json.dumps([[channel, trait, size] for (channel, trait), size in sorted(traits.items())])


def _refuse_another_kind(path):
    """Raise InputError for a file that holds something else.

    SQLite takes one of a few bytes for an empty base, and writes over it.
    """
    if os.path.isfile(path):
        with open(path, "rb") as file:
            begins = file.read(len(MAGIC))
        if begins and begins != MAGIC:
            raise InputError(path, begins, HISTORY)
