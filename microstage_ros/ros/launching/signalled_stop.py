"""Stopping a driver of this computer by a signal: at once, without ROS, without discovery."""

import os
import signal

from microstage_ros.ros.launching.ownership import lock_file, owner


def signal_stop(namespace):
    """Have the driver of an axis on this computer take the voltage away now, without waiting for discovery.

    Returns
    -------
    bool
        True if there is such a driver.
    """
    found = owner(lock_file("driver", namespace))
    if not found:
        return False
    try:
        os.kill(int(found["process"]), signal.SIGUSR1)
    except (OSError, KeyError, ValueError, TypeError):
        return False
    return True
