"""Progress of long work on a terminal, with the time left; nothing at all where standard error is piped.

    with progress("comparing", total=len(cases)) as bar:
        for case in cases:
            work(case)
            bar.advance()

    with progress("diagnosing", remembered="diagnose 3 records") as bar:   # how much there is to do is not known
        diagnose(records, tell=bar.say)            # bar.say("fitting backlash") changes the words
        groups(on_step=bar.reach)                  # bar.reach(3, 17): 3 of 17 done

``bool(bar)`` is False where nothing is shown.
"""

import json
import os
import sys
import time
from contextlib import contextmanager
from pathlib import Path

from microstage_ros.files import FileProblem, write_text


class Bar:
    """One line of progress. Every method may be called where nothing is shown."""

    def __init__(self, shown=None, task=None, what=""):
        self._shown, self._task, self._what = shown, task, what

    def __bool__(self):
        """Whether anything is shown."""
        return self._shown is not None

    def advance(self, steps=1):
        """So many more ``steps`` [1] are done."""
        if self._shown:
            self._shown.advance(self._task, steps)

    def reach(self, done, total=None):
        """So many are ``done`` [1], of ``total`` [1]; None: as said before."""
        if self._shown:
            self._shown.update(self._task, completed=done, **({} if total is None else {"total": total}))

    def say(self, text):
        """What is being done now."""
        if self._shown:
            self._shown.update(self._task, description=f"{self._what}: {text}" if text else self._what)


@contextmanager
def progress(what, total=None, remembered=None):
    """A `Bar` for the work done inside.

    Parameters
    ----------
    what : is being done, such as "diagnosing". total : steps there are [1]; None: not known.
    remembered : name of this kind of work, where its steps cannot be counted: the time left is then estimated from how
        long it took the last time on this machine (kept in the user's cache folder).
    """
    if not sys.stderr.isatty():
        yield Bar()
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    before = _durations().get(remembered) if remembered else None
    began = time.monotonic()
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(24),
        TimeElapsedColumn(),
        _left_column(before),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        yield Bar(shown, shown.add_task(what, total=total), what)
    if remembered:
        _remember(remembered, time.monotonic() - began)


def cache_folder():
    """The project's folder in the user's cache: ``$MICROSTAGE_CACHE``, or below the user's cache folder."""
    given = os.environ.get("MICROSTAGE_CACHE")
    return Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "microstage_ros"


def _durations():
    """How long each kind of work took the last time [s]; empty where nothing readable is kept."""
    try:
        kept = json.loads((cache_folder() / "durations.json").read_text(encoding="utf-8"))
        return {name: float(value) for name, value in kept.items()}
    except (OSError, ValueError, AttributeError, TypeError, RuntimeError):
        return {}


def _remember(name, seconds):
    """Keep a duration for the next time; without a cache folder that can be written, do not."""
    try:
        write_text(cache_folder() / "durations.json", json.dumps({**_durations(), name: round(seconds, 1)}, indent=1))
    except (FileProblem, OSError, RuntimeError):
        pass


def _left_column(before):
    """The column of the time left: empty before it can be estimated. ``before``: seconds of the last time, or None."""
    from rich.progress import ProgressColumn
    from rich.text import Text

    class Left(ProgressColumn):
        def render(self, task):
            left = task.time_remaining if task.total else before and before - (task.elapsed or 0.0)
            if task.finished or left is None or left < 1.0:
                return Text("")
            minutes, seconds = divmod(int(left), 60)
            return Text(f"{minutes} min {seconds:02d} s left" if minutes else f"{seconds} s left")

    return Left()
