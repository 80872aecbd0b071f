"""Makes what ./microstage needs, once: Python environment, ROS 2 wheels where no ROS 2 is sourced, interfaces.

Run by any Python from 3.10 on, with the standard library alone. Writes ``.build/environment.sh``, which the command
sources from then on; its first three lines are the digest of what it was made from, the interfaces, the Python. The
interfaces are built once for all checkouts of a user: they lie in the user's cache folder under the digest of their
definitions and of what built them.
"""

import configparser
import contextlib
import fcntl
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from microstage_ros.commands.project import packages, toolchain
from microstage_ros.commands.project.steps import Failure, cache_folder
from microstage_ros.commands.project.steps import step as _step

OLDEST, NEWEST = (3, 10), (3, 14)
MARK = "microstage_requirements"
"""File in the Python environment that lists what was installed into it."""


def main(root, digest):
    """Make everything for the checkout at ``root``. Returns the exit status."""
    root = Path(root)
    build = root / ".build"
    try:
        build.mkdir(exist_ok=True)
        with _locked(build / "lock"):  # two commands started at once set up once
            ready = build / "environment.sh"
            if not _still_there(ready, digest):
                _make(root, build, ready, digest)
    except Failure as failure:
        print(f"microstage: {failure}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"microstage: setting up: {error.filename}: {(error.strerror or str(error)).lower()}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nmicrostage: set-up interrupted; the next command goes on with it", file=sys.stderr)
        return 1
    return 0


def _still_there(ready, digest):
    """Whether the environment was made from this digest, and what it names has not been removed since."""
    lines = ready.read_text(encoding="utf-8").splitlines()[:3] if ready.exists() else []
    return len(lines) == 3 and lines[0] == f"# {digest}" and Path(lines[1][2:]).is_dir() and _has_python(lines[2][2:])


def _has_python(venv):
    """Whether an environment has its Python still: one of the system that it was made from may have gone."""
    return os.access(Path(venv) / "bin" / "python", os.X_OK)


@contextlib.contextmanager
def _locked(path):
    """A lock between processes."""
    with open(path, "w", encoding="ascii") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _make(root, build, ready, digest):
    began, sourced = time.monotonic(), _sourced()
    whose = (
        f"with the ROS 2 {sourced} that is sourced"
        if sourced
        else "ROS 2 Jazzy from the Python package index, into .venv; no root needed"
    )
    print(f"microstage: setting up once: {whose}.", file=sys.stderr)
    python = Path((shutil.which("python3") if sourced else None) or _python())
    tools = _tools(root, python, sourced)
    venv = root / (".venv-ros" if sourced else ".venv")
    with _libraries_beside(root, venv, python, build, sourced, tools):
        prefix = _interfaces(root, venv, build, sourced, tools)
    text = f"# {digest}\n# {prefix}\n# {venv}\n" + _exports(root, venv, prefix, sourced)
    beside = ready.with_suffix(".partial")
    beside.write_text(text, encoding="utf-8")
    os.replace(beside, ready)
    print(f"  ready after {time.monotonic() - began:.0f} s", file=sys.stderr)


@contextlib.contextmanager
def _libraries_beside(root, venv, python, build, sourced, tools):
    """Makes the Python environment. Where interfaces must be built against the wheels, what that needs comes first and
    the other libraries are installed beside the block: the generators of interfaces leave a processor idle."""
    requirements = _requirements(root, sourced, tools)
    if sourced or tools is None:
        _environment(venv, requirements, python, build, sourced)
        yield
        return
    built_with = [line for line in requirements if re.match("numpy|setuptools", line)]
    first = [*_lines_of_wheels(root), *tools.packages, *built_with]
    _environment(venv, first, python, build, sourced, "ROS 2")
    stop = threading.Event()
    with ThreadPoolExecutor(1) as others:
        done = others.submit(_libraries_and_code, root, venv, requirements, python, build, stop)
        try:
            yield
            done.result()
        except BaseException:
            stop.set()
            raise


def _libraries_and_code(root, venv, requirements, python, build, stop):
    """The libraries, and with them the compiled code of the shipped axis, which the first cell would wait for."""
    _environment(venv, requirements, python, build, "", "libraries", stop)
    ahead = [str(venv / "bin" / "python"), "-m", "microstage_ros.commands.project.compile_ahead"]
    with contextlib.suppress(Failure):
        _step("compiled code", ahead, build, {**os.environ, "PYTHONPATH": str(root)}, stop=stop)


def _tools(root, python, sourced):
    """What compiles the interfaces; None if they are built already. Raises `Failure` before anything is downloaded."""
    if _built(_interfaces_folder(root, python, sourced)):
        return None
    tools = toolchain.find(_headers_of(python))
    print(f"  {tools.says}", file=sys.stderr)
    if not tools.headers and not toolchain.can_fetch_headers():
        raise Failure("Python.h is missing, which compiling the interfaces needs; install the headers of this Python "
                      "(Debian, Ubuntu: python3-dev; Fedora: python3-devel)")
    return tools


def _headers_of(python):
    """The folder in which a Python has its headers."""
    asked = [str(python), "-c", "import sysconfig; print(sysconfig.get_path('include'))"]
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()


def _sourced():
    """The name of a sourced ROS 2 whose rclpy works here, else an empty string."""
    distribution = os.environ.get("ROS_DISTRO", "")
    if not distribution:
        return ""
    good = subprocess.run(["python3", "-c", "import rclpy"], capture_output=True, check=False).returncode == 0
    return distribution if good else ""


def _requirements(root, sourced, tools=None):
    """What the environment needs to run, as pip reads it."""
    config = _config(root)
    lists = [config["options"]["install_requires"]]
    if not sourced:
        lists.insert(0, config["microstage"]["ros_wheels"])
    return [*_lines(lists), *(tools.packages if tools else ())]


def _config(root):
    config = configparser.ConfigParser(interpolation=None)
    config.read(root / "setup.cfg", encoding="utf-8")
    return config


def _lines(lists):
    lines = [line.strip() for text in lists for line in text.splitlines()]
    return [line for line in lines if line and not line.startswith("#")]


def add_test_tools(root):
    """Install what the tests need beside, once; raises `Failure`. The environment is the one this Python runs in."""
    wanted = _lines([_config(root)["options.extras_require"]["test"]])
    mark, build = Path(sys.prefix) / "microstage_test_requirements", root / ".build"
    if not (build / "environment.sh").exists() or (
        mark.exists() and mark.read_text(encoding="utf-8") == "\n".join(wanted)
    ):
        return
    begun = build / f"{Path(sys.prefix).name}.tools"
    with _locked(build / "lock"):
        anew = begun.exists()
        begun.touch()
        _install("test tools", Path(sys.prefix), wanted, build, _sourced(), anew=anew)
        mark.write_text("\n".join(wanted), encoding="utf-8")
        begun.unlink()


def _install(what, venv, requirements, build, sourced="", stop=None, anew=False):
    """Install, by uv where it serves; beside a sourced ROS 2 by pip, which sees the packages of the system. ``anew``:
    what is there already, too, since it may be half of it."""
    fast = None if sourced else packages.uv(venv, requirements)
    if fast:
        try:
            return _step(what, [*fast[0], *["--reinstall"] * anew], build, fast[1], stop)
        except Failure:
            if stop and stop.is_set():
                raise
            print(f"  {what}: uv could not; now with pip", file=sys.stderr)
    return _step(what, [*packages.pip(venv, requirements), *["--force-reinstall"] * anew], build, stop=stop)


def _environment(venv, requirements, python, build, sourced, name="", stop=None):
    """The Python environment with everything in ``requirements``; ``name`` of the step, ``stop`` as in `_step`."""
    mark, begun = venv / MARK, build / f"{venv.name}.begun"
    anew = begun.exists() or not _has_python(venv)  # of one that was interrupted nobody knows what is whole
    if not anew and mark.exists() and set(requirements) <= set(mark.read_text(encoding="utf-8").splitlines()):
        return
    begun.touch()
    if anew:
        options = ["--system-site-packages"] if sourced else []
        _step("Python environment", [str(python), "-m", "venv", "--clear", *options, str(venv)], build)
    _install(name or ("libraries" if sourced else "libraries and ROS 2"), venv, requirements, build, sourced, stop)
    mark.write_text("\n".join(requirements), encoding="utf-8")
    begun.unlink()


def _python():
    """A Python that the wheels exist for."""
    if OLDEST <= sys.version_info[:2] <= NEWEST:
        return sys.executable
    for minor in range(NEWEST[1], OLDEST[1] - 1, -1):
        found = shutil.which(f"python3.{minor}")
        if found:
            return found
    raise Failure(f"this is Python {sys.version.split()[0]}; one from 3.10 to 3.14 is needed (python3.X on the path)")


def _interfaces_folder(root, python, sourced):
    """Folder of the built interfaces: one for each definition, Python, machine and ROS 2."""
    version = subprocess.run(
        [str(python), "-c", "import sys; print(sys.version_info[:2])"], capture_output=True, text=True, check=True
    ).stdout
    digest = hashlib.sha256(
        f"{version}{platform.machine()} {platform.libc_ver()} {sourced} {_lines_of_wheels(root)}".encode()
    )
    for path in sorted((root / "msg_defs").rglob("*")):
        if path.is_file():
            digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return cache_folder() / f"interfaces-{'ros-' + sourced if sourced else 'wheels'}-{digest.hexdigest()[:16]}"


def _lines_of_wheels(root):
    return _lines([_config(root)["microstage"]["ros_wheels"]])


def _built(folder):
    """Whether the interfaces in this folder are complete."""
    return (folder / "complete").exists()


def _interfaces(root, venv, build, sourced, tools):
    """The interface package, built; returns its install prefix."""
    folder = _interfaces_folder(root, venv / "bin" / "python", sourced)
    if not _built(folder):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "lock").touch()
        except OSError:
            folder = build / folder.name  # no cache folder that can be written: for this checkout alone
            folder.mkdir(parents=True, exist_ok=True)
    prefix = folder / "install" / "microstage_msgs"
    if _built(folder):  # it may be another's, who alone writes there
        return prefix
    with _locked(folder / "lock"):
        if not _built(folder):
            _build(root, venv, build, sourced, tools or toolchain.find(_headers_of(venv / "bin" / "python")), folder)
            (folder / "complete").touch()
            shutil.rmtree(folder / "build", ignore_errors=True)
    return prefix


def _build(root, venv, build, sourced, tools, folder):
    """Compile the interfaces into ``folder``. Raises `Failure` beside a sourced ROS 2 that lacks its build tool."""
    if sourced and shutil.which("colcon") is None:
        raise Failure("colcon is needed to build the interfaces for the ROS 2 that is sourced (Debian, Ubuntu: install "
                      "python3-colcon-common-extensions; else: pip install colcon-common-extensions)")
    for name in ("build", "install", "log"):
        shutil.rmtree(folder / name, ignore_errors=True)
    python = venv / "bin" / "python"
    environment = dict(os.environ, VIRTUAL_ENV=str(venv), COLCON_DEFAULTS_FILE=os.devnull)
    if tools.zig:
        environment |= toolchain.zig_wrappers(build / "zig", python)
    environment["PATH"] = f"{venv / 'bin'}{os.pathsep}{environment['PATH']}"
    if not sourced:
        environment |= {"AMENT_PREFIX_PATH": str(venv), "CMAKE_PREFIX_PATH": str(venv)}
        environment.pop("PYTHONPATH", None)
    only = [] if sourced else ["-DMICROSTAGE_PYTHON_ONLY=ON"]  # the wheels bring no C++ node that could use the rest
    arguments = [f"-DPython3_EXECUTABLE={python}", *tools.generator, *only]
    if not tools.headers:
        arguments += _fetched_headers(folder, environment)
    _step("interfaces", ["colcon", "--log-base", str(folder / "log"), "build", "--event-handlers", "console_direct+",
                         "--base-paths", str(root / "msg_defs"), "--build-base", str(folder / "build"),
                         "--install-base", str(folder / "install"), "--cmake-args", *arguments], build, environment)


def _fetched_headers(folder, environment):
    """CMake's arguments for headers of Python that Debian's package brings."""
    print(f"  Python.h is not here: {toolchain.headers_package()} from Debian, unpacked without root", file=sys.stderr)
    folders = toolchain.fetch_headers(folder / "headers")
    if not folders:
        raise Failure(f"Python.h is missing, which compiling needs (Debian: install {toolchain.headers_package()})")
    environment["CPATH"] = os.pathsep.join(map(str, folders))
    return [f"-DPython3_INCLUDE_DIR={folders[0]}", f"-DPython3_LIBRARY={_any_library()}"]


def _any_library():
    """A file for CMake's search of libpython; extension modules are not linked with it."""
    return next(iter(sorted(Path("/usr/lib").glob("**/libpython3*.so*"))), Path(os.devnull))


def _exports(root, venv, prefix, sourced):
    """The shell text that makes the environment."""
    messages = next((prefix / "lib").glob("python3*/site-packages"), prefix / "lib")
    local = list((prefix / "local" / "lib").glob("python3*/dist-packages"))
    messages = _quotable(local[0] if local else messages)
    # a ROS 2 that is sourced for another Python must not hide the wheels
    own = "" if sourced else "".join(f":{_quotable(path)}" for path in (venv / "lib").glob("python3*/site-packages"))
    root, venv, prefix = (_quotable(path) for path in (root, venv, prefix))
    which = f"ROS 2 {sourced}, as sourced." if sourced else \
        "ROS 2 Jazzy from the Python package index, in .venv (none is sourced here)."
    lines = [
        f'export VIRTUAL_ENV="{venv}"',
        'export PATH="$VIRTUAL_ENV/bin:$PATH"',
        f'export MICROSTAGE_ROS="{which}"',
        f'export MICROSTAGE_ROOT="{root}"',
        f'export PYTHONPATH="{root}:{messages}{own}${{PYTHONPATH:+:$PYTHONPATH}}"',
        f'export LD_LIBRARY_PATH="{prefix}/lib:{venv}/lib${{LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}}"',
    ]
    if sourced:
        lines.append(f'export AMENT_PREFIX_PATH="{prefix}:$AMENT_PREFIX_PATH"')
    else:
        lines += [f'export AMENT_PREFIX_PATH="{prefix}:{venv}"', f'export CMAKE_PREFIX_PATH="{venv}"']
    return "\n".join(lines) + "\n"


def _quotable(path):
    """A path as it may stand between double quotes of a shell."""
    return re.sub(r'(["$`\\])', r"\\\1", str(path))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
