"""The one way to compile a function: numba, cached on disk, never stale.

Numba's own cache looks only at the file of the function itself, so a caller keeps running the old
body of a callee that lives in another file. Here the cache folder's name is a digest of all
compiled sources that the function's room may call (the rooms below it, see the README's picture):
a change there makes a new cache, and nothing else does.
"""

import functools
import hashlib
import os
import pathlib
import sys

_hidden = sys.modules.setdefault("coverage", None) is None  # numba loads it where it is installed, 0.1 s, for nothing here
import numba  # noqa: E402
from numba.core.runtime import rtsys  # noqa: E402
from numba.extending import intrinsic, overload  # noqa: E402, F401  (the rest of the package has them from here)

if _hidden:
    del sys.modules["coverage"]

PACKAGE = pathlib.Path(__file__).resolve().parent.parent
ROOMS_BELOW = {"axis": ("axis",), "control": ("axis", "control"), "nodes": ("axis", "control", "nodes")}
"""Rooms whose compiled code a room's own may call; of any other room: all."""


@functools.lru_cache
def _sources_digest(room):
    """Digest of the compiled sources a room may call, with the numba and Python versions."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for name in ROOMS_BELOW.get(room, ("",)):
        for path in sorted((PACKAGE / name).rglob("*.py")):
            text = path.read_bytes()
            if b"axis.compiled import" in text:
                digest.update(str(path.relative_to(PACKAGE)).encode())
                digest.update(text)
    return digest.hexdigest()[:16]


def cache_folder(room):
    """Folder of a room's compiled code: ``$MICROSTAGE_CACHE`` or the user's cache folder, then the digest."""
    base = os.environ.get("MICROSTAGE_CACHE") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "microstage_ros"
    )
    return os.path.join(base, f"{room}-{_sources_digest(room)}")


def external(name, result, *arguments):
    """The function ``name`` of a C library that the process has loaded, callable from compiled code.

    Parameters
    ----------
    name : as the linker knows it; ``result``, ``arguments`` : names of numba's types, such as ``int32``, ``uintp``
        (pointers are ``uintp``).
    """
    types = [getattr(numba.types, kind) for kind in (result, *arguments)]
    return numba.types.ExternalFunction(name, numba.core.typing.signature(*types))


def compiled(function=None, **options):
    """Compile ``function`` with numba: nopython, cached, without reordering of float arithmetic.

    ``fastmath`` stays off unless asked for, so that the same seed gives the same bits everywhere.
    """
    if function is None:
        return functools.partial(compiled, **options)
    room = (function.__module__.split(".") + ["", ""])[1]
    numba.config.CACHE_DIR = cache_folder(room)  # numba reads it when the decorator runs
    usual = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True,
             "forceinline": False}         # said, or numba passes a caller's on to all that it calls
    dispatcher = numba.njit(**{**usual, **options})(function)
    cache = getattr(dispatcher, "_cache", None)
    if hasattr(cache, "_load_overload"):  # numba as we know it
        cache.load_overload = functools.partial(_load, cache)
    return dispatcher


def _load(cache, signature, context):
    """What numba's cache does when asked for compiled code, less the 0.4 s of loading all that a compiler needs.

    Where the cache has nothing, the compiler loads it.
    """
    rtsys.initialize(context)
    with cache._guard_against_spurious_io_errors():
        return cache._load_overload(signature, context)


def internal(function=None, **options):
    """`compiled` for a function that only compiled code calls: without its door for Python, half the compiling."""
    return compiled(function, no_cpython_wrapper=True, **options)


def woven(function):
    """`internal`, written into its caller after types are found: a loop's every period, without the price of a call."""
    return internal(function, forceinline=True)


@intrinsic
def seldom(typingctx):
    """Written first in a function that runs seldom: it stays a call, and its text is not copied into every caller."""
    def build(context, builder, signature, arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return numba.types.void(), build


def inlined(function):
    """`internal`, written into its caller before types are found: what every period runs through, called from few places."""
    return internal(function, inline="always")
