"""The index of chunks kept out of memory: the same entries come back, in order, wherever they lie."""

import pytest

from microstage_ros.records.bags import chunk_log
from microstage_ros.records.bags.chunk_log import TOGETHER, ChunkLog


@pytest.mark.parametrize("writable", [True, False])
def test_entries_come_back_in_order(monkeypatch, writable):
    if not writable:
        def full(**_):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(chunk_log.tempfile, "TemporaryFile", full)
    log, expected = ChunkLog(), []
    for k in range(3 * TOGETHER + 5):
        expected.append((bytes([k % 251]) * (1 + k % 7), [k, [[1, k]], None]))
        log.append(*expected[-1])
    assert len(log._recent) == (5 if writable else len(expected))
    assert log.records() == b"".join(record for record, _ in expected)
    for _ in range(TOGETHER + 20):  # beyond what is still in memory
        assert log.pop() == expected.pop()[1]
    log.append(b"x", [1])
    assert log.records() == b"".join(record for record, _ in expected) + b"x" and len(log) == len(expected) + 1
    log.close()
