"""The index of the chunks of a bag that is being written, kept out of memory: a bag of hours has a hundred thousand of
them.

One entry per chunk: its record for the closing part, ready to be written, and what has to be known to take the chunk
back when the disk is full. Entries wait in memory up to `TOGETHER` and then go to a nameless temporary file; where that
cannot be written, they stay in memory.
"""

import json
import struct
import tempfile

TOGETHER = 256
_TAIL = struct.Struct("<II")


class ChunkLog:
    """Entries (record, facts) in the order of writing; ``facts``: plain data."""

    def __init__(self):
        self._file, self._recent, self._length = None, [], 0

    def __len__(self):
        return self._length

    def append(self, record, facts):
        """Add an entry."""
        self._recent.append((record, facts))
        self._length += 1
        if len(self._recent) % TOGETHER == 0:
            self._spill()

    def _spill(self):
        """Move what waits in memory to the file, if it takes it."""
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(prefix="microstage_chunks_")
            end = self._file.seek(0, 2)
            try:
                self._file.write(b"".join(map(_packed, self._recent)))
                self._file.flush()
            except OSError:
                self._file.truncate(end)
                raise
        except OSError:  # no room there either: memory has it
            return
        self._recent.clear()

    def pop(self):
        """Remove the last entry; its facts."""
        self._length -= 1
        if self._recent or self._file is None:
            return self._recent.pop()[1]
        end = self._file.seek(-_TAIL.size, 2) + _TAIL.size
        record, facts = _TAIL.unpack(self._file.read(_TAIL.size))
        begin = end - _TAIL.size - facts - record
        self._file.seek(begin + record)
        found = json.loads(self._file.read(facts))
        self._file.truncate(begin)
        return found

    def records(self):
        """All records, one after the other, as bytes."""
        parts, raw = [], b""
        if self._file is not None:
            self._file.seek(0)
            raw = self._file.read()
        place = len(raw)
        while place:
            record, facts = _TAIL.unpack_from(raw, place - _TAIL.size)
            place -= _TAIL.size + facts + record
            parts.append(raw[place:place + record])
        return b"".join([*reversed(parts), *(record for record, _ in self._recent)])

    def close(self):
        """Let go of the temporary file."""
        if self._file is not None:
            self._file.close()
            self._file = None


def _packed(entry):
    record, facts = entry[0], json.dumps(entry[1]).encode()
    return record + facts + _TAIL.pack(len(record), len(facts))
