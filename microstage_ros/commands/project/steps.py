"""The steps of a set-up, each a command with its log, and how long they took: standard library alone."""

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

MOST_SILENT = 1800
"""Longest time [s] for which a step may write nothing into its log."""


class Failure(Exception):
    """A step did not work; the text says which and what helps."""


def cache_folder():
    """Where what is built once for all checkouts lies: ``$MICROSTAGE_CACHE``, or the user's cache folder."""
    given = os.environ.get("MICROSTAGE_CACHE")
    return Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "microstage_ros"


def step(what: str, command: list[str], build: Path, environment: dict | None = None,
         stop: threading.Event | None = None) -> None:
    """Run one command with its output in ``.build/setup.log``, and a line of progress on a terminal.

    Parameters
    ----------
    what : name of the step. command : words of the command, shape (n,). build : folder of the log.
    environment : variables of the command; None: this process's.
    stop : `threading.Event`; with one it runs beside another step, with a log of its own and no progress, and ends when
        the event is set.

    Raises
    ------
    Failure : the command failed, or wrote nothing for `MOST_SILENT`.
    """
    began, live, usual = time.monotonic(), sys.stderr.isatty() and not stop, _durations().get(f"set-up: {what}")
    log = build / (f"setup-{what}.log" if stop else "setup.log")
    with open(log, "a", encoding="utf-8") as output:
        output.write(f"\n$ {' '.join(command)}\n")
        output.flush()
        start = output.tell()
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
                                   env=environment)
        try:
            while process.poll() is None:
                passed = time.monotonic() - began
                if live:
                    left = f", about {usual - passed:.0f} s left" if usual and usual > passed + 1 else ""
                    print(
                        f"\r\033[K  {what}: {passed:3.0f} s{left}  {_last_line(log, start)}",
                        end="",
                        file=sys.stderr,
                        flush=True,
                    )
                if time.time() - log.stat().st_mtime > MOST_SILENT:
                    process.kill()
                if stop and stop.is_set():
                    process.terminate()
                time.sleep(0.2)
        except BaseException:
            process.terminate()
            process.wait()
            raise
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr)
    if process.returncode:
        raise Failure(f"{what}: failed ({_last_line(log, start)}); all of it is in {log}")
    print(f"  {what}: done in {time.monotonic() - began:.0f} s", file=sys.stderr)
    _remember(what, time.monotonic() - began)


def _durations():
    """How long each kind of work took the last time [s] (`commands.progress` keeps its own there too)."""
    try:
        return json.loads((cache_folder() / "durations.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def _remember(what, seconds):
    """Keep a duration for the next time, where there is a place for it."""
    try:
        kept = {**_durations(), f"set-up: {what}": round(seconds, 1)}
        beside = cache_folder() / f".durations.{os.getpid()}.partial"
        beside.parent.mkdir(parents=True, exist_ok=True)
        beside.write_text(json.dumps(kept, indent=1), encoding="utf-8")
        os.replace(beside, beside.with_name("durations.json"))
    except (OSError, TypeError):
        pass


def _last_line(log, start):
    """The newest line of a log after byte ``start``, shortened."""
    with open(log, "rb") as file:
        file.seek(max(start, log.stat().st_size - 2000))
        lines = [line for line in file.read().decode("utf-8", "replace").splitlines() if line.strip()]
    return lines[-1].strip()[:90] if lines else ""
