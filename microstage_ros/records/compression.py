"""Plain or compressed files by their suffix, with the bytes checked against the name."""

import gzip
import io
import lzma
import zlib
from contextlib import nullcontext
from pathlib import Path

from microstage_ros.files import complete_file, unreadable
from microstage_ros.quantities.errors import InputError

MAGIC = {".gz": b"\x1f\x8b", ".xz": b"\xfd7zXZ\x00"}
LARGEST = 1 << 33
"""Bytes of an unpacked file: a day of all columns at 1 kHz. A small file that unpacks to more is no record."""
PIECE = 1 << 24
OTHER_MAGIC = {b"\x28\xb5\x2f\xfd": "zstd", b"BZh": "bzip2", b"PK\x03\x04": "zip",
               b"\x89MCAP": "MCAP", b"SQLite format 3": "SQLite"}


def read_bytes(path):
    """All bytes of a file, decompressed if its name ends in `.gz` or `.xz`.

    Raises
    ------
    InputError : no such file, empty, compressed otherwise than its name says, cut off, or larger than `LARGEST`
        unpacked.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error, "a file that can be read") from None
    if not raw:
        raise InputError(path, "an empty file", "a header line and rows")
    kind = _kind(raw)
    expected = path.suffix if path.suffix in MAGIC else ""
    if kind != expected:
        raise InputError(path, f"{kind.lstrip('.') or 'plain text'} bytes",
                         f"{expected.lstrip('.') or 'plain text'} bytes, as the file's name says")
    if not kind:
        return raw
    try:
        with (gzip.open if kind == ".gz" else lzma.open)(io.BytesIO(raw)) as stream:
            return _unpacked(stream, path)
    except (OSError, EOFError, lzma.LZMAError, zlib.error) as error:
        raise InputError(path, str(error), f"a whole {kind.lstrip('.')} file") from None


def _unpacked(stream, path):
    """All bytes of a decompressing stream; memory grows with what comes, up to `LARGEST`."""
    parts, size = [], 0
    while part := stream.read(PIECE):
        size += len(part)
        if size > LARGEST:
            raise InputError(path, f"more than {LARGEST} bytes unpacked", f"at most {LARGEST} bytes in one file")
        parts.append(part)
    return b"".join(parts)


def _kind(raw):
    """`.gz`, `.xz`, the name of another format, or an empty string for text."""
    for suffix, magic in MAGIC.items():
        if raw.startswith(magic):
            return suffix
    return next((name for magic, name in OTHER_MAGIC.items() if raw.startswith(magic)), "")


def write_bytes(path, chunks):
    """Write an iterable of bytes to `path`, compressed if its name ends in `.gz` or `.xz`.

    The same bytes always give the same file: the gzip header carries neither name nor time. The file gets its name
    when it is complete.
    """
    path = Path(path)
    with complete_file(path, "wb") as plain, _compressor(path.suffix, plain) as out:
        for chunk in chunks:
            out.write(chunk)


def _compressor(suffix, plain):
    """A context manager that gives the file to write to."""
    if suffix == ".gz":
        return gzip.GzipFile(filename="", mode="wb", compresslevel=6, fileobj=plain, mtime=0)
    if suffix == ".xz":
        return lzma.LZMAFile(plain, "wb", preset=1)
    return nullcontext(plain)
