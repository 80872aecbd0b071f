"""Where each field lies in the bytes of a message, as a numpy dtype.

ROS messages travel as XCDR1: four bytes that tell the byte order, then every value on a multiple
of its own size, counted from after those four; a string is a uint32 length (with its final zero),
its bytes and a zero; a sequence is a uint32 count and its elements (OMG DDS-XTypes 1.3, 7.4).
Where the lengths of all strings and sequences stay the same from message to message, every field
has one place for good, and a million messages are one numpy array.  The same layout writes
messages: take `blank()`, put the values in their places, send the bytes.
"""

import struct
from dataclasses import dataclass

import numpy as np

from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.definition import PRIMITIVES

ENCAPSULATION = 4
BYTE_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}
LARGEST = 16 << 20
"""More elements than this in one message are a damaged length, not data."""


class NoFixedLayout(ValueError):
    """The message holds something that has no fixed place (wide strings)."""


@dataclass(frozen=True)
class Layout:
    """Fixed places of all fields of one message type.

    Attributes
    ----------
    dtype : one item is one message, encapsulation included; names are dotted paths such as
        `header.stamp.sec`, an array field has a shape, a string is bytes without its final zero.
    lengths : (offset, count) of every length word; two messages have the same layout if these agree.
    byte_order : `<` or `>`.
    """

    dtype: np.dtype
    lengths: tuple
    byte_order: str

    @property
    def size(self):
        """Bytes of one message."""
        return self.dtype.itemsize

    def blank(self, **values):
        """A message as a bytearray: lengths in place, all values zero but those given.

        Dots in a field's name are written as two underscores: `header__frame_id=b"axis"`.
        """
        raw = bytearray(self.size)
        raw[:ENCAPSULATION] = b"\x00\x01\x00\x00" if self.byte_order == "<" else b"\x00\x00\x00\x00"
        for offset, count in self.lengths:
            struct.pack_into(self.byte_order + "I", raw, offset, count)
        message = np.frombuffer(raw, self.dtype, 1)
        for name, value in values.items():
            message[name.replace("__", ".")] = value
        return raw

    def fits(self, rows):
        """True where a message has this layout.

        Parameters
        ----------
        rows : messages, uint8 of shape (n, size).

        Returns
        -------
        bool array of shape (n,).
        """
        good = rows[:, :2].view(">u2")[:, 0] == (1 if self.byte_order == "<" else 0)
        for offset, count in self.lengths:
            good &= rows[:, offset:offset + 4].view(self.byte_order + "u4")[:, 0] == count
        return good


def layout_of_message(definition, raw):
    """The layout of `raw`, the bytes (size,) of one message of type `definition`; lengths are those that it has.

    Raises
    ------
    NoFixedLayout : wide strings.
    InputError : bytes that do not fit the definition.
    """
    raw = bytes(raw)
    if raw[:2] not in BYTE_ORDERS:
        raise InputError(f"message of type {definition.name}", raw[:4].hex(), "plain CDR bytes (00 00 or 00 01)")
    walk = _Walk(definition, BYTE_ORDERS[raw[:2]], raw=raw)
    walk.message(definition.fields, "")
    if walk.at > len(raw) or len(raw) - walk.at >= 8:
        raise InputError(f"message of type {definition.name}", f"{len(raw)} bytes", f"{walk.at} bytes")
    return walk.layout(len(raw))


def layout_of_type(definition, lengths=None):
    """The layout of a message type whose strings and sequences have the given lengths.

    Parameters
    ----------
    definition : `definition.Definition`.
    lengths : dotted path of a string or sequence to its number of characters or elements [1];
        those not given are empty.

    Raises
    ------
    NoFixedLayout : wide strings.
    """
    walk = _Walk(definition, "<", lengths=lengths or {})
    walk.message(definition.fields, "")
    return walk.layout(walk.at)


class _Walk:
    """Goes through a message type field by field and notes where each one lies."""

    def __init__(self, definition, byte_order, raw=None, lengths=None):
        self.types = definition.types
        self.name = definition.name
        self.byte_order = byte_order
        self.raw = raw
        self.given = lengths
        self.at = ENCAPSULATION
        self.fields = []
        self.lengths = []

    def layout(self, size):
        """What was noted, for messages of `size` bytes."""
        names, formats, offsets = (list(part) for part in zip(*self.fields)) if self.fields else ([], [], [])
        dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})
        return Layout(dtype, tuple(self.lengths), self.byte_order)

    def message(self, fields, prefix):
        """All fields of one message; an empty message still takes a byte."""
        if not fields:
            self.at += 1
        for field in fields:
            self.field(field, prefix + field.name)

    def field(self, field, path):
        """One field: a single value, a fixed array or a sequence."""
        if field.count is None:
            self.single(field.type, path)
            return
        count = field.count if field.count >= 0 else self.length(path)
        if field.type in PRIMITIVES:
            if count:
                self.note(path, field.type, count)
        else:
            for index in range(count):
                self.single(field.type, f"{path}.{index}")

    def single(self, kind, path):
        """One value, string or message."""
        if kind in PRIMITIVES:
            self.note(path, kind, None)
        elif kind == "string":
            count = self.length(path, ending=1)
            self.fields.append((path, f"S{max(count - 1, 0)}", self.at))
            self.at += count
        elif kind == "wstring":
            raise NoFixedLayout(f"{self.name}: {path} is a wide string")
        else:
            self.message(self.types[kind], path + ".")

    def note(self, path, kind, count):
        """A primitive or `count` of them, on a multiple of its size."""
        code = np.dtype(self.byte_order + PRIMITIVES[kind])
        self.align(code.itemsize)
        self.fields.append((path, code if count is None else (code, (count,)), self.at))
        self.at += code.itemsize * (1 if count is None else count)

    def align(self, size):
        """Move on to the next multiple of `size`, counted from after the encapsulation."""
        self.at += (ENCAPSULATION - self.at) % size

    def length(self, path, ending=0):
        """The length word at this place: from the message, or as given plus the string's final zero.

        Raises InputError: the length is negative or reaches beyond the message.
        """
        self.align(4)
        if self.raw is None:
            count = self.given.get(path, 0) + ending
        elif self.at + 4 > len(self.raw):
            raise InputError(f"message of type {self.name}", f"{len(self.raw)} bytes", f"more, for {path}")
        else:
            count = struct.unpack_from(self.byte_order + "I", self.raw, self.at)[0]
        if count > LARGEST or (self.raw is not None and count > len(self.raw)):
            raise InputError(f"message of type {self.name}: length of {path}", count,
                             "a length within the message")
        self.lengths.append((self.at, count))
        self.at += 4
        return count
