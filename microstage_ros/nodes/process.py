"""One node in one process: services and parameters in a thread, the servo loop in the main thread."""

import signal
import sys
import threading

import rclpy
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor

from microstage_ros.axis.errors import InputError
from microstage_ros.nodes.servo_path import RCLError

SWITCH_INTERVAL = 1e-4
"""How long the other thread may keep the interpreter [s]; Python's own 5 ms would be fifty control periods."""


def run_node(make, arguments=None, threads=1):
    """Make a node, serve it, run its `loop` until the process is asked to stop. Returns the exit status.

    Parameters
    ----------
    make : called without arguments; returns the node, which has `loop()` and `close()`.
    arguments : command line; default that of the process.
    threads : of the executor; more than one where callbacks wait for each other.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)  # background processes begin with it ignored
    rclpy.init(args=arguments)
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        node = make()
    except InputError as error:
        print(error, file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    executor = MultiThreadedExecutor(threads) if threads > 1 else SingleThreadedExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=_serve, args=(executor, node.get_logger()), daemon=True)
    thread.start()
    try:
        node.loop()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RCLError:
        if node.context.ok():  # otherwise: asked to stop in the middle of a call
            raise
    finally:
        node.close()
        rclpy.try_shutdown()
        thread.join(timeout=2.0)
    return 0


def _serve(executor, logger):
    """Serve until the process is asked to stop; a callback that fails is told, and the others go on."""
    while rclpy.ok():
        try:
            executor.spin_once(timeout_sec=0.5)
        except (KeyboardInterrupt, ExternalShutdownException):
            return
        except Exception as error:  # noqa: BLE001 - such as a lifecycle transition that does not exist
            if rclpy.ok():
                logger.error(f"a request failed: {type(error).__name__}: {error}")
