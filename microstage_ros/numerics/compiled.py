"""The one way to compile a function: numba, cached on disk, never stale.

Numba's own cache looks only at the file of the function itself, so a caller keeps running the old
body of a callee that lives in another file. Here the cache folder's name is a digest of all
compiled sources that the function's package may call (the packages below it, see the README's picture):
a change there makes a new cache, and nothing else does.
"""

import contextlib
import functools
import gc
import hashlib
import os
import pathlib
import sys

# numba loads coverage where it is installed: 0.1 s, for nothing here. Hidden while numba is imported (tested on numba
# 0.68), and given back below; a numba that looks for it otherwise takes the 0.1 s, and nothing else changes.
_hidden = sys.modules.setdefault("coverage", None) is None  # type: ignore[arg-type]
import numba  # noqa: E402
from numba.core.ccallback import CFunc  # noqa: E402
from numba.core.compiler_lock import global_compiler_lock  # noqa: E402
from numba.core.runtime import rtsys  # noqa: E402
from numba.extending import intrinsic, overload  # noqa: E402, F401  (the rest of the package has them from here)

from microstage_ros.numerics.cache_place import one_at_a_time, one_process  # noqa: E402

if _hidden:
    del sys.modules["coverage"]

PACKAGE = pathlib.Path(__file__).resolve().parent.parent
_MODEL = ("numerics", "model", "solver")
PACKAGES_BELOW = {**dict.fromkeys(_MODEL, _MODEL), "signals": (*_MODEL, "signals"),
                  "control": (*_MODEL, "signals", "control"), "hardware": (*_MODEL, "hardware"),
                  "ros": (*_MODEL, "signals", "control", "hardware", "ros")}
"""Packages whose compiled code a package's own may call; of any other package: all."""


@functools.lru_cache
def _sources_digest(package):
    """Digest of the compiled sources a package may call, with the numba and Python versions."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for name in PACKAGES_BELOW.get(package, ("",)):
        for path in sorted((PACKAGE / name).rglob("*.py")):
            text = path.read_bytes()
            if b"numerics.compiled import" in text or path.name == "plant_record.py":   # its numbers are compiled in
                digest.update(str(path.relative_to(PACKAGE)).encode())
                digest.update(text)
    return digest.hexdigest()[:16]


def cache_folder(package):
    """Folder of a package's compiled code: ``$MICROSTAGE_CACHE`` or the user's cache folder, then the digest."""
    base = os.environ.get("MICROSTAGE_CACHE") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "microstage_ros"
    )
    return os.path.join(base, f"{package}-{_sources_digest(package)}")


def external(name, result, *arguments):
    """The function ``name`` of a C library that the process has loaded, callable from compiled code.

    Parameters
    ----------
    name : as the linker knows it; ``result``, ``arguments`` : names of numba's types, such as ``int32``, ``uintp``
        (pointers are ``uintp``).
    """
    types = [getattr(numba.types, kind) for kind in (result, *arguments)]
    return numba.types.ExternalFunction(name, numba.core.typing.signature(*types))


def compiled(function=None, makes_arrays=True, **options):
    """Compile ``function`` with numba: nopython, cached, without reordering of float arithmetic.

    ``fastmath`` stays off unless asked for, so that the same seed gives the same bits everywhere.

    makes_arrays : whether it, or what it calls, makes an array. Where none is made nobody has to count who holds one;
        each count is a call, at which the compiler has to put all numbers back into memory.
    """
    if function is None:
        return functools.partial(compiled, makes_arrays=makes_arrays, **options)
    _name_place(function)
    usual = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True,
             "forceinline": False, "_nrt": makes_arrays}   # said, or numba passes a caller's on to all that it calls
    dispatcher = numba.njit(**{**usual, **options})(function)
    _use_ours(getattr(dispatcher, "_cache", None))
    _compile_once(dispatcher, getattr(dispatcher, "_cache", None))
    return dispatcher


PLACES = "microstage_ros.numerics.cache_place.CachePlace,UserProvidedCacheLocator"
"""Who says where compiled code lies: ours for the functions of this package, numba's for those of others."""


def _name_place(function):
    """Tell numba where the compiled code of ``function`` lies; it reads these settings when the decorator runs."""
    numba.config.CACHE_DIR = cache_folder((function.__module__.split(".") + ["", ""])[1])
    numba.config.CACHE_LOCATOR_CLASSES = PLACES


def _use_ours(cache):
    """Have a cache of numba's use `_load` and `_save`."""
    if hasattr(cache, "_load_overload") and hasattr(cache, "_save_overload"):  # numba as we know it
        cache.load_overload = functools.partial(_load, cache)
        cache.save_overload = functools.partial(_save, cache)


def _compile_once(function, cache):
    """Have one process compile a ``function`` of which its ``cache`` has nothing; the others wait for its code.

    Processes that begin together, as tests do, would else compile all the same functions, each for itself. The order of
    the locks is that of the calls, in which there is no circle.
    """
    index = getattr(getattr(cache, "_cache_file", None), "_index_path", None)
    if index is None:     # no cache as we know it
        return
    usual = function.compile

    def compile_once(*signature):
        if os.path.exists(index):
            return usual(*signature)
        with global_compiler_lock, one_process(f"{index}.lock"), _uncollected():
            return usual(*signature)

    function.compile = compile_once


@contextlib.contextmanager
def _uncollected():
    """Without searches for garbage: what a compiler makes is used until it ends, and they take a tenth of its time."""
    before = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if before:
            gc.enable()


def _load(cache, signature, context):
    """What numba's cache does when asked for compiled code, less the 0.4 s of loading all that a compiler needs.

    Where the cache has nothing, the compiler loads it.
    """
    rtsys.initialize(context)
    with cache._guard_against_spurious_io_errors():
        return cache._load_overload(signature, context)


def _save(cache, signature, data):
    """What numba's cache does with compiled code, one process at a time (`one_at_a_time`)."""
    with one_at_a_time(cache.cache_path), cache._guard_against_spurious_io_errors():
        cache._save_overload(signature, data)


def in_place(function):
    """`compiled` for a function that works in the arrays it is given; neither it nor what it calls makes one."""
    return compiled(function, makes_arrays=False)


def internal(function=None, **options):
    """`compiled` for a function that only compiled code calls: without its door for Python, half the compiling."""
    return compiled(function, no_cpython_wrapper=True, **options)


def always_inlined(function):
    """`internal`, written into its caller after types are found: a loop's every period, without the price of a call."""
    return internal(function, forceinline=True)


@intrinsic
def _pointer(typingctx, address, like):
    """The address of something of the type of ``like``, as a pointer."""
    def build(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return numba.types.CPointer(like)(numba.types.uintp, like), build


@intrinsic
def address_of(typingctx, pointer):
    """The address that a pointer stands for, uintp."""
    def build(context, builder, signature, arguments):
        return builder.ptrtoint(arguments[0], context.get_value_type(numba.types.uintp))

    return numba.types.uintp(pointer), build


@internal
def put_at(address, value):
    """Leave a number, an array or a tuple of such at an address, for who is given a pointer to it (`called_from_c`)."""
    _pointer(address, value)[0] = value


@internal
def words_at(address, count):
    """The int64 array that begins at an address; nobody owns it."""
    return numba.carray(_pointer(address, 0), count)


@functools.lru_cache
def called_from_c(function, kind):
    """Compile ``function(pointer, count)``, which makes no array, so that C can call it.

    ``pointer[0]`` is of a type given by `kind_of`.

    Returns
    -------
    object with the attribute ``address``; it has to live as long as anybody may call.
    """
    _name_place(function)
    arguments = numba.types.CPointer(kind), numba.types.uint64   # C owns what the pointer leads to: nothing to count
    made = CFunc(function, (arguments, numba.types.void), locals={},
                 options={"nopython": True, "error_model": "numpy", "_nrt": False})
    made.enable_caching()
    _use_ours(made._cache)
    _compile_once(made, made._cache)
    made.compile()
    return made


kind_of = numba.typeof
"""The type of a value, as compiled code knows it."""


@intrinsic
def fused(typingctx, a, b, c):
    """A b + c of three numbers, rounded once on every machine."""
    def build(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return numba.types.float64(numba.types.float64, numba.types.float64, numba.types.float64), build


@intrinsic
def not_inlined(typingctx):
    """Written first in a function that runs seldom: it stays a call, and its text is not copied into every caller."""
    def build(context, builder, signature, arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return numba.types.void(), build


def inlined_before_typing(function):
    """`internal`, written into its caller before types are found: what every period runs through, of few callers."""
    return internal(function, inline="always")


def dispatch(name, functions, arguments, otherwise):
    """One compiled function ``name(kind, *arguments)`` that calls ``functions[kind]``: compiled code has no tables.

    Parameters
    ----------
    functions : sequence of compiled functions of the same arguments and result type; None: nothing special.
    arguments : names of their arguments, such as "plant, state, u".
    otherwise : expression for a kind whose entry is None.

    Returns
    -------
    compiled function; it is not cached by itself, but within every cached function that calls it.
    """
    lines = [f"def {name}(kind, {arguments}):", "    not_inlined()"]
    names = {"not_inlined": not_inlined}
    for kind, function in enumerate(functions):
        if function is not None:
            names[f"f{kind}"] = function
            lines += [f"    if kind == {kind}:", f"        return f{kind}({arguments})"]
    lines.append(f"    return {otherwise}")
    exec(compile("\n".join(lines), f"<{name}>", "exec"), names)
    options = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": True,
               "forceinline": False}
    return numba.njit(**options)(names[name])
