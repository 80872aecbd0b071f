"""Work on a cluster: workers are asked first, paths reach them or files go along, one lost case ends no other."""

import functools
import http.server
import threading

import pytest
from distributed import LocalCluster

from microstage_ros.diagnosis import fleet
from microstage_ros.diagnosis.batch import Case
from microstage_ros.quantities.errors import InputError


@pytest.fixture(scope="module")
def scheduler():
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        yield cluster.scheduler_address


def half(number):
    """Half of an even number."""
    if number % 2:
        raise ValueError(f"{number} is odd")
    return number // 2


def test_one_failed_case_leaves_the_others(scheduler):
    found = dict(fleet.on_cluster([2, 3, 4], half, scheduler))
    assert found[2] == 1 and found[4] == 2 and isinstance(found[3], ValueError)


def test_workers_without_the_project_are_told_in_one_line(scheduler, monkeypatch):
    monkeypatch.setattr(fleet, "PROBE", "''")
    with pytest.raises(InputError, match="lack microstage_ros") as told:
        list(fleet.on_cluster([2], half, scheduler))
    assert "\n" not in str(told.value)


def test_another_version_is_told(scheduler, monkeypatch):
    monkeypatch.setattr(fleet, "PROBE", "'0.0.1'")
    with pytest.raises(InputError, match="0.0.1"):
        list(fleet.on_cluster([2], half, scheduler))


def test_no_scheduler_is_told(monkeypatch):
    monkeypatch.setattr(fleet, "PATIENCE", "1s")
    with pytest.raises(InputError, match="running Dask scheduler"):
        list(fleet.on_cluster([2], half, "tcp://127.0.0.1:9"))


def test_relative_paths_become_absolute(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    case = Case("a", "axis.yaml", ("r.csv", "s3://bucket/r.csv"), (), (), "out").placed(fleet.absolute)
    assert case.axis == str(tmp_path / "axis.yaml") and case.records == (str(tmp_path / "r.csv"), "s3://bucket/r.csv")


def test_shipped_files_arrive(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "a.mcap").write_bytes(b"123")
    (tmp_path / "r.csv").write_bytes(b"45")
    shipment = fleet.ship("case", [str(tmp_path / "bag"), str(tmp_path / "r.csv")])
    local = fleet.unpacked(shipment, tmp_path / "there")
    import pathlib
    assert (pathlib.Path(local(str(tmp_path / "bag"))) / "a.mcap").read_bytes() == b"123"
    assert pathlib.Path(local(str(tmp_path / "r.csv"))).read_bytes() == b"45"


def test_an_address_is_read_where_it_lies(tmp_path):
    pytest.importorskip("aiohttp")
    (tmp_path / "r.csv").write_bytes(b"t_s\n")
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(tmp_path))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        with fleet.reached(f"http://127.0.0.1:{server.server_port}/r.csv") as place, open(place, "rb") as file:
            assert file.read() == b"t_s\n"
    finally:
        server.shutdown()


def test_a_memory_address_is_read():
    import fsspec
    fsspec.filesystem("memory").pipe("/x/r.csv", b"abc")
    with fleet.reached("memory://x/r.csv") as place, open(place, "rb") as file:
        assert file.read() == b"abc" and place.endswith("r.csv")
    with pytest.raises(InputError), fleet.reached("memory://x/none.csv"):
        pass
