"""Message definitions: the text that goes into a bag, the type hash, and what the fields are.

A definition in a bag (`ros2msg`) is the text of the message file followed, for every message it
is built from, by a line of 80 `=`, a line `MSG: package/Name`, and that one's text.  The text and
the hash (REP-2016, `RIHS01_…`) lie beside each other in an installed package:
`share/<package>/msg/<Name>.msg` and `.json`.
"""

import json
import os
import re
from dataclasses import dataclass
from pathlib import Path

from microstage_ros.quantities.errors import InputError

SEPARATOR = "=" * 80
PRIMITIVES = {"bool": "?", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
              "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8"}
"""Name in a message file to numpy's code for it."""

FIELD = re.compile(r"^(?P<type>[A-Za-z][\w/]*)(?P<bound><=\d+)?(?P<array>\[(?:<=)?\d*\])?\s+(?P<name>[a-z]\w*)"
                   r"(?:\s+(?P<default>.*))?$")
CONSTANT = re.compile(r"^[A-Za-z][\w/]*(?:<=\d+)?\s+[A-Z]\w*\s*=")


@dataclass(frozen=True)
class Field:
    """One field of a message.

    Attributes
    ----------
    name, type : as in the message file; a message type is `package/Name`.
    count : number of elements of a fixed array, -1 for a sequence, None for a single value.
    """

    name: str
    type: str
    count: int | None = None


@dataclass(frozen=True)
class Definition:
    """A message type with everything it is built from.

    Attributes
    ----------
    name : `package/msg/Name`.
    text : the `ros2msg` text, as it goes into a bag.
    hash : `RIHS01_…`, empty where unknown.
    types : short name (`package/Name`) to its fields.
    """

    name: str
    text: str
    hash: str
    types: dict

    @property
    def fields(self):
        """Fields of the message itself."""
        return self.types[short_name(self.name)]


def short_name(name):
    """`package/msg/Name` as `package/Name`, the way definitions refer to each other."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


def long_name(name):
    """`package/Name` as `package/msg/Name`, the way topics name their type."""
    parts = name.split("/")
    return name if len(parts) == 3 else f"{parts[0]}/msg/{parts[-1]}"


def parse_definition(name, text, type_hash=""):
    """A `Definition` from the `ros2msg` text of a bag.

    Raises
    ------
    InputError : a line that is no field, or a type that the text does not define.
    """
    sections = re.split(rf"^{SEPARATOR}\s*$", text, flags=re.MULTILINE)
    types = {short_name(name): _fields(name, sections[0])}
    for section in sections[1:]:
        head, _, body = section.strip().partition("\n")
        part = short_name(head.removeprefix("MSG:").strip())
        types[part] = _fields(part, body)
    for fields in types.values():
        for field in fields:
            if "/" in field.type and field.type not in types:
                raise InputError(f"definition of {name}: field {field.name}", field.type,
                                 "a type that the definition explains")
    return Definition(long_name(name), text, type_hash, types)


SERVICE_EVENT_INFO = """MSG: service_msgs/ServiceEventInfo
uint8 event_type
builtin_interfaces/Time stamp
char[16] client_gid
int64 sequence_number
"""
HEADER = """MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""
TIME = """MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def service_event_text(name, text):
    """The text of a service's event message, of which a bag holds only the service's own file.

    Parameters
    ----------
    name : `package/srv/Name_Event`.
    text : request, `---`, response, then what they are built from.
    """
    package, base = name.split("/")[0], name.split("/")[-1].removesuffix("_Event")
    own, *others = re.split(rf"^{SEPARATOR}\s*$", text, flags=re.MULTILINE)
    request, response = re.split(r"^---\s*$", own, maxsplit=1, flags=re.MULTILINE)
    parts = [f"service_msgs/ServiceEventInfo info\n{base}_Request[<=1] request\n{base}_Response[<=1] response\n",
             SERVICE_EVENT_INFO, f"MSG: {package}/{base}_Request\n{request}",
             f"MSG: {package}/{base}_Response\n{response}", *(other.strip() for other in others)]
    if not any(other.strip().startswith("MSG: builtin_interfaces/Time") for other in others):
        parts.append(TIME)
    return f"{SEPARATOR}\n".join(_ended(part) for part in parts)


def _fields(name, text):
    """The fields of one message file, types in full."""
    package = name.split("/")[0]
    fields = []
    for raw in text.splitlines():
        line = raw.split("#")[0].strip() if '"' not in raw and "'" not in raw else raw.strip()
        if not line or line.startswith("#") or CONSTANT.match(line):
            continue
        match = FIELD.match(line)
        if match is None:
            raise InputError(f"definition of {name}", raw, "a line `type name`")
        fields.append(Field(match["name"], _full_type(package, match["type"]), _count(match["array"])))
    return tuple(fields)


def _full_type(package, written):
    """A type as it is written to a primitive's name or `package/Name`."""
    if written in PRIMITIVES or written in ("string", "wstring"):
        return written
    if written == "Header":
        return "std_msgs/Header"
    return short_name(written) if "/" in written else f"{package}/{written}"


def _count(array):
    """Elements that brackets stand for: None, a number, or -1 for a sequence."""
    if array is None:
        return None
    return -1 if array == "[]" or "<=" in array else int(array[1:-1])


def installed_definition(name, prefixes=None):
    """The definition and hash of an installed message type.

    Parameters
    ----------
    name : `package/msg/Name`.
    prefixes : folders with a `share/` each; default: the environment's AMENT_PREFIX_PATH.

    Raises
    ------
    InputError : no prefix has the type.
    """
    if prefixes is None:
        prefixes = [prefix for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    own = _installed_file(name, prefixes, ".msg").read_text(encoding="utf-8")
    texts, waiting = {short_name(name): own}, [(short_name(name), own)]
    while waiting:
        part, text = waiting.pop(0)
        for field in _fields(part, text):
            if "/" in field.type and field.type not in texts:
                texts[field.type] = _installed_file(field.type, prefixes, ".msg").read_text(encoding="utf-8")
                waiting.append((field.type, texts[field.type]))
    parts = [own] + [f"MSG: {part}\n{text}" for part, text in list(texts.items())[1:]]
    return parse_definition(name, f"{SEPARATOR}\n".join(_ended(part) for part in parts), _hash(name, prefixes))


def _ended(text):
    """`text` ending in a line feed, so that what follows begins a line."""
    return text if text.endswith("\n") else text + "\n"


def _installed_file(name, prefixes, suffix):
    """The file of a message type in the first prefix that has it."""
    package, kind, base = long_name(name).split("/")
    for prefix in prefixes:
        path = Path(prefix) / "share" / package / kind / f"{base}{suffix}"
        if path.exists():
            return path
    raise InputError(f"message type {name}", "not installed",
                     f"share/{package}/{kind}/{base}{suffix} in one of {', '.join(map(str, prefixes)) or 'no prefix'}"
                     " (AMENT_PREFIX_PATH; source the workspace)")


def _hash(name, prefixes):
    """The type hash from the installed description, empty where there is none."""
    try:
        described = json.loads(_installed_file(name, prefixes, ".json").read_text(encoding="utf-8"))
    except InputError:
        return ""
    hashes = {entry["type_name"]: entry["hash_string"] for entry in described["type_hashes"]}
    return hashes.get(long_name(name), "")
