"""CSV records: what is written comes back, and every defect is told with its place."""

import gzip
import lzma

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from microstage_ros.quantities.errors import InputError
from microstage_ros.records import Record, compression, csv_text, read_record, write_record
from microstage_ros.records.columns import KNOWN_COLUMNS

HEADER = "t_s,encoder_m,reference_m,voltage_V\n"
ROWS = ["0.0,0,0,0.5", "0.1,1e-6,2e-6,0.25", "0.2,2e-6,3e-6,-0.5", "0.3,3e-6,4e-6,1"]


@pytest.fixture(params=["polars", "numpy"], autouse=True)
def text_by(request, monkeypatch):
    """Every test with polars and, as on a machine that lacks it, without."""
    if request.param == "numpy":
        monkeypatch.setattr(csv_text, "polars_or_none", lambda: None)


def small_record(rows=50, period_s=1e-4):
    """A record with every known column."""
    generator = np.random.default_rng(5)
    columns = {name: generator.normal(size=rows) for name in KNOWN_COLUMNS if name != "t_s"}
    columns["encoder_m"][3] = np.nan
    return Record(period_s, columns, metadata={"seed": 7, "configuration": {"axis": "a: b"}})


def written(tmp_path, text, name="r.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_record(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".csv.xz"])
def test_what_is_written_comes_back(tmp_path, suffix):
    record = small_record()
    path = tmp_path / f"record{suffix}"
    write_record(record, path)
    back = read_record(path)
    assert back.period_s == record.period_s
    assert list(back.columns) == list(KNOWN_COLUMNS)
    for name, column in KNOWN_COLUMNS.items():
        np.testing.assert_allclose(back[name], record[name], rtol=0, atol=0.6 * 10.0**-column.decimals)
    assert back.metadata["seed"] == 7
    assert back.metadata["configuration"] == {"axis": "a: b"}
    assert back.metadata["microstage_ros"]


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".csv.xz"])
def test_same_record_same_bytes(tmp_path, suffix):
    for name in ("a", "b"):
        write_record(small_record(), tmp_path / f"{name}{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=st.lists(st.floats(-1e3, 1e3) | st.just(np.nan), min_size=2, max_size=20),
       period_s=st.sampled_from([1e-4, 1e-3, 1 / 1024, 0.5]))
def test_any_values_and_period_survive(tmp_path_factory, values, period_s):
    path = tmp_path_factory.mktemp("any") / "r.csv"
    zeros = np.zeros(len(values))
    write_record(Record(period_s, {"encoder_m": values, "reference_m": zeros, "force_N": zeros}), path)
    back = read_record(path)
    assert back.period_s == pytest.approx(period_s, rel=1e-9)
    np.testing.assert_allclose(back["encoder_m"], values, rtol=3e-16, atol=6e-14)


def test_comments_and_line_ends_and_missing_samples(tmp_path):
    rows = [*ROWS[:2], "# a remark in between, with a comma", "0.2,,3e-6,-0.5", ROWS[3]]
    text = "# seed: 4\r\n# note: plain words\r\n" + HEADER.replace("\n", "\r\n") + "\r\n".join(rows) + "\r\n\r\n"
    record = read_record(written(tmp_path, text))
    assert record.metadata == {"seed": 4, "note": "plain words"}
    assert np.isnan(record["encoder_m"][2]) and len(record) == 4
    assert record.period_s == 0.1


@pytest.mark.parametrize("decimals", [4, 5, 10])
def test_period_is_found_from_printed_times(tmp_path, decimals):
    rows = [f"{n * 1e-4:.{decimals}f},0,0,0" for n in range(30_000)]
    assert read_record(written(tmp_path, HEADER + "\n".join(rows))).period_s == 1e-4


DEFECTS = {
    "gap": (HEADER + "\n".join([*ROWS, "0.9,0,0,0"]), ["line 6", "t_s", "0.9", "5 rows are missing"]),
    "backwards": (HEADER + "\n".join([*ROWS, "0.2,0,0,0"]), ["line 6", "0.2", "constant steps"]),
    "still": (HEADER + "\n".join(["0,0,0,0"] * 4), ["line 3", "later than"]),
    "no time": (HEADER + "\n".join([*ROWS, ",0,0,0"]), ["line 6", "t_s", "in every row"]),
    "twice": ("t_s,encoder_m,encoder_m,voltage_V\n" + "\n".join(ROWS), ["encoder_m", "every column once"]),
    "no number": (HEADER + "\n".join([ROWS[0], "# c", "0.1,1e-6,1.2.3,0"]), ["line 4", "reference_m", "1.2.3"]),
    "infinite": (HEADER + "\n".join([*ROWS, "0.4,0,0,inf"]), ["line 6", "voltage_V", "finite"]),
    "short row": (HEADER + "\n".join([*ROWS, "0.4,0"]), ["line 6", "4 fields, 2 found"]),
    "moved comma": (HEADER + "0,0,0,0,0\n0.1,0,0\n0.2,0,0,0", ["line 2", "5 found"]),
    "blank row": (HEADER + "\n".join([*ROWS[:2], "", *ROWS[2:]]), ["line 4", "4 fields"]),
    "unknown": ("t_s,encoder_m,reference_m,volts\n" + ROWS[0], ["volts", "voltage_V"]),
    "no command": ("t_s,encoder_m,reference_m\n0,0,0\n1,0,0", ["voltage_V or force_N"]),
    "no encoder": ("t_s,reference_m,voltage_V\n0,0,0\n1,0,0", ["column encoder_m"]),
    "no header": ("\n".join(ROWS), ["names of the columns"]),
    "semicolons": (HEADER.replace(",", ";") + "0;0;0;0", ["separated by commas"]),
    "one row": (HEADER + ROWS[0], ["at least 2 rows"]),
    "header only": (HEADER, ["at least 2 rows"]),
    "comments only": ("# nothing\n", ["a header line"]),
    "empty": ("", ["empty file"]),
}


@pytest.mark.parametrize("defect", DEFECTS)
def test_defects_are_told_with_their_place(tmp_path, defect):
    text, told = DEFECTS[defect]
    message = refusal(written(tmp_path, text))
    assert "r.csv" in message
    for words in told:
        assert words in message


def test_compression_other_than_the_name_says(tmp_path):
    text = (HEADER + "\n".join(ROWS)).encode()
    for name, raw, told in [("a.csv.gz", lzma.compress(text), "xz bytes"), ("a.csv", gzip.compress(text), "gz bytes"),
                            ("a.csv.xz", text, "plain text"), ("a.csv.gz", gzip.compress(text)[:-9], "a whole gz"),
                            ("a.csv.xz", lzma.compress(text)[:-20], "a whole xz"), ("a.csv", b"\x89MCAP0", "MCAP")]:
        (tmp_path / name).write_bytes(raw)
        assert told in refusal(tmp_path / name)


@pytest.mark.parametrize("suffix", [".gz", ".xz"])
def test_a_small_file_that_unpacks_to_much_is_refused(tmp_path, suffix, monkeypatch):
    monkeypatch.setattr(compression, "LARGEST", 1 << 20)
    monkeypatch.setattr(compression, "PIECE", 1 << 16)
    pack = {".gz": gzip.compress, ".xz": lzma.compress}[suffix]
    (tmp_path / f"a.csv{suffix}").write_bytes(pack(HEADER.encode() + b"0" * (1 << 22)))
    assert "at most 1048576 bytes" in refusal(tmp_path / f"a.csv{suffix}")


def test_other_files_are_refused(tmp_path):
    assert "file not found" in refusal(tmp_path / "nowhere.csv")
    assert ".csv.xz" in refusal(written(tmp_path, "x", "record.txt"))
    with pytest.raises(InputError, match="that can be written"):
        write_record(small_record(), written(tmp_path, "x", "file") / "r.csv")


def test_record_refuses_what_does_not_fit():
    with pytest.raises(InputError, match="one of t_s"):
        Record(1e-4, {"voltage": [0, 1]})
    with pytest.raises(InputError, match="same length"):
        Record(1e-4, {"encoder_m": [0, 1], "voltage_V": [0]})
    with pytest.raises(InputError, match="above 0 s"):
        Record(0.0, {"encoder_m": [0, 1]})


def test_rows_and_missing_columns():
    record = small_record()
    part = record.rows(10, 20)
    assert len(part) == 10 and part["t_s"][0] == record["t_s"][10]
    bare = Record(1.0, {"encoder_m": [1, 2], "current_A": [np.nan, np.nan]})
    assert "current_A" not in bare and "voltage_V" not in bare
    with pytest.raises(InputError, match="voltage_V"):
        bare["voltage_V"]


def test_no_damage_ends_in_anything_but_input_error(tmp_path):
    """Bytes changed anywhere: the file is read, or refused in one line; never another exception."""
    write_record(small_record(rows=30), tmp_path / "whole.csv")
    whole, generator, refused = (tmp_path / "whole.csv").read_bytes(), np.random.default_rng(3), 0
    for suffix, pack in (("csv", bytes), ("csv.gz", gzip.compress), ("csv.xz", lzma.compress)):
        packed = pack(whole)
        for _ in range(100):
            raw = bytearray(packed)
            for place in generator.integers(0, len(raw), size=generator.choice([1, 2, 10])):
                raw[place] = generator.choice([0, 10, 34, 44, 255, generator.integers(0, 256)])
            (tmp_path / f"bad.{suffix}").write_bytes(raw)
            try:
                read_record(tmp_path / f"bad.{suffix}")
            except InputError as error:
                refused += 1
                assert "\n" not in str(error)
    assert refused > 150
