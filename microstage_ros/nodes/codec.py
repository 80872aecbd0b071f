"""Fixed-layout messages of the servo path: bytes to a tuple and back, no ROS object in between.

A message begins with `std_msgs/Header` and holds no other string. While the frame does not change, every
field has one place (`records.layout`), and the fields after the header are one `struct`.
"""

import struct

from microstage_ros.records.definition import installed_definition
from microstage_ros.records.layout import layout_of_message, layout_of_type

CODES = {"?": "?", "u1": "B", "i1": "b", "u2": "H", "i2": "h", "u4": "I", "i4": "i", "u8": "Q", "i8": "q", "f4": "f",
         "f8": "d"}
STAMP = struct.Struct("<iI")
STAMP_AT = 4


class Codec:
    """Packs and unpacks one message type in one frame.

    Parameters
    ----------
    type_name : such as ``AxisState`` (package ``microstage_msgs``). frame : the frame of every message.

    Attributes
    ----------
    names : fields after the header, in the order of `pack` and `unpack`; an array field counts as one.
    """

    def __init__(self, type_name, frame="stage"):
        self._definition = installed_definition(f"microstage_msgs/msg/{type_name}")
        layout = layout_of_type(self._definition, {"header.frame_id": len(frame)})
        self._blank = layout.blank(header__frame_id=frame.encode())
        self._tails = {layout.size: _Tail(layout)}
        self._own = self._tails[layout.size]
        self.names = self._own.names

    def pack(self, time_ns, *values):
        """CDR bytes of one message stamped ``time_ns`` [ns]; array fields are spread out."""
        raw = self._blank
        STAMP.pack_into(raw, STAMP_AT, *divmod(time_ns, 1_000_000_000))
        self._own.struct.pack_into(raw, self._own.offset, *values)
        return bytes(raw)

    def unpack(self, raw):
        """The values after the header, arrays spread out; a message in another frame is understood too."""
        own = self._own
        if raw[12:16] == self._blank[12:16]:  # as long a frame
            return own.struct.unpack_from(raw, own.offset)
        length = raw[12:16]
        if length not in self._tails:
            self._tails[length] = _Tail(layout_of_message(self._definition, raw))
        tail = self._tails[length]
        return tail.struct.unpack_from(raw, tail.offset)


class _Tail:
    """The fields after the header as one struct."""

    def __init__(self, layout):
        fields = sorted((offset, name, kind) for name, (kind, offset) in layout.dtype.fields.items()
                        if not name.startswith("header."))
        self.names = tuple(name for _, name, _ in fields)
        self.offset = at = fields[0][0]
        code = "<"
        for offset, _, kind in fields:
            base, shape = kind.subdtype or (kind, ())
            count = shape[0] if shape else 1
            code += f"{offset - at}x{count}{CODES[base.str[1:] if base.kind != 'b' else '?']}"
            at = offset + base.itemsize * count
        self.struct = struct.Struct(code)


def stamp_ns(raw):
    """Stamp of a message that begins with a header [ns]."""
    sec, nanosec = STAMP.unpack_from(raw, STAMP_AT)
    return sec * 1_000_000_000 + nanosec
