"""The controller's answers in compiled code, as long as the states are plain.

`answer` does what `StrController` does in Python for one state, state after state, and returns to it for
everything else: silence, a fault, a state sent once more, a request.
"""

import numpy as np

from microstage_ros.axis.compiled import compiled
from microstage_ros.control.laws import controller_step
from microstage_ros.control.reference_player import HOLDING, MOVING, STOPPING
from microstage_ros.nodes.c_calls import MONOTONIC, Frame, load_libraries, now, post, publish, take, wait
from microstage_ros.nodes.kept_rows import close, crowded, keep, new_ring

CROWDED, ASKED, QUIET, STRANGE = range(4)
"""Why `answer` returned. STRANGE: the state in its frame has to be answered by the caller."""

COUNTS = np.dtype([(name, "i8") for name in (
    "last", "start", "stopping", "every", "block", "inside_block", "inside_listened", "patience_ns", "moment_ns")])
LINKS = np.dtype([(name, "u8") for name in (
    "states", "state", "commands", "command", "insides", "inside", "semaphore", "sender")])
"""Addresses: of the subscription and its frame, of publishers and their frames, of the semaphore, the sender's."""

FRAMES = ("AxisState", "VoltageCommand", "ControllerState")
SENDER = 1
LOCKSTEP = 2  # AxisState.STATUS_LOCKSTEP


@compiled
def mode_at(index, size, stopping):
    """The mode at place ``index`` of a plan, as `ReferencePlayer`."""
    if not 0 <= index < size - 1:
        return HOLDING
    return STOPPING if stopping else MOVING


@compiled
def fill_inside(message, state, n, reference, mode, memory):
    """ControllerState, as `Controller.state` tells it."""
    pid = memory.pid
    message["header.stamp.sec"], message["header.stamp.nanosec"] = state["header.stamp.sec"], state["header.stamp.nanosec"]
    message["sequence"], message["position"], message["reference"] = n, state["position"], reference
    message["error"] = pid.error
    message["proportional_gain"], message["integral_gain"], message["derivative_gain"] = pid.kp, pid.ki, pid.kd
    message["proportional_term"], message["integral_term"] = pid.proportional_term, pid.integral
    message["derivative_term"], message["feedforward_term"] = pid.derivative_term, memory.feed_forward
    message["voltage"], message["mode"], message["saturated"] = memory.voltage, mode, pid.saturated != 0


@compiled
def answer(stop, links, c, parameters, memories, positions, frames, raws, rings, times):
    """Answer states until one of the reasons at the top.

    Parameters
    ----------
    stop : int64 of shape (1,), made 1 by another thread that asks for something. links, c : records above.
    parameters, memories : of the law, arrays of one. positions : the plan [m], `c.start` its first period.
    frames : messages of state, command and inside (`c_calls.Frame.message`). raws : bytes of the last two.
    rings : blocks of the last two (`kept_rows`). times : int64 (2,), to work in.
    """
    links, c = links[0], c[0]
    state, command, inside = frames[0][0], frames[1][0], frames[2][0]
    while stop[0] == 0:
        if not take(links.states, links.state):
            if not wait(links.semaphore, now(MONOTONIC, times) + c.patience_ns, times):
                return QUIET
            continue
        n = np.int64(state["sequence"])
        if state["fault"] != 0 or n <= c.last:
            return STRANGE
        index = n - c.start
        reference = positions[min(max(index, 0), positions.size - 1)]
        command["voltage"] = controller_step(parameters[0], memories[0], reference, state["position"], state["current"])
        command["header.stamp.sec"] = state["header.stamp.sec"]
        command["header.stamp.nanosec"] = state["header.stamp.nanosec"]
        command["sequence"], command["reference"], command["sender"] = n, reference, SENDER
        publish(links.commands, links.command)
        c.last, c.patience_ns = n, c.moment_ns
        keep(rings[0], raws[0], n)
        if n % c.every == 0:
            fill_inside(inside, state, n, reference, mode_at(index, positions.size, c.stopping), memories[0])
            if c.inside_listened:
                publish(links.insides, links.inside)
            keep(rings[1], raws[1], n)
        if (n + 1) % c.inside_block == 0:
            close(rings[1])
            if (n + 1) % c.block == 0:
                close(rings[0])
            if state["status"] & LOCKSTEP:  # else who sends looks by itself, see `driver_loop.run_periods`
                post(links.sender)
            if crowded(rings[0]) or crowded(rings[1]):
                return CROWDED
    return ASKED


def load(records):
    """Load or make the compiled code before anybody waits for an answer; ``records``: `Controller.arrays`."""
    load_libraries()
    frames = [Frame(name) for name in FRAMES]
    rings = tuple(new_ring(1, len(frame.raw)) for frame in frames[1:])
    answer(np.ones(1, np.int64), np.zeros(1, LINKS), np.zeros(1, COUNTS), *records, np.zeros(1),
           tuple(frame.message for frame in frames), tuple(frame.raw for frame in frames[1:]), rings, np.zeros(2, np.int64))


class QuickAnswers:
    """`answer` with everything that it works on.

    Parameters
    ----------
    servo, reader : `FastServoPath` and its reader of states. sender : semaphore of who sends the blocks. commands,
        insides : `Outlet`. controller, player : the law and the reference. requests : `Requests`. every, block :
        periods between two messages of `insides`, and in a block. moment : longest wait [s] for the next state of a running axis.
    """

    def __init__(self, servo, reader, sender, commands, insides, controller, player, requests, every, block, moment):
        load_libraries()
        self._insides, self._player, self._stop = insides, player, requests.asked
        self._records = controller.arrays
        self._frames = [Frame(name) for name in FRAMES]
        self.state, self.command, _ = state, command, inside = self._frames
        self._links, self._counts = np.zeros(1, LINKS), np.zeros(1, COUNTS)
        self._links[0] = (reader.address, state.address, commands.address, command.address, insides.address,
                          inside.address, servo.semaphore.address.value, sender.address.value)
        settings = {"every": every, "block": block, "inside_block": max(block // 2, 1), "moment_ns": round(moment * 1e9)}
        for name, value in settings.items():  # a move server holds time still until it has heard of a period
            self._counts[name] = value
        self._views = (tuple(frame.message for frame in self._frames), (command.raw, inside.raw),
                       (commands.ring, insides.ring), np.zeros(2, np.int64))
        load(self._records)

    @property
    def ready(self):
        """True once the player has a plan."""
        return self._player.plan[0] is not None

    def run(self, last, patience):
        """Answer states after period ``last``. Returns why it ended, and the last period answered."""
        c = self._counts[0]
        positions, c["start"], c["stopping"] = self._player.plan
        c["last"], c["patience_ns"] = last, round(patience * 1e9)
        c["inside_listened"] = self._insides.listeners
        why = answer(self._stop, self._links, self._counts, *self._records, positions, *self._views)
        self._player.passed(int(c["last"]))
        return why, int(c["last"])
