"""Work handed to a Dask cluster: what workers must have is asked before anything is sent, files are reached or shipped.

A worker needs this project importable, of the same version. A file is read where it lies if the workers see the path (a
shared folder, or an address such as s3://… or https://… that fsspec opens); else its bytes go with the case, and the
answer's files come back with the report. A case whose worker dies is tried again on another; what is already done stays
done.
"""

import contextlib
import dataclasses
import functools
import os
import pathlib
import tempfile

from microstage_ros import __version__
from microstage_ros.files import complete_folder
from microstage_ros.quantities.errors import InputError

PATIENCE = "10s"               # for a scheduler to answer
AHEAD = 2                      # cases per worker that are handed out before the first comes back
HELP = "docs/logs.md, 'Many machines on many computers'"
#: Evaluated on every worker: builtins alone, for what is asked is whether this project can be imported there.
PROBE = (
    "(lambda u: __import__('microstage_ros').__version__ if u.find_spec('microstage_ros') else"
    " '')(__import__('importlib.util').util)"
)


def is_address(path):
    """Whether a path is one that fsspec opens: ``scheme://…``."""
    return "://" in str(path)


def absolute(path):
    """An absolute path; addresses stay as they are."""
    return str(path) if is_address(path) else str(pathlib.Path(path).resolve())


@contextlib.contextmanager
def reached(path):
    """A local path of a file: itself, or a temporary copy of what an address holds.

    Raises InputError for an address that cannot be opened.
    """
    if not is_address(path):
        yield str(path)
        return
    import fsspec

    with tempfile.TemporaryDirectory() as folder:
        local = pathlib.Path(folder) / str(path).rstrip("/").rpartition("/")[2]
        try:
            with fsspec.open(str(path), "rb") as source:
                local.write_bytes(source.read())
        except ImportError as error:
            raise InputError(
                path,
                str(error).splitlines()[0],
                "an address whose library is installed (s3fs for s3://, aiohttp for https://)",
            ) from None
        except (OSError, ValueError) as error:
            raise InputError(
                path, " ".join(str(error).split())[:120] or type(error).__name__, "an address that can be read"
            ) from None
        yield str(local)


def on_cluster(cases, work, scheduler):
    """Yield (case, work(case) or the exception that ended it) as they end, from the workers of a Dask scheduler.

    Raises InputError in one line: no scheduler there, no workers, workers without this project or with another version
    of it.
    """
    from distributed import wait

    client = _client(scheduler)
    with client:
        check_workers(client, scheduler)
        workers = max(sum(client.ncores().values()), 1)
        yield from as_they_end(
            iter(cases),
            lambda case: client.submit(work, case, pure=False, retries=2),
            AHEAD * workers,
            lambda running: wait(list(running), return_when="FIRST_COMPLETED").done,
        )


def in_order(function, items, scheduler):
    """``function`` of every one of ``items``, shape (n,), in order, from the workers of a Dask scheduler. Raises the
    first error that a case ends with."""
    found = {}
    for (number, _), outcome in on_cluster(enumerate(items), functools.partial(_of_second, function), scheduler):
        if isinstance(outcome, Exception):
            raise outcome
        found[number] = outcome
    return [found[number] for number in range(len(found))]


def _of_second(function, pair):
    return function(pair[1])


def _client(scheduler):
    from distributed import Client

    try:
        return Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise InputError(
            "--scheduler",
            scheduler,
            f"the address of a running Dask scheduler, tcp://host:port ({type(error).__name__}); see {HELP}",
        ) from None


def check_workers(client, scheduler):
    """InputError if there are no workers, or if one of them lacks this project or has another version."""
    try:
        versions = client.run(eval, PROBE)
    except Exception as error:  # noqa: BLE001  whatever a worker answers is reported in one line
        raise InputError(
            "--scheduler",
            scheduler,
            f"workers that answer ({type(error).__name__}: {' '.join(str(error).split())[:80]})",
        ) from None
    if not versions:
        raise InputError(
            "--scheduler",
            scheduler,
            f"a scheduler with workers; start some with `./microstage shell dask worker {scheduler}`, see {HELP}",
        )
    lacking = [address for address, version in versions.items() if not version]
    if lacking:
        raise InputError("--scheduler", f"{len(lacking)} of {len(versions)} workers lack microstage_ros ({lacking[0]})",
                         f"workers started in this project's environment, see {HELP}")
    other = {address: version for address, version in versions.items() if version != __version__}
    if other:
        address, version = next(iter(other.items()))
        raise InputError(
            "--scheduler",
            f"worker {address} has microstage_ros {version}",
            f"workers of version {__version__}, as here",
        )


def as_they_end(cases, submit, most, finished):
    """Keep up to ``most`` [1] cases running; yield (case, result or exception) of each that ends."""
    running = {}
    while True:
        while len(running) < most:
            case = next(cases, None)
            if case is None:
                break
            running[submit(case)] = case
        if not running:
            return
        for future in finished(running):
            try:
                outcome = future.result()
            # a worker that died, a result that cannot come back: this case's alone
            except Exception as error:  # noqa: BLE001
                outcome = error
            yield running.pop(future), outcome


@dataclasses.dataclass(frozen=True)
class Shipment:
    """A case with the bytes of its files, for workers that do not see them. ``files``: ((path, bytes), …)."""

    case: object
    files: tuple


def ship(case, paths):
    """`Shipment` of a case; folders (rosbag2) go with all their files. Raises InputError for a file that cannot be
    read."""
    found = []
    for path in paths:
        place = pathlib.Path(path)
        for file in sorted(place.rglob("*")) if place.is_dir() else [place]:
            if file.is_file():
                try:
                    found.append((str(file), file.read_bytes()))
                except OSError as error:
                    raise InputError(file, error.strerror, "a file that can be read") from None
    return Shipment(case, tuple(found))


def unpacked(shipment, folder):
    """Write a shipment's files below ``folder``; returns the function that turns a path of the sender into one of
    here."""
    folder = pathlib.Path(folder)
    for path, content in shipment.files:
        target = folder / path.lstrip("/").replace(":", "_")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
    return lambda path: str(folder / str(path).lstrip("/").replace(":", "_"))


def checked(scheduler, paths):
    """Whether every worker sees these paths; the workers are checked first. Raises InputError as `on_cluster` does."""
    client = _client(scheduler)
    with client:
        check_workers(client, scheduler)
        return all(all(client.run(os.path.exists, path).values()) for path in paths[:3])


def written_by(cases, work, scheduler):
    """Cases that read files and write a folder, on a cluster: yields (case, report mapping or exception) as they end.

    Files are read where they lie if the workers see them, else they go along and the answer's folder comes back.

    Parameters
    ----------
    cases : with ``files`` (paths that are read), ``out`` (folder that is written) and ``placed(f)``: the case with
        every path put through ``f``.
    work : function of a case that may be sent to another process; returns the report's mapping.

    Raises
    ------
    InputError : as `on_cluster`.
    """
    cases = [case.placed(absolute) for case in cases]
    if not cases:
        return
    if checked(scheduler, _local(cases[0])):
        yield from on_cluster(cases, work, scheduler)
        return
    shipments = (ship(case, _local(case)) for case in cases)
    for shipment, outcome in on_cluster(shipments, functools.partial(_shipped, work), scheduler):
        if isinstance(outcome, tuple):
            outcome, files = outcome
            with complete_folder(shipment.case.out) as folder:
                for name, content in files:
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
                    (folder / name).write_bytes(content)
        yield shipment.case, outcome


def _local(case):
    return [path for path in case.files if not is_address(path)]


def _shipped(work, shipment):
    """On a worker: the report of a shipped case and the files of its answer, or the error that ended it."""
    with tempfile.TemporaryDirectory() as folder:
        local, out = unpacked(shipment, folder), pathlib.Path(folder) / "answer"
        case = shipment.case.placed(lambda path: path if is_address(path) else local(path))
        report = work(dataclasses.replace(case, out=str(out)))
        if isinstance(report, Exception):
            return report
        return report, tuple((str(f.relative_to(out)), f.read_bytes()) for f in sorted(out.rglob("*")) if f.is_file())
