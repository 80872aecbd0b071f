"""What needs ROS 2."""

import contextlib
import ctypes
import os
from pathlib import Path

# A wait of Fast DDS 2.14 that can spin for ever is replaced before the middleware is loaded: `msg_defs/set_listener.c`.
# Where another version is, or another middleware, nothing is.
if any((Path(folder) / "libfastrtps.so.2.14").exists() for folder in os.environ.get("LD_LIBRARY_PATH", "").split(":")):
    with contextlib.suppress(OSError):
        ctypes.CDLL("libmicrostage_set_listener.so", mode=ctypes.RTLD_GLOBAL)
