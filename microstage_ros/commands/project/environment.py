"""Makes what ./microstage needs, once: Python environment, ROS 2 wheels where no ROS 2 is sourced, interfaces.

Run as a file by any Python from 3.10 on, with the standard library alone. Writes ``.build/environment.sh``,
which the command sources from then on; its first line is the digest of what it was made from.
"""

import configparser
import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

OLDEST, NEWEST = (3, 10), (3, 14)
MOST_SILENT = 1800
"""Longest time [s] for one step."""


class Failure(Exception):
    """A step did not work; the text says which and what helps."""


def main(root, digest):
    """Make everything for the checkout at ``root``. Returns the exit status."""
    root = Path(root)
    build = root / ".build"
    build.mkdir(exist_ok=True)
    with open(build / "lock", "w", encoding="ascii") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # two commands started at once set up once
        ready = build / "environment.sh"
        if ready.exists() and ready.read_text(encoding="utf-8").startswith(f"# {digest}\n"):
            return 0
        try:
            _make(root, build, ready, digest)
        except Failure as failure:
            print(f"microstage: {failure}", file=sys.stderr)
            return 1
    return 0


def _make(root, build, ready, digest):
    sourced = _sourced()
    if sourced:
        print(f"microstage: setting up once, with the ROS 2 {sourced} that is sourced.", file=sys.stderr)
    else:
        print("microstage: setting up once: ROS 2 Jazzy from the Python package index, into .venv; no root needed.",
              file=sys.stderr)
    venv = root / (".venv-ros" if sourced else ".venv")
    requirements = _requirements(root, sourced)
    _environment(venv, requirements, build, sourced)
    prefix = _interfaces(root, venv, build, sourced)
    ready.write_text(f"# {digest}\n" + _exports(root, venv, prefix, sourced), encoding="utf-8")


def _sourced():
    """The name of a sourced ROS 2 whose rclpy works here, else an empty string."""
    distribution = os.environ.get("ROS_DISTRO", "")
    if not distribution:
        return ""
    good = subprocess.run(["python3", "-c", "import rclpy"], capture_output=True, check=False).returncode == 0
    return distribution if good else ""


def _requirements(root, sourced):
    config = configparser.ConfigParser(interpolation=None)
    config.read(root / "setup.cfg", encoding="utf-8")
    lists = [config["options"]["install_requires"], config["options.extras_require"]["test"]]
    if not sourced:
        lists.insert(0, config["microstage"]["ros_wheels"])
    return [line.strip() for text in lists for line in text.splitlines() if line.strip()]


def _environment(venv, requirements, build, sourced):
    """The Python environment with everything in ``requirements``."""
    mark = venv / "microstage_requirements"
    wanted = "\n".join(requirements)
    if mark.exists() and mark.read_text(encoding="utf-8") == wanted:
        return
    if not (venv / "bin" / "python").exists():
        python = shutil.which("python3") if sourced else _python()
        options = ["--system-site-packages"] if sourced else []
        _step("Python environment", [python, "-m", "venv", *options, str(venv)], build)
    _step("libraries and ROS 2" if not sourced else "libraries",
          [str(venv / "bin" / "python"), "-m", "pip", "install", "--disable-pip-version-check", "--no-input",
           *requirements], build)
    mark.write_text(wanted, encoding="utf-8")


def _python():
    """A Python that the wheels exist for."""
    if OLDEST <= sys.version_info[:2] <= NEWEST:
        return sys.executable
    for minor in range(NEWEST[1], OLDEST[1] - 1, -1):
        found = shutil.which(f"python3.{minor}")
        if found:
            return found
    raise Failure(f"this is Python {sys.version.split()[0]}; one from 3.10 to 3.14 is needed (python3.X on the path)")


def _interfaces(root, venv, build, sourced):
    """The interface package, built; returns its install prefix."""
    digest = hashlib.sha256(str(sys.version_info[:2]).encode())
    for path in sorted((root / "msg_defs").rglob("*")):
        if path.is_file():
            digest.update(path.read_bytes())
    kind = "ros" if sourced else "wheels"
    prefix = build / f"interfaces-{kind}" / "install" / "microstage_msgs"
    mark = build / f"interfaces-{kind}" / "digest"
    if mark.exists() and mark.read_text(encoding="ascii") == digest.hexdigest() and prefix.exists():
        return prefix
    if not (shutil.which("cc") or shutil.which("gcc")):
        raise Failure("a C and C++ compiler is needed to build the interfaces (Debian, Ubuntu: package build-essential)")
    base = build / f"interfaces-{kind}"
    shutil.rmtree(base, ignore_errors=True)
    base.mkdir(parents=True)
    environment = dict(os.environ, VIRTUAL_ENV=str(venv), COLCON_DEFAULTS_FILE=os.devnull,
                       PATH=f"{venv / 'bin'}{os.pathsep}{os.environ['PATH']}")
    if not sourced:
        environment |= {"AMENT_PREFIX_PATH": str(venv), "CMAKE_PREFIX_PATH": str(venv)}
        environment.pop("PYTHONPATH", None)
    _step("interfaces", ["colcon", "--log-base", str(base / "log"), "build", "--base-paths", str(root / "msg_defs"),
                         "--build-base", str(base / "build"), "--install-base", str(base / "install"),
                         "--cmake-args", f"-DPython3_EXECUTABLE={venv / 'bin' / 'python'}"], build, environment)
    mark.write_text(digest.hexdigest(), encoding="ascii")
    return prefix


def _step(what, command, build, environment=None):
    """Run one command with its output in ``.build/setup.log``, and a line of progress on a terminal."""
    began, live = time.monotonic(), sys.stderr.isatty()
    log = build / "setup.log"
    with open(log, "a", encoding="utf-8") as output:
        output.write(f"\n$ {' '.join(command)}\n")
        output.flush()
        start = output.tell()
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
                                   env=environment)
        while process.poll() is None:
            passed = time.monotonic() - began
            if live:
                print(f"\r\033[K  {what}: {passed:3.0f} s  {_last_line(log, start)}", end="", file=sys.stderr, flush=True)
            if passed > MOST_SILENT:
                process.kill()
            time.sleep(0.2)
    if live:
        print("\r\033[K", end="", file=sys.stderr)
    if process.returncode:
        raise Failure(f"{what}: failed ({_last_line(log, start)}); all of it is in {log}")
    print(f"  {what}: done in {time.monotonic() - began:.0f} s", file=sys.stderr)


def _last_line(log, start):
    """The newest line of a log after byte ``start``, shortened."""
    with open(log, "rb") as file:
        file.seek(max(start, log.stat().st_size - 2000))
        lines = [line for line in file.read().decode("utf-8", "replace").splitlines() if line.strip()]
    return lines[-1].strip()[:90] if lines else ""


def _exports(root, venv, prefix, sourced):
    """The shell text that makes the environment."""
    messages = next((prefix / "lib").glob("python3*/site-packages"), prefix / "lib")
    local = list((prefix / "local" / "lib").glob("python3*/dist-packages"))
    messages = local[0] if local else messages
    which = f"ROS 2 {sourced}, as sourced." if sourced else \
        "ROS 2 Jazzy from the Python package index, in .venv (none is sourced here)."
    lines = [
        f'export VIRTUAL_ENV="{venv}"', 'export PATH="$VIRTUAL_ENV/bin:$PATH"', f'export MICROSTAGE_ROS="{which}"', f'export MICROSTAGE_ROOT="{root}"',
        f'export PYTHONPATH="{root}:{messages}${{PYTHONPATH:+:$PYTHONPATH}}"',
        f'export LD_LIBRARY_PATH="{prefix}/lib:{venv}/lib${{LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}}"',
    ]
    if sourced:
        lines.append(f'export AMENT_PREFIX_PATH="{prefix}:$AMENT_PREFIX_PATH"')
    else:
        lines += [f'export AMENT_PREFIX_PATH="{prefix}:{venv}"', f'export CMAKE_PREFIX_PATH="{venv}"']
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
