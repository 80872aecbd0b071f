"""Files of every kind, truncated, bit-flipped and with bad values in them: read or refused in one line, quickly.

Truncated and flipped files may still be good (a flipped bit in a comment); those count as read. Of a bag every such
change in a chunk is found by its checksum, and what is left of it is made whole. Files with a bad value, or with a part
that is no YAML, have to be refused.
"""

import random
import re
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.context import Context

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.runs.run_file import load_run
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.bag_reader import Bag
from microstage_ros.records.bags.bag_writer import BagWriter
from microstage_ros.records.bags.definition import installed_definition
from microstage_ros.records.bags.recovery import recover
from microstage_ros.records.csv_file import read_csv
from microstage_ros.records.logs.description import load_description
from microstage_ros.records.logs.log import read_log
from microstage_ros.ros.launching.parameters import Parameters
from microstage_ros.ros.launching.process import started
from microstage_ros.ros.transport.codec import Codec

LONGEST_S = 1.0
MESSAGES = 3000
RUN = """controller: {type: pid}
noise: {encoder_m: 1.0e-8}
program:
  - {move_to_m: 1.0e-5, dwell_s: 0.05}
  - {sine: {amplitude_m: 1.0e-4, frequency_hz: 2.0, cycles: 3}, dwell_s: 0.1}
  - {scan: {to_m: 1.0e-3, speed_m_s: 5.0e-4}}
"""
LOG = "time: {column: t, unit: s}\nposition: {column: x, unit: mm}\ncurrent: {column: i, unit: A}\n"
PARAMETERS = (
    "/**:\n  ros__parameters:\n    window: 100\n    idle_window: 1000\n    driver_timeout_s: 5.0\n    max_velocity:"
    " 0.004\n"
)
BAD_VALUES = (
    ".nan",
    ".inf",
    "-.inf",
    "1e999",
    "heavy",
    "[1, 2]",
    "{}",
    "12:30:45",
    "2020-13-45",
    "!!python/object:x {}",
    "&a [*a]",
    "9" * 5000,
    "[" * 3000,
)
"""In the place of a number: never a number."""

WRONG_SHARE = 0.4

BAD_CELLS = ("inf", "abc", "1,2", "1e999", "\0", "--1", "0x10")


def _csv_text(rows=400):
    return "t_s,encoder_m,reference_m,voltage_V\n" + "".join(
        f"{k * 1e-4:.4f},{1e-9 * k:.3e},0,0.5\n" for k in range(rows)
    )


def _table_text(rows=400):
    return "t,x,i\n" + "".join(
        f"{0.01 * k:.3f},{np.sin(0.01 * k):.6f},{0.3 * np.cos(0.01 * k):.6f}\n" for k in range(rows)
    )


def _read_log(path):
    description = path.parent / "LOG.yaml"
    description.write_text(LOG, encoding="utf-8")
    read_log(path, load_description(description))


def _read_axis(path):
    """With the controllers that are in it: their gains are looked at when they are made."""
    axis = load_axis(path)
    for law in {
        axis.controller.get("type", "self_tuning"),
        *(name for name, gains in axis.controller.items() if isinstance(gains, dict)),
    }:
        make_controller(law, axis)


def _read_parameters(path):
    """As a node reads it when it starts."""
    context = Context()
    try:
        started(["--ros-args", "--params-file", str(path)], context)
        node = rclpy.create_node(
            "move_server", namespace="/files", context=context, start_parameter_services=False, enable_rosout=False
        )
        try:
            Parameters(node, "move_server")
        finally:
            node.destroy_node()
    finally:
        context.try_shutdown()


KINDS = {
    "axis": (".yaml", lambda: config_file("axis.yaml").read_text(encoding="utf-8"), _read_axis),
    "run": (".yaml", lambda: RUN, lambda path: load_run(path).tables(1e-4)),
    "log_description": (".yaml", lambda: LOG, load_description),
    "parameters": (".yaml", lambda: PARAMETERS, _read_parameters),
    "csv": (".csv", _csv_text, read_csv),
    "log": (".csv", _table_text, _read_log),
}
"""Kind of text file to its ending, a good one, and what reads it."""

SHARE = {"axis": 0.1, "run": 0.1, "log_description": 0.2, "parameters": 0.1, "csv": 0.2, "log": 0.2, "bag": 0.1}
"""Of the files."""

TOLERANT = ("log",)
"""Logs of other machines have gaps and text between their numbers: what cannot be read counts as missing."""


def damage_files(count, seed, tell=lambda kind, facts: None):
    """Damage ``count`` files [1] of all kinds and read each; facts by kind.

    ``seed``: of the damage [1]; ``tell``: called after each kind.
    """
    found = {}
    for kind, share in SHARE.items():
        number = round(share * count)
        found[kind] = damage_bags(number, seed) if kind == "bag" else damage_texts(kind, number, seed)
        tell(kind, found[kind])
    return found


def damage_texts(kind, count, seed):
    """Damage a text file ``count`` times [1] and read it; the facts as plain data. ``seed``: of the damage [1]."""
    chance, (ending, text, read) = random.Random(f"{kind} {seed}"), KINDS[kind]
    facts = {
        "files": count,
        "read": 0,
        "refused": 0,
        "bad_values": 0,
        "bad_values_accepted": 0,
        "longest_s": 0.0,
        "fell_short": "",
    }
    whole = text().encode()
    with tempfile.TemporaryDirectory(prefix="microstage_files_") as folder:
        path = Path(folder) / f"bad{ending}"
        path.write_bytes(whole)
        read(path)  # the good one is read
        for k in range(count):
            wrong = chance.random() < WRONG_SHARE
            raw = _with_bad_value(whole, chance, ending) if wrong else _damaged(whole, chance)
            path.write_bytes(raw)
            facts["bad_values"] += wrong
            began = time.monotonic()
            try:
                read(path)
                facts["read"] += 1
                if wrong and kind not in TOLERANT:
                    facts["bad_values_accepted"] += 1
                    facts["fell_short"] = (
                        facts["fell_short"] or f"file {k} of seed {seed} was accepted: {_difference(whole, raw)}"
                    )
            except InputError as error:
                facts["refused"] += 1
                if "\n" in str(error):
                    facts["fell_short"] = f"file {k} of seed {seed}: more than a line"
            except Exception as error:  # noqa: BLE001 - exactly this must not happen
                facts["fell_short"] = (
                    f"file {k} of seed {seed}: {type(error).__name__}: {error}: {_difference(whole, raw)}"[:400]
                )
            _note_time(facts, began)
    return _judged(facts)


def _note_time(facts, began):
    took = time.monotonic() - began
    if took > facts["longest_s"]:
        facts["longest_s"] = round(took, 4)


def _judged(facts):
    if facts["longest_s"] > LONGEST_S:
        facts["fell_short"] = facts["fell_short"] or f"{facts['longest_s']:.2f} s for one file"
    return facts


def _difference(whole, raw):
    first = next((k for k, (a, b) in enumerate(zip(whole, raw)) if a != b), min(len(whole), len(raw)))
    return repr(raw[max(first - 30, 0) : first + 50])[:200]


def _with_bad_value(whole, chance, ending):
    """One number replaced by what is none."""
    text = whole.decode()
    if ending == ".csv":
        lines = text.splitlines()
        number = chance.randrange(1, len(lines))
        cells = lines[number].split(",")
        cells[chance.randrange(len(cells))] = chance.choice(BAD_CELLS)
        lines[number] = ",".join(cells)
        return "\n".join(lines).encode()
    places = [
        match
        for match in re.finditer(r"(?<=[:] )-?\d[\d.]*(?:[eE][-+]?\d+)?(?=[,}\n])", text)
        if not _in_comment(text, match.start())
    ]
    if not places:  # a file without numbers: one of its words
        places = list(re.finditer(r"(?<=unit: )\w+", text))
        at = chance.choice(places)
        return (
            text[: at.start()] + chance.choice(("furlong", ".nan", "[1, 2]", "{}", "~")) + text[at.end() :]
        ).encode()
    at = chance.choice(places)
    return (text[: at.start()] + chance.choice(BAD_VALUES) + text[at.end() :]).encode()


def _in_comment(text, place):
    line = text[text.rfind("\n", 0, place) + 1 : place]
    return "#" in line or "stderr" in line.rsplit(",", 1)[-1] or "'" in line or '"' in line


def _damaged(whole, chance):
    raw = bytearray(whole)
    kind = chance.randrange(4)
    if kind == 0:
        return bytes(raw[: chance.randrange(len(raw))])
    if kind == 1:  # a stretch twice, or somewhere else
        first = chance.randrange(len(raw))
        part = raw[first : first + chance.randrange(200)]
        place = chance.randrange(len(raw))
        return bytes(raw[:place] + part + raw[place:])
    for _ in range(chance.choice((1, 1, 8, 64))):
        raw[chance.randrange(len(raw))] ^= 1 << chance.randrange(8)
    return bytes(raw)


def damage_bags(count, seed):
    """Damage a bag ``count`` times [1], read and recover each; the facts as plain data. ``seed``: of the damage [1]."""
    chance = random.Random(seed)
    facts = {
        "files": count,
        "read": 0,
        "refused": 0,
        "recovered": 0,
        "messages_kept": 0,
        "longest_s": 0.0,
        "fell_short": "",
    }
    with tempfile.TemporaryDirectory(prefix="microstage_files_") as folder:
        good = Path(folder) / "good.mcap"
        _good_bag(good)
        whole = good.read_bytes()
        for k in range(count):
            bad = Path(folder) / f"bad{k}.mcap"
            bad.write_bytes(_damaged(whole, chance))
            began = time.monotonic()
            try:
                _examine(bad, facts)
            except Exception as error:  # noqa: BLE001 - exactly this must not happen
                facts["fell_short"] = f"file {k} of seed {seed}: {type(error).__name__}: {error}"[:300]
            _note_time(facts, began)
            for path in Path(folder).glob("bad*"):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
    return _judged(facts)


def _good_bag(path):
    codec = Codec("VoltageCommand")
    rows = codec.blank(np.arange(MESSAGES) * 1_000_000)
    rows["sequence"] = np.arange(MESSAGES)
    with BagWriter(path) as bag:
        channel = bag.add_channel("/axis/command", installed_definition("microstage_msgs/msg/VoltageCommand"))
        for first in range(0, MESSAGES, 500):
            part = rows[first : first + 500]
            bag.write_block(
                channel, np.arange(first, first + len(part)) * 1_000_000, part.view(np.uint8).reshape(len(part), -1)
            )
            bag.flush()


def _examine(path, facts):
    try:
        bag = Bag(path)
        sum(1 for _ in bag.raw_messages(list(bag.topics)))
        facts["read"] += 1
    except InputError:
        facts["refused"] += 1
    try:
        kept = recover(path)
    except InputError:
        return
    facts["recovered"] += 1
    facts["messages_kept"] += kept[0].messages
    again = Bag(path)
    if sum(1 for _ in again.raw_messages(list(again.topics))) != kept[0].messages:
        raise ValueError("a recovered bag does not hold what was reported")
