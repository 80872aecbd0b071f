"""Logs of many machines, one after another: on this machine's cores, or handed to a Dask cluster."""

import dataclasses
import pathlib

from microstage_ros.diagnosis import fleet
from microstage_ros.diagnosis.batch import on_cores
from microstage_ros.diagnosis.logs.case import diagnose_logs
from microstage_ros.diagnosis.logs.report.answer import write_log_answer
from microstage_ros.model.axis_file import load_axis
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.logs import load_description, read_log

SUFFIXES = (".csv", ".txt", ".log", ".tsv", ".dat", ".mat", ".mcap")
PACKED = (".gz", ".xz")


@dataclasses.dataclass(frozen=True)
class LogCase:
    """One machine: LOG.yaml, logs of when it was healthy and of now, the folder to write. Paths as text; ``axis`` may
    be empty."""

    name: str
    log: str
    baseline: tuple
    now: tuple
    out: str
    axis: str = ""
    seed: int = 0

    @property
    def files(self):
        """Every file that is read."""
        return (self.log, *([self.axis] if self.axis else []), *self.baseline, *self.now)

    def placed(self, place):
        """The case with every path put through ``place``."""
        return dataclasses.replace(
            self,
            log=place(self.log),
            axis=place(self.axis) if self.axis else "",
            baseline=tuple(map(place, self.baseline)),
            now=tuple(map(place, self.now)),
            out=place(self.out),
        )


def cases_of_logs(folders, log, baseline, axis, out, seed):
    """One `LogCase` per folder: files ``base*`` are its baseline (else ``baseline``), all others are of now.

    A folder's own ``LOG.yaml`` and ``axis.yaml`` replace ``log`` and ``axis``; ``seed``: of every case [1]. Raises
    InputError for a folder without either sort of log.
    """
    cases, taken = [], {}
    for folder in map(pathlib.Path, folders):
        if not folder.is_dir():
            raise InputError(folder, "not a folder", "with --each, folders with the logs of one machine each")
        files = sorted(str(path) for path in folder.iterdir() if _is_log(path))
        base = tuple(f for f in files if pathlib.Path(f).name.startswith("base")) or tuple(map(str, baseline))
        now = tuple(f for f in files if f not in base)
        if not base or not now:
            raise InputError(
                folder,
                f"{len(base)} logs of the baseline, {len(now)} of now",
                "files base* (or --baseline) and at least one other log",
            )
        taken[folder.name] = taken.get(folder.name, 0) + 1
        name = folder.name if taken[folder.name] == 1 else f"{folder.name}_{taken[folder.name]}"
        own = lambda file, given: str(folder / file) if (folder / file).exists() else str(given or "")
        cases.append(
            LogCase(name, own("LOG.yaml", log), base, now, str(pathlib.Path(out) / name), own("axis.yaml", axis), seed)
        )
    return cases


def _is_log(path):
    plain = path.with_suffix("") if path.suffix.lower() in PACKED else path
    return path.is_file() and plain.suffix.lower() in SUFFIXES


def diagnose_log_files(case):
    """Read the files of a `LogCase`, diagnose, write the answer. Returns the mapping of report.json."""
    axis = load_axis(case.axis) if case.axis else None
    description = load_description(case.log)
    if axis is not None:
        description = with_axis(description, axis)
    baseline, now = ([_read(path, description) for path in paths] for paths in (case.baseline, case.now))
    sources = {"records": list(case.now), "now": list(case.now), "holdout": [], "baseline": list(case.baseline)}
    return write_log_answer(diagnose_logs(baseline, now, description, case.seed), description, case.out, sources, axis)


def _read(path, description):
    with fleet.reached(path) as place:
        return read_log(place, description)


def with_axis(description, axis):
    """The description with those facts of an axis file that LOG.yaml does not give itself."""
    facts = dict(description.facts)
    for fact, key in (("lead", "transmission.pitch"), ("gear_ratio", "transmission.gear_ratio"), ("mass", "stage.mass"),
                      ("torque_constant", "drive.torque_constant"), ("resistance", "drive.resistance")):
        try:
            facts.setdefault(fact, float(axis.value(key)))
        except (KeyError, ValueError):
            continue
    return dataclasses.replace(description, facts=facts)


def diagnose_log_batch(cases, jobs=1, scheduler=None):
    """Diagnose `LogCase`s, yielding (case, report mapping or exception) as they end; ``jobs`` [1], ``scheduler`` as in
    `batch.diagnose_batch`."""
    if scheduler:
        yield from fleet.written_by(cases, _attempt, scheduler)
    else:
        yield from on_cores(cases, _attempt, jobs) if jobs > 1 else ((case, _attempt(case)) for case in cases)


def _attempt(case):
    """The report of a case, or the error that ended it: one bad case must not end the others."""
    try:
        return diagnose_log_files(case)
    except Exception as error:  # noqa: BLE001  handed to the caller with its case
        return error
