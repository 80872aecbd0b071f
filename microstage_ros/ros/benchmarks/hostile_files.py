"""Bags truncated and bit-flipped: each is read or refused in one line, quickly, and recovered where that can be."""

import random
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.bag_reader import Bag
from microstage_ros.records.bags.bag_writer import BagWriter
from microstage_ros.records.bags.definition import installed_definition
from microstage_ros.records.bags.recovery import recover
from microstage_ros.ros.transport.codec import Codec

LONGEST_S = 1.0
MESSAGES = 3000


def _good_bag(path):
    codec = Codec("VoltageCommand")
    rows = codec.blank(np.arange(MESSAGES) * 1_000_000)
    rows["sequence"] = np.arange(MESSAGES)
    with BagWriter(path) as bag:
        channel = bag.add_channel("/axis/command", installed_definition("microstage_msgs/msg/VoltageCommand"))
        for first in range(0, MESSAGES, 500):
            part = rows[first:first + 500]
            bag.write_block(channel, np.arange(first, first + len(part)) * 1_000_000, part.view(np.uint8).reshape(len(part), -1))
            bag.flush()


def damage_bags(count, seed):
    """Damage a bag ``count`` times, read and recover each; the facts as plain data."""
    chance = random.Random(seed)
    facts = {"files": count, "read": 0, "refused": 0, "recovered": 0, "messages_kept": 0, "longest_s": 0.0, "fell_short": ""}
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
            facts["longest_s"] = max(facts["longest_s"], time.monotonic() - began)
            for path in Path(folder).glob("bad*"):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
    if facts["longest_s"] > LONGEST_S:
        facts["fell_short"] = facts["fell_short"] or f"{facts['longest_s']:.2f} s for one file"
    return facts


def _damaged(whole, chance):
    raw = bytearray(whole)
    if chance.random() < 0.5:
        return bytes(raw[:chance.randrange(len(raw))])
    for _ in range(chance.choice((1, 1, 8, 64))):
        raw[chance.randrange(len(raw))] ^= 1 << chance.randrange(8)
    return bytes(raw)


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
        raise ValueError("a recovered bag does not hold what was told")
