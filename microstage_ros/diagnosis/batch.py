"""One diagnosis after another: on this machine's cores, or handed to a Dask cluster.

A case is one axis with its records, named by files; what a worker gets and returns is small, and no
record is held longer than its own case needs it. Cases are handed out as workers become free, so a
thousand of them need no more memory than the few that run.
"""

import concurrent.futures
import dataclasses
import multiprocessing
import os
import pathlib
import re
import sys

from threadpoolctl import threadpool_limits

from microstage_ros.diagnosis import fleet, pooling
from microstage_ros.diagnosis.case import diagnose_case
from microstage_ros.diagnosis.fleet import AHEAD, as_they_end
from microstage_ros.diagnosis.preprocessing.common_sensors import in_common
from microstage_ros.diagnosis.report.answer import write_answer
from microstage_ros.diagnosis.resimulation.diagnose import diagnose_force_axis
from microstage_ros.diagnosis.result import Diagnosis
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.axis_file import load_axis
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import read_record
from microstage_ros.records.checks import check_record
from microstage_ros.records.csv_file import SUFFIXES

LARGEST = 2 * pooling.GROUP    # records of one case that are held at once


@dataclasses.dataclass(frozen=True)
class Case:
    """One axis: the files to read and the folder to write. Paths as text."""

    name: str
    axis: str
    records: tuple
    holdout: tuple
    baseline: tuple
    out: str
    seed: int = 0

    @property
    def sources(self):
        """What is read, for the answer's files."""
        return {"records": list(self.records), "holdout": list(self.holdout), "baseline": list(self.baseline)}

    @property
    def files(self):
        """Every file that is read."""
        return (self.axis, *self.records, *self.holdout, *self.baseline)

    def placed(self, place):
        """The case with every path put through ``place``."""
        every = lambda paths: tuple(map(place, paths))
        return dataclasses.replace(
            self,
            axis=place(self.axis),
            records=every(self.records),
            holdout=every(self.holdout),
            baseline=every(self.baseline),
            out=place(self.out),
        )

    @property
    def is_series(self):
        """Whether there are too many records to hold at once."""
        return len(self.records) > LARGEST


def diagnose_files(case, progress=None, jobs=1):
    """Read the files of a `Case`, diagnose, write the answer. Returns the mapping of report.json.

    ``jobs``: threads inside this one case [1], where the way of diagnosing has use for them.
    """
    with fleet.reached(case.axis) as place:
        axis = load_axis(place)
    records, holdout, baseline = (
        [checked_record(path, axis) for path in paths] for paths in (case.records, case.holdout, case.baseline)
    )
    answer = diagnose_records(axis, records, holdout, baseline, case.seed, progress, jobs)
    return write_answer(answer, axis, case.out, case.sources)


def checked_record(path, axis):
    """The record, if it can be what its header says; what weakens the result is said on standard error."""
    with fleet.reached(path) as place:
        record = read_record(place)
    for sentence in check_record(record, axis):
        print(f"warning: {sentence}", file=sys.stderr)
    return record


def diagnose_records(axis, records, holdout, baseline, seed, progress=None, jobs=1, twin=()):
    """`Diagnosis` by the way that suits the drive: force balance of a motor, or closed-loop re-simulation.

    The axis file has been checked before: an effect out of its range is one that was fitted here, and no fault of the
    file. The answer is then ``unexplained``, with that size in its notes.

    Linear algebra runs on one thread meanwhile: its matrices are small, records are worked on side by side as it is
    (`preprocessing.threads`), and threads that wait for each other cost three times the processor time. ``seed``: of
    what re-simulation draws [1]; ``jobs``: of its threads [1]; ``twin``: list of `Record`, as `diagnose_case`
    has it. Sensors that not all of the records have are not used, and a note says so (`common_sensors`).
    """
    (records, holdout, baseline), notes = in_common(records, holdout, baseline)
    found = _by_drive(axis, records, holdout, baseline, seed, progress, jobs, twin)
    return dataclasses.replace(found, notes=(*notes, *found.notes)) if notes else found


def _by_drive(axis, records, holdout, baseline, seed, progress, jobs, twin):
    """`Diagnosis` of records that have their sensors in common."""
    try:
        with threadpool_limits(limits=1, user_api="blas"):
            if actuator_of(axis).estimated(axis, "diagnose") != "motor":
                return diagnose_force_axis(axis, records, holdout, baseline, seed, progress, jobs)
            return diagnose_case(axis, records, holdout, baseline, seed, twin)
    except InputError as error:
        if not re.search(r"(^|: )effects: ", error.place):
            raise
        size = re.sub(r".*effects: ", "", error.place)
        return Diagnosis(
            "unexplained",
            seed=seed,
            notes=(
                (
                    f"The records differ from the model by more than any cause of the catalogue can: {size} came out as"
                    f" {error.value!r}, possible is {error.expected}. Check what the columns of the records are, and"
                    " whether this is the axis file of this machine."
                ),
            ),
        )


def cases_of(folders, axis, out, seed):
    """One `Case` per folder: files ``hold*`` are held out, ``base*`` are the baseline, all others teach.

    A folder's own ``axis.yaml`` replaces ``axis``; ``seed``: of every case [1]. Raises InputError for a folder without
    records.
    """
    cases, taken = [], {}
    for folder in map(pathlib.Path, folders):
        if not folder.is_dir():
            raise InputError(folder, "not a folder", "with --each, folders with the records of one axis each")
        files = sorted(str(path) for path in folder.iterdir() if _is_record(path))
        holdout = tuple(f for f in files if pathlib.Path(f).name.startswith("hold"))
        baseline = tuple(f for f in files if pathlib.Path(f).name.startswith("base"))
        records = tuple(f for f in files if f not in holdout and f not in baseline)
        if not records:
            raise InputError(folder, "no records", "at least one record beside hold* and base*")
        own = folder / "axis.yaml"
        name = folder.name
        taken[name] = taken.get(name, 0) + 1
        name = name if taken[name] == 1 else f"{name}_{taken[name]}"
        cases.append(Case(name, str(own if own.exists() else axis), records, holdout, baseline,
                          str(pathlib.Path(out) / name), seed))
    return cases


def _is_record(path):
    return path.name.endswith((*SUFFIXES, ".mcap")) or (path / "metadata.yaml").exists()


def diagnose_series(case, jobs=1, scheduler=None, progress=None):
    """Diagnose a long series of records of one axis in groups and pool them; writes and returns the answer.

    ``jobs``: processes [1]; ``progress``: function (groups done, groups in all), or None. Raises the first group's
    error, if one fails.
    """
    groups, reports = pooling.groups_of(case), {}
    for group, report in diagnose_batch(groups, jobs, scheduler):
        if isinstance(report, Exception):
            raise report
        reports[group.name] = report
        if progress:
            progress(len(reports), len(groups))
    answer = pooling.pool(groups, [reports[group.name] for group in groups], case.seed)
    return write_answer(answer, load_axis(case.axis), case.out, case.sources)


def diagnose_batch(cases, jobs=1, scheduler=None):
    """Diagnose cases, yielding (case, report mapping or Exception) as they end.

    Parameters
    ----------
    jobs : processes on this machine [1].
    scheduler : address of a Dask scheduler (``tcp://host:port``). Paths are made absolute; where the workers do not see
        them the files' bytes are sent and the answers' files come back.

    Raises
    ------
    InputError : the scheduler cannot be reached, or its workers lack this project.
    """
    if scheduler:
        yield from fleet.written_by(cases, _attempt, scheduler)
    elif jobs <= 1:
        for case in cases:
            yield case, _attempt(case)
    else:
        yield from on_cores(cases, _attempt, jobs)


def _attempt(case):
    """The report of a case, or the error that ended it: one bad case must not end the others."""
    try:
        return diagnose_files(case)
    except Exception as error:  # noqa: BLE001  handed to the caller with its case
        return error


def on_cores(cases, work, jobs):
    """Yield (case, work(case)) as they end, from ``jobs`` fresh processes [1]; a few cases ahead, not all.

    Nothing of a multithreaded parent is inherited; each process computes with one thread, unless the
    environment says otherwise.
    """
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(jobs, mp_context=context) as pool:
        yield from as_they_end(iter(cases), lambda case: pool.submit(work, case), AHEAD * jobs,
                               lambda running: concurrent.futures.wait(
                                   running, return_when=concurrent.futures.FIRST_COMPLETED).done)
