"""What needs ROS 2."""

import contextlib
import ctypes

# A wait of Fast DDS that spins, replaced before rclpy loads it: `msg_defs/set_listener.c`. Without it, as ever.
with contextlib.suppress(OSError):
    ctypes.CDLL("libmicrostage_set_listener.so", mode=ctypes.RTLD_GLOBAL)
