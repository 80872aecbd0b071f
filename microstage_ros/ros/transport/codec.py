"""Fixed-layout messages of the servo path: bytes to a tuple and back, no ROS object in between.

A message begins with `ServoHeader` and holds no string, so every field has one place for good
(`records.bags.layout`), and a message is one `struct`.
"""

import struct

import numpy as np

from microstage_ros.records.bags.definition import installed_definition
from microstage_ros.records.bags.layout import layout_of_type

CODES = {"?": "?", "u1": "B", "i1": "b", "u2": "H", "i2": "h", "u4": "I", "i4": "i", "u8": "Q", "i8": "q", "f4": "f",
         "f8": "d"}
STAMP = struct.Struct("<iI")
STAMP_AT, STAMP_END = 4, 12
ENCAPSULATION = b"\x00\x01\x00\x00"


class Codec:
    """Packs and unpacks one message type.

    Parameters
    ----------
    type_name : such as ``AxisState`` (package ``microstage_msgs``).

    Attributes
    ----------
    names : fields after the header, in the order of `pack` and `unpack`; an array field counts as one.
    size : bytes of a message. dtype : of one message in numpy, names as in `records.bags.layout`.
    """

    def __init__(self, type_name):
        layout = layout_of_type(installed_definition(f"microstage_msgs/msg/{type_name}"))
        self.size, self.dtype = layout.size, layout.dtype
        fields = sorted((offset, name, kind) for name, (kind, offset) in layout.dtype.fields.items()
                        if not name.startswith("header."))
        self.names = tuple(name for _, name, _ in fields)
        code, at = "", STAMP_END
        for offset, _, kind in fields:
            base, shape = kind.subdtype or (kind, ())
            count = shape[0] if shape else 1
            code += f"{offset - at}x{count}{CODES[base.str[1:] if base.kind != 'b' else '?']}"
            at = offset + base.itemsize * count
        self._pack = struct.Struct("<4s8s" + code).pack
        self.unpack_from = struct.Struct("<" + code).unpack_from

    def pack(self, time_ns, *values):
        """CDR bytes of one message stamped ``time_ns`` [ns]; array fields are spread out."""
        return self._pack(ENCAPSULATION, STAMP.pack(*divmod(time_ns, 1_000_000_000)), *values)

    def pack_as(self, stamped, *values):
        """CDR bytes of one message with the stamp of the message ``stamped`` (bytes)."""
        return self._pack(ENCAPSULATION, stamped[STAMP_AT:STAMP_END], *values)

    def unpack(self, raw):
        """The values after the header, arrays spread out."""
        return self.unpack_from(raw, STAMP_END)

    def array(self, rows):
        """Messages as a structured array, shape (n,).

        Parameters
        ----------
        rows : CDR bytes, uint8, shape (n, size or more).
        """
        return np.ascontiguousarray(rows[:, :self.size]).view(self.dtype)[:, 0]


    def blank(self, times_ns):
        """Messages with these stamps [ns], all else 0, as `array` gives them."""
        rows = np.zeros((len(times_ns), self.size), np.uint8)
        rows[:, :STAMP_AT] = np.frombuffer(ENCAPSULATION, np.uint8)
        messages = rows.view(self.dtype)[:, 0]
        messages["header.stamp.sec"], messages["header.stamp.nanosec"] = np.divmod(times_ns, 1_000_000_000)
        return messages


def stamp_ns(raw):
    """Stamp of a message that begins with a header [ns]."""
    sec, nanosec = STAMP.unpack_from(raw, STAMP_AT)
    return sec * 1_000_000_000 + nanosec


def stamps_ns(messages):
    """Stamps [ns] of messages (`Codec.array`), int64 of shape (n,)."""
    return messages["header.stamp.sec"].astype(np.int64) * 1_000_000_000 + messages["header.stamp.nanosec"]
