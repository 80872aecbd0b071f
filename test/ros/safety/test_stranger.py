"""A stranger is refused by DDS security: Fast DDS with its plugins, and the enclaves of `./microstage security`.

The Fast DDS of the wheels has no security plugins (`test_security.py` shows what a node says of that). Debian's has:
these tests run where its package `libfastrtps-dev` is installed, or unpacked at ``FASTDDS_PREFIX``.
"""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from ros_support import own_domain

from microstage_ros.ros.launching.keystore import Keystore

PREFIX = Path(os.environ.get("FASTDDS_PREFIX", "/usr"))
LIBRARIES = PREFIX / "lib" / "x86_64-linux-gnu"
LONGEST_S, LISTENED_S = 30, 5
"""Longest wait for a message that must come; how long is listened for one that must not."""
SOURCE = Path(__file__).with_name("stranger.cpp")

pytestmark = [
    pytest.mark.skipif(shutil.which("openssl") is None, reason="no program openssl"),
    pytest.mark.skipif(not (LIBRARIES / "libfastrtps.so").exists() or shutil.which("g++") is None,
                       reason="no Fast DDS with security plugins (package libfastrtps-dev) or no g++"),
]


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The program that writes or reads `command`."""
    path = tmp_path_factory.mktemp("stranger") / "stranger"
    include = PREFIX / "include"
    done = subprocess.run(
        ["g++", "-std=c++17", f"-I{include}", f"-I{include}/x86_64-linux-gnu", "-o", path, SOURCE, f"-L{LIBRARIES}",
         f"-Wl,-rpath,{LIBRARIES},-rpath-link,{LIBRARIES}", "-lfastrtps", "-lfastcdr"],
        capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return path


def hears(program, domain, reader, writer, seconds):
    """True if a message of the writer comes to the reader; both: an enclave's folder, or None without security."""
    place = {**os.environ, "LD_LIBRARY_PATH": str(LIBRARIES)}
    said = []
    for kind, enclave in (("read", reader), ("write", writer)):
        words = [str(program), kind, str(domain), str(seconds)] + ([str(enclave)] if enclave else [])
        said.append(subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=place))
    heard, _ = said[0].communicate(timeout=60)
    said[1].kill()
    said[1].communicate()
    return int(heard.split()[-1]) > 0


def test_a_stranger_is_refused_by_the_security_plugins(program, tmp_path):
    with own_domain() as domain:
        for name in ("keys", "others"):
            Keystore(tmp_path / name, "/axis", domain).make()
        ours, others = (tmp_path / name / "enclaves" / "axis" for name in ("keys", "others"))
        driver = ours / "axis_driver"
        assert hears(program, domain, driver, ours / "str_controller", LONGEST_S)
        assert hears(program, domain, None, None, LONGEST_S), "who is not secured hears everybody"
        for stranger in (None, others / "str_controller", ours / "gms_observer"):  # the last is known, but no commander
            assert not hears(program, domain, driver, stranger, LISTENED_S), stranger
