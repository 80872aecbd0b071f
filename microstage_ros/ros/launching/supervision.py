"""The watch over the processes of an axis: who ended is named and, where it may be, started again.

Observer, logger, recorder and move server may be started again while the axis goes on; they take their place again.
Driver and controller may not: without either of them the axis stands at zero volts, and a person decides.
"""

import os
import socket
import sys
import threading
import time

from microstage_ros.ros.launching.cell_processes import CellFailure

RESTARTED = ("gms_observer", "interferometer_logger", "move_server", "bag_recorder")
MOST_RESTARTS, WITHIN_S = 5, 60.0
"""More ends of one process than this in this time [s] are no accident."""

GIVEN_UP = ("bag_recorder",)
"""Without these the axis goes on where they end again and again, as the recorder does on a full disk."""

STOPPED_S = 5.0
"""A process that has been stopped by a signal for so long [s] is started anew."""


LEAVING_S = 1.0
"""Longest wait [s] for the middleware when the process leaves."""


class Supervisor:
    """Looks after the processes of one cell.

    Parameters
    ----------
    cell : `CellProcesses`. node : rclpy node to publish `cell_status` with.
    tell : called with one line for people.
    """

    def __init__(self, cell, node, tell=lambda text: print(text, file=sys.stderr, flush=True)):
        from microstage_msgs.msg import AxisState, CellStatus
        from microstage_msgs.srv import Trip

        from microstage_ros.ros.transport import topics

        self._cell, self._node, self._tell = cell, node, tell
        self._message, self._trip_request, self._fault = CellStatus, Trip.Request, AxisState.FAULT_PROCESS
        self._publisher = node.create_publisher(CellStatus, topics.CELL_STATUS, topics.LATCHED)
        self._trip = node.create_client(Trip, topics.TRIP)
        self._restarts = {name: [] for name in cell.processes}
        self._stopped_since, self._since, self._published = {}, time.time_ns(), None
        self._given_up: dict[str, str] = {}
        self._publish("")

    def look(self):
        """See who has ended or stands still; start again what may be. Raises `CellFailure` where the axis cannot go
        on."""
        missing = []
        if self._cell.server_status is not None:
            says = f"the process that starts the nodes ended {_how(self._cell.server_status)}, and with it all nodes"
            self._publish(says)
            raise CellFailure(f"{says}: the axis stands still at zero volts")
        for name, process in list(self._cell.processes.items()):
            status = process.poll()
            if name in self._given_up:
                missing.append(self._given_up[name])
            elif status is not None:
                missing.append(self._ended(name, process, status))
            elif process.stopped:
                missing.append(self._stands_still(name, process))
            else:
                self._stopped_since.pop(name, None)
        self._publish("; ".join(missing))

    def _ended(self, name, process, status):
        how = _how(status)
        if name not in RESTARTED:
            self._publish(f"{name} ended {how}")
            self._trip.call_async(self._trip_request(fault=self._fault, message=f"{name} ended {how}"))
            raise CellFailure(f"{name} ended {how}: the axis stands still at zero volts{self._cell.last_words(name)}")
        ends = [time.monotonic(), *(at for at in self._restarts[name] if time.monotonic() - at < WITHIN_S)]
        self._restarts[name] = ends
        if len(ends) > MOST_RESTARTS:
            says = (f"{name} ended {len(ends)} times in {WITHIN_S:.0f} s, the last time {how}"
                    f"{self._cell.last_words(name)}")
            if name not in GIVEN_UP:
                raise CellFailure(says)
            self._given_up[name] = f"{says}; the axis goes on without it"
            self._tell(self._given_up[name])
            return self._given_up[name]
        self._tell(f"{name} ended {how}; started again")
        self._cell.restart(name)
        return f"{name} ended {how} and is started again"

    def _stands_still(self, name, process):
        since = self._stopped_since.setdefault(name, time.monotonic())
        if name in RESTARTED and time.monotonic() - since > STOPPED_S:
            process.kill()
        return f"{name} is stopped by a signal"

    def _publish(self, missing):
        """Say how everything is, when it has changed."""
        kind, processes = self._message, self._cell.processes
        all_gone = self._cell.server_status is not None
        states = [
            kind.STATE_ENDED
            if all_gone or process.returncode is not None
            else kind.STATE_STOPPED
            if process.stopped
            else kind.STATE_RUNNING
            for process in processes.values()
        ]
        numbers = [process.reported_pid or 0 for process in processes.values()]
        found = (tuple(processes), tuple(states), tuple(numbers), missing)
        if found == self._published:
            return
        self._published = found
        stamp, since = kind().stamp, kind().since
        stamp.sec, stamp.nanosec = divmod(time.time_ns(), 1_000_000_000)
        since.sec, since.nanosec = divmod(self._since, 1_000_000_000)
        self._publisher.publish(
            kind(
                stamp=stamp,
                since=since,
                host=socket.gethostname(),
                process=os.getpid(),
                names=list(processes),
                states=states,
                processes=numbers,
                restarts=[len(self._restarts.get(name, ())) for name in processes],
                message=missing,
            )
        )


def _how(status):
    return f"by signal {-status}" if status < 0 else f"with status {status}"


def run_until_interrupted(supervisor, spin, interruption, every=0.05):
    """Look after the processes until ``interruption`` (an `Interruption`) has come, which raises KeyboardInterrupt;
    ``spin(seconds)`` passes the time, ``every`` [s] between two looks."""
    while True:
        interruption.check()
        supervisor.look()
        spin(every)


def leave_graph(node, within=LEAVING_S):
    """Take ``node`` out of the graph and shut ROS down, in a thread that is waited for at most ``within`` [s]: the
    middleware may wait for a lock whose holder was killed, and by now nothing depends on it. True if it was in time."""
    import rclpy

    def leave():
        node.destroy_node()
        rclpy.try_shutdown()

    thread = threading.Thread(target=leave, name="leaving", daemon=True)
    thread.start()
    thread.join(within)
    return not thread.is_alive()
