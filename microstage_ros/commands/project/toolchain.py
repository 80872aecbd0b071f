"""What compiles the interfaces: the machine's C and C++ compilers, or Zig's from the Python package index.

Looked for before anything is downloaded, so that a machine that cannot do it is reported at once. Standard library
alone.
"""

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import NamedTuple

COMPILERS = (("cc", "gcc", "clang"), ("c++", "g++", "clang++"))
"""Names of C and of C++ compilers, the usual one first."""

ZIG_TARGETS = {"x86_64": "x86_64-linux-gnu.2.28", "aarch64": "aarch64-linux-gnu.2.28"}
"""What Zig builds for: the C library that the wheels of ROS 2 are built for (manylinux_2_28)."""

WRAPPER = """\
#!/bin/sh
exec "{zig}" {words} "$@"
"""


class Toolchain(NamedTuple):
    """How the interfaces are compiled.

    Attributes
    ----------
    says : in words. packages : to install from the package index first. headers : Python.h is here already.
    """

    says: str
    packages: tuple
    headers: bool

    @property
    def zig(self):
        """Whether the compiler comes from the package index."""
        return "ziglang" in self.packages

    @property
    def generator(self):
        """Arguments for CMake: Ninja where the package index provides it or the machine has no make."""
        return ["-G", "Ninja"] if "ninja" in self.packages or not shutil.which("make") else []


def find(headers=None):
    """The `Toolchain` of this machine; nothing is downloaded. ``headers``: where Python.h would be (default: this
    Python's)."""
    packages: tuple[str, ...] = ()
    found = [next(filter(None, map(shutil.which, names)), None) for names in COMPILERS]
    if not all(found):
        packages = ("ziglang",)
    if not (shutil.which("make") or shutil.which("ninja")):
        packages += ("ninja",)
    says = (
        "C and C++ compilers of this machine"
        if all(found)
        else "no C and C++ compiler here: Zig's, from the Python package index"
    )
    headers = Path(headers or sysconfig.get_path("include"))
    return Toolchain(says, packages, (headers / "Python.h").is_file())


def can_fetch_headers():
    """Whether Python.h can be had without root: Debian's own package, unpacked into a folder of ours."""
    return bool(shutil.which("apt-get") and shutil.which("dpkg-deb"))


def headers_package():
    """Name of Debian's package with this Python's headers."""
    return f"libpython{sys.version_info[0]}.{sys.version_info[1]}-dev"


def fetch_headers(folder):
    """Unpack Debian's package of Python's headers into ``folder``; no root needed.

    Returns
    -------
    list of Path : folders for the compiler's search, an empty list if it could not be had.
    """
    folder.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(["apt-get", "download", headers_package()], cwd=folder, capture_output=True, check=False)
    package = next(folder.glob("*.deb"), None)
    if done.returncode or package is None:
        return []
    subprocess.run(["dpkg-deb", "-x", str(package), str(folder)], check=True, capture_output=True)
    name = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    found = [folder / "usr/include" / name, folder / "usr/include"]
    return found if (found[0] / "Python.h").is_file() else []


def zig_wrappers(folder, python):
    """Write ``cc``, ``c++``, ``ar``, ``ranlib`` that are Zig's into ``folder``; returns the variables CMake and others
    read. Zig's own program is called, not its Python module, which would start a Python for each file."""
    asked = [str(python), "-c", "import pathlib, sysconfig, ziglang; "
             "print(pathlib.Path(ziglang.__file__).with_name('zig')); "
             "print(pathlib.Path(sysconfig.get_path('include')).parent)"]
    zig, headers = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.splitlines()
    target = ZIG_TARGETS.get(platform.machine())
    aim = f" -target {target}" if target else ""
    folder.mkdir(parents=True, exist_ok=True)
    aim += f' -idirafter "{headers}"'  # Debian's Python.h includes a file beside its folder, where Zig does not look
    for name, words in (("cc", f"cc{aim}"), ("c++", f"c++{aim}"), ("ar", "ar"), ("ranlib", "ranlib")):
        path = folder / name
        path.write_text(WRAPPER.format(zig=zig, words=words), encoding="utf-8")
        path.chmod(0o755)
    return {
        "CC": str(folder / "cc"),
        "CXX": str(folder / "c++"),
        "AR": str(folder / "ar"),
        "RANLIB": str(folder / "ranlib"),
        "PATH": f"{folder}{os.pathsep}{os.environ.get('PATH', '')}",
    }
