"""The folder of a commissioning: every record that was made, and what is done, so that an interrupted one goes on."""

import hashlib
import json
import os
from pathlib import Path
from typing import TypedDict

from microstage_ros.quantities.errors import InputError
from microstage_ros.records import read_record, write_record

PROGRESS, REPORT = "progress.json", "report.json"


class Progress(TypedDict):
    """What `PROGRESS` holds: ``done`` is {phase: {"result", "records"}}, ``number`` that of the last record, ``time_s``
    the machine time so far [s]."""

    format: int
    identity: str
    done: dict[str, dict]
    number: int
    time_s: float


def write_json(path, tree):
    """Write JSON in one piece: the file is there whole, or as it was."""
    path = Path(path)
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(json.dumps(tree, indent=1, ensure_ascii=False), encoding="utf-8")
    os.replace(temporary, path)


class Store:
    """Records and progress in ``folder``.

    Parameters
    ----------
    folder : made if it is missing. identity : text that names sketch and backend; another one does not go on here.

    Raises
    ------
    InputError : a finished commissioning lies there, or one of another machine.
    """

    def __init__(self, folder, identity):
        self.folder = Path(folder)
        self._records = self.folder / "records"
        digest = hashlib.sha256(identity.encode()).hexdigest()[:16]
        self._progress: Progress = {"format": 1, "identity": digest, "done": {}, "number": 0, "time_s": 0.0}
        report = self._read(REPORT)
        if report and report.get("verdict") == "ready":
            raise InputError("--out", str(folder), "a folder without a finished commissioning")
        before = self._read(PROGRESS)
        others = [name for name in (REPORT, "report.html", "axis.yaml") if (self.folder / name).exists()]
        if before is None and others and (report or {}).get("verdict") not in ("refused", "stopped"):
            raise InputError("--out", str(self.folder / others[0]), "a folder without results of anything else")
        if before and not (report and report.get("verdict") == "refused"):
            if before.get("identity") != digest:
                raise InputError(
                    "--out",
                    str(folder),
                    "a new folder: the unfinished commissioning there is of another sketch or backend",
                )
            self._progress = before
        elif before:
            self._progress["number"] = before.get("number", 0)  # its records stay
        try:
            self._records.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError("--out", str(folder), f"a folder that can be written ({error.strerror})") from None

    def _read(self, name):
        path = self.folder / name
        if not path.is_file():
            return None
        try:
            return json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(
                str(path), " ".join(str(error).split())[:120], "a whole JSON file; remove it to begin anew"
            ) from None

    @property
    def time(self):
        """Machine time of the parts before an interruption [s]."""
        return float(self._progress["time_s"])

    @property
    def resumed(self):
        """Whether parts of it were done before."""
        return bool(self._progress["done"])

    def keep(self, name, record, time_s):
        """Store a record under the next number. Returns its path."""
        self._progress["number"] += 1
        path = self._records / f"{self._progress['number']:02d}_{name}.csv.gz"
        record.source = path.name
        write_record(record, path)
        self._progress["time_s"] = time_s
        write_json(self.folder / PROGRESS, self._progress)
        return path

    def finish(self, phase, result, records=()):
        """Note that a ``phase`` is done, with its result (plain data) and the records it needs again."""
        self._progress["done"][phase] = {"result": result, "records": [Path(r).name for r in records]}
        write_json(self.folder / PROGRESS, self._progress)

    def done(self, phase):
        """Result of a ``phase`` that is done, None otherwise."""
        found = self._progress["done"].get(phase)
        return None if found is None else found["result"]

    def records_of(self, phase):
        """The records of a ``phase`` that is done, `Record` each."""
        return [read_record(self._records / name) for name in self._progress["done"][phase]["records"]]
