"""The one way to compile a function: numba, cached on disk, never stale.

Numba's own cache looks only at the file of the function itself, so a caller keeps running the old
body of a callee that lives in another file. Here the cache folder's name is a digest of all
compiled sources of the package: a change anywhere makes a new cache, and nothing else does.
"""

import hashlib
import os
import pathlib
import sys

import numba

PACKAGE = pathlib.Path(__file__).resolve().parent.parent


def _sources_digest():
    """Digest of every source file that imports this module, with the numba and Python versions."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if b"axis.compiled import" in text:
            digest.update(str(path.relative_to(PACKAGE)).encode())
            digest.update(text)
    return digest.hexdigest()[:16]


def cache_folder():
    """Folder of the compiled code: ``$MICROSTAGE_CACHE`` or the user's cache folder, then the digest."""
    base = os.environ.get("MICROSTAGE_CACHE") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "microstage_ros"
    )
    return os.path.join(base, "compiled-" + _sources_digest())


numba.config.CACHE_DIR = cache_folder()


def compiled(function=None, **options):
    """Compile ``function`` with numba: nopython, cached, without reordering of float arithmetic.

    ``fastmath`` stays off unless asked for, so that the same seed gives the same bits everywhere.
    """
    options = {"cache": True, "nogil": True, "error_model": "numpy", **options}
    return numba.njit(**options)(function) if function is not None else numba.njit(**options)
