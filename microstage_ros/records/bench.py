"""How fast records are read and written, each figure beside a peer on the same messages in the same run."""

import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars

from microstage_ros.records.bags.bag_reader import read_bag
from microstage_ros.records.bags.bag_record import own_definition
from microstage_ros.records.bags.bag_writer import BagWriter
from microstage_ros.records.bags.layout import layout_of_type
from microstage_ros.records.csv_file import read_csv, write_csv
from microstage_ros.records.record import Record

TOPIC = "/axis/state"
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 100_000
REPEATS = 3


class Figure(NamedTuple):
    """A measured figure, and the same of a peer."""

    name: str
    value: float
    unit: str
    peer: str
    peer_value: float


def bench(messages=200_000, seed=1):
    """All figures, each beside a peer on the same messages.

    Parameters
    ----------
    messages : how many [1], for us and for the peers alike.
    seed : of the simulated signals [1].

    Returns
    -------
    list of `Figure`; every time is the best of `REPEATS`, the peers' too.
    """
    rows, times = servo_messages(messages, seed)
    with tempfile.TemporaryDirectory(prefix="microstage-bench-") as folder:
        bag = Path(folder) / "bag"
        return [
            *bench_writing(rows, times, bag),
            *bench_reading(messages, bag),
            *bench_csv(rows, Path(folder) / "record.csv"),
        ]


def servo_messages(count, seed):
    """AxisState messages of a moving, noisy axis: uint8 (count, size), and their log times (count,) [ns].

    ``count`` and ``seed`` [1].
    """
    layout = layout_of_type(own_definition("AxisState"))
    rows = np.tile(np.frombuffer(layout.blank(), np.uint8), (count, 1))
    seen, generator = rows.reshape(-1).view(layout.dtype), np.random.default_rng(seed)
    times = START_NS + PERIOD_NS * np.arange(count)
    seen["header.stamp.sec"], seen["header.stamp.nanosec"] = times // 10**9, times % 10**9
    seen["sequence"] = np.arange(count)
    seen["position"] = (
        np.round((1e-3 * np.sin(seen["sequence"] * 1e-4) + generator.normal(0, 8e-9, count)) / 25e-9) * 25e-9
    )
    seen["applied_voltage"] = 0.5 * np.cos(seen["sequence"] * 1e-4) + generator.normal(0, 1e-3, count)
    seen["current"], seen["motor_angle"] = seen["applied_voltage"] / 3.41, np.nan
    return rows, times


def bench_writing(rows, times, folder):
    """Messages per second: one by one, in blocks, and the writer of the `mcap` package. Leaves a bag in ``folder``.

    ``rows``: messages, uint8 (n, size); ``times`` (n,) [ns].
    """
    definition = own_definition("AxisState")
    raw, stamps, number = [row.tobytes() for row in rows], times.tolist(), iter(range(10**9))

    def fresh():
        return Path(f"{folder}-{next(number)}")

    def one_by_one():
        with BagWriter(fresh()) as bag:
            channel = bag.add_channel(TOPIC, definition)
            for payload, stamp in zip(raw, stamps):
                bag.write(channel, stamp, payload)

    def blocks(path):
        with BagWriter(path) as bag:
            bag.write_block(bag.add_channel(TOPIC, definition), times, rows)

    single, block = _best(one_by_one), _best(lambda: blocks(fresh()))
    blocks(folder)
    peer = len(rows) / _best(lambda: _write_with_mcap(raw, stamps, f"{fresh()}.mcap", definition))
    size = next(folder.glob("*.mcap")).stat().st_size / len(rows)
    return [Figure("writing, one by one", len(rows) / single, "messages/s", "mcap", peer),
            Figure("writing, in blocks", len(rows) / block, "messages/s", "mcap", peer),
            Figure("size on disk", size, "bytes/message", "payload", float(rows.shape[1]))]


def bench_reading(messages, folder):
    """Seconds for the bag's ``messages`` [1] into arrays, against two readers that only decode them."""
    name = f"reading {messages} messages"
    ours = _best(lambda: read_bag(folder))
    return [Figure(name, ours, "s", "rosbags", _best(lambda: _read_with_rosbags(folder))),
            Figure(name, ours, "s", "mcap-ros2-support", _best(lambda: _read_with_mcap(folder)))]


def bench_csv(rows, path):
    """Rows per second from a CSV file of five columns, against bare polars (the fastest reader at hand, which checks
    nothing) and `numpy.loadtxt`. ``rows``: messages, uint8 (n, size)."""
    layout = layout_of_type(own_definition("AxisState"))
    seen = rows.reshape(-1).view(layout.dtype)
    write_csv(Record(PERIOD_NS * 1e-9, {"encoder_m": seen["position"], "reference_m": seen["position"],
                                        "voltage_V": seen["applied_voltage"], "current_A": seen["current"]}), path)
    ours = len(seen) / _best(lambda: read_csv(path))
    peers = {"polars.read_csv": lambda: polars.read_csv(path, comment_prefix="#"),
             "numpy.loadtxt": lambda: np.loadtxt(path, delimiter=",", skiprows=2)}
    return [Figure("reading CSV", ours, "rows/s", name, len(seen) / _best(read)) for name, read in peers.items()]


def _best(work):
    """Shortest wall time of `REPEATS` calls [s]."""
    return min(_seconds(work) for _ in range(REPEATS))


def _seconds(work):
    """Wall time of a call [s]."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def _write_with_mcap(raw, stamps, path, definition):
    from mcap.writer import Writer
    writer = Writer(path)
    writer.start("ros2", "bench")
    channel = writer.register_channel(TOPIC, "cdr", writer.register_schema(definition.name, "ros2msg",
                                                                         definition.text.encode()))
    for payload, stamp in zip(raw, stamps):
        writer.add_message(channel, stamp, payload, stamp)
    writer.finish()


def _read_with_rosbags(folder):
    from rosbags.highlevel import AnyReader
    with AnyReader([folder]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)


def _read_with_mcap(folder):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory
    with open(next(folder.glob("*.mcap")), "rb") as stream:
        for _ in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            pass
