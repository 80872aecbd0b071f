"""The controller's answers in compiled code, as long as the states are plain.

`answer` does what `StrController` does in Python for one state, state after state, and returns to it for
everything else: silence, a fault, a state sent once more, a request.
"""

import math

import numpy as np

from microstage_ros.control.laws.registry import controller_step
from microstage_ros.control.trajectories.reference_player import HOLDING, MOVING, STOPPING
from microstage_ros.numerics.compiled import called_from_c, in_place, kind_of
from microstage_ros.ros.transport.block_buffer import close, crowded, keep, new_ring
from microstage_ros.ros.transport.blocks import Refusals
from microstage_ros.ros.transport.c_calls import (
    INFO_WORDS,
    MONOTONIC,
    Frame,
    known,
    load_libraries,
    now,
    post,
    publish,
    take_from,
)
from microstage_ros.ros.transport.work_handover import (
    SIZE,
    WAITING,
    Handover,
    handover_of,
    hand_back,
    end_work,
    hand_over,
    may_take,
    begin_work,
)

CROWDED, ASKED, NOTHING_CAME, STRANGE = range(4)
"""Why `answer` returned. STRANGE: the state in its frame has to be answered by the caller."""

COUNTS = np.dtype([(name, "i8") for name in (
    "last", "start", "stopping", "every", "block", "inside_block", "inside_listened", "patience_ns", "moment_ns",
    "foreign", "malformed", "state_bytes", "refused")])
LINKS = np.dtype([(name, "u8") for name in (
    "states", "state", "commands", "command", "insides", "inside", "sender")])
"""Addresses: of the subscription and its frame, of publishers and their frames, of the sender's semaphore."""

FRAMES = ("AxisState", "VoltageCommand", "ControllerState")
SENDER = 1
ALL, POSITIONS = 2**62, 5
MOST = 2**62
"""Numbers of control periods are smaller."""
LOCKSTEP = 2  # AxisState.STATUS_LOCKSTEP


@in_place
def mode_at(index, size, stopping):
    """The mode at place ``index`` of a plan, as `ReferencePlayer`."""
    if not 0 <= index < size - 1:
        return HOLDING
    return STOPPING if stopping else MOVING


@in_place
def fill_inside(message, state, n, reference, mode, memory):
    """ControllerState, as `Controller.state` tells it."""
    pid = memory.pid
    message["header.stamp.sec"], message["header.stamp.nanosec"] = (
        state["header.stamp.sec"],
        state["header.stamp.nanosec"],
    )
    message["sequence"], message["position"], message["reference"] = n, state["position"], reference
    message["error"] = pid.error
    message["proportional_gain"], message["integral_gain"], message["derivative_gain"] = pid.kp, pid.ki, pid.kd
    message["proportional_term"], message["integral_term"] = pid.proportional_term, pid.integral
    message["derivative_term"], message["feedforward_term"] = pid.derivative_term, memory.feed_forward
    message["voltage"], message["mode"], message["saturated"] = memory.voltage, mode, pid.saturated != 0
    watched = memory.supervision
    message["law"], message["law_reason"], message["handovers"] = watched.law, watched.reason, watched.handovers


@in_place
def take_state(links, c, guard):
    """The oldest state that waits and comes from the driver of the axis, whole, into its frame; False if none does."""
    info, holder, length = guard
    while take_from(links.states, links.state, info):
        if not known(info, holder):
            c.foreign += 1
        elif length[0] < c.state_bytes:
            c.malformed += 1
        else:
            return True
    return False


@in_place
def answer_state(stop, links, c, parameters, memories, positions, frames, raws, rings, guard):
    """Answer the state in its frame. WAITING, or why the loop ends."""
    links, c, state, command, inside = links[0], c[0], frames[0][0], frames[1][0], frames[2][0]
    n = np.int64(state["sequence"])
    if state["fault"] != 0 or n <= c.last or n > MOST or not math.isfinite(state["position"]):
        return STRANGE
    index = n - c.start
    reference = positions[min(max(index, 0), positions.size - 1)]
    command["voltage"] = controller_step(parameters[0], memories[0], reference, state["position"], state["current"])
    command["header.stamp.sec"] = state["header.stamp.sec"]
    command["header.stamp.nanosec"] = state["header.stamp.nanosec"]
    command["sequence"], command["reference"], command["sender"] = n, reference, SENDER
    if not publish(links.commands, links.command):
        c.refused += 1
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
        if state["status"] & LOCKSTEP:  # else who sends looks by itself, see `driver_loop.end_period`
            post(links.sender)
        if crowded(rings[0]) or crowded(rings[1]):
            return CROWDED
    return ASKED if stop[0] else WAITING


@in_place
def answer_waiting(work, most):
    """Answer at most so many of the states that wait. WAITING, or why the loop ends; ``work`` as in `answer`."""
    links, c, guard, why = work[1][0], work[2][0], work[9], WAITING
    while why == WAITING and most > 0 and take_state(links, c, guard):
        why = answer_state(*work)
        most -= 1
    return why


@in_place
def answer(handover, work, times):
    """Answer states until one of the reasons at the top.

    Parameters
    ----------
    handover : `work_handover.Handover.words`.
    work : stop, int64 of shape (1,), made 1 by another thread that asks for something; links and counts, records above;
        parameters and memories of the law, arrays of one; positions, the plan [m], `start` its first period; messages
        of state, command and inside (`c_calls.Frame.message`); bytes of the last two; blocks of the last two
        (`kept_rows`); the guard: int64 (INFO_WORDS,), the driver's `identity.Holder.words`, length of the state.
    times : int64 (2,), to work in.
    """
    stop, c = work[0], work[2][0]
    begin_work(handover)
    why, woken, before = WAITING, True, c.last
    while why == WAITING and stop[0] == 0:
        why = answer_waiting(work, ALL)
        if why == WAITING and not woken and c.last == before:
            why = NOTHING_CAME
        elif why == WAITING:
            before = c.last
            woken, why = hand_over(handover, work, now(MONOTONIC, times) + c.patience_ns, times)
    end_work(handover)
    return ASKED if why == WAITING else why


def on_message(work, count):
    """A state has come, or ``count`` [1] of them: answered where it came, unless the loop's thread is needed."""
    handover = handover_of(work)
    if may_take(handover):
        hand_back(handover, answer_waiting(work[0], np.int64(count)))


def new_work(stop, links, counts, records, positions, frames, rings, holder):
    """What `answer` takes as its work.

    Parameters
    ----------
    stop : word that ends it, shape (1,). links, counts : of shape (1,), one record each. records : of the law.
    positions : of the plan [m], shape (n,). frames : three of `Frame`.
    rings : of `new_ring`, one per topic, shape (2,). holder : words of `Holder`, shape (2,).
    """
    return (stop, links, counts, *records, positions, tuple(frame.message for frame in frames),
            tuple(frame.raw for frame in frames[1:]), rings, (np.zeros(INFO_WORDS, np.int64), holder, frames[0].length))


def load(records):
    """Load or make the compiled code before anybody waits for an answer; ``records``: `Controller.arrays`."""
    load_libraries()
    frames = [Frame(name) for name in FRAMES]
    rings = tuple(new_ring(1, len(frame.raw)) for frame in frames[1:])
    work = new_work(np.ones(1, np.int64), np.zeros(1, LINKS), np.zeros(1, COUNTS), records, np.zeros(1), frames, rings,
                    np.zeros(2, np.int64))
    answer(np.zeros(SIZE, np.int64), work, np.zeros(2, np.int64))
    called_from_c(on_message, kind_of(work))
    answer.disable_compile()  # other types would be no work for `on_message`


class QuickAnswers:
    """`answer` with everything that it works on.

    Parameters
    ----------
    servo, reader : `FastServoPath` and its reader of states. sender : semaphore of who sends the blocks. commands,
        insides : `Outlet`. controller, player : the law and the reference. requests : `Requests`. every, block :
        periods between two messages of `insides`, and in a block. holder : words of the driver's `Holder`. moment :
        longest wait [s] for the next state of a running axis.
    """

    def __init__(
        self, servo, reader, sender, commands, insides, controller, player, requests, every, block, moment, holder
    ):
        load_libraries()
        self._insides, self._player, self._stop = insides, player, requests.asked
        self._refused = Refusals(commands)
        self._frames = [Frame(name) for name in FRAMES]
        self.state, self.command, _ = state, command, inside = self._frames
        self._links, self._counts = np.zeros(1, LINKS), np.zeros(1, COUNTS)
        self._links[0] = (reader.address, state.address, commands.address, command.address, insides.address,
                          inside.address, sender.address.value)
        settings = {
            "every": every,
            "block": block,
            "inside_block": max(block // 2, 1),
            "moment_ns": round(moment * 1e9),
        }
        for name, value in settings.items():  # a move server holds time still until it has heard of a period
            self._counts[name] = value
        self._work = new_work(self._stop, self._links, self._counts, controller.arrays, np.zeros(1), self._frames,
                              (commands.ring, insides.ring), holder)
        self._counts["state_bytes"] = len(self.state.raw)
        load(controller.arrays)
        self._handover, self._times = Handover(on_message, self._work, servo), np.zeros(2, np.int64)
        self._handover.answer(reader)

    @property
    def last(self):
        """The last period answered; by any thread."""
        return int(self._counts["last"][0])

    def look_for_listeners(self):
        """Begin or end to send `controller_state` singly, renew a publisher that refuses; while the loop goes on."""
        self._refused.look(self._counts, self._links, "commands")
        self._counts["inside_listened"] = self._insides.listeners

    @property
    def ready(self):
        """True once the player has a plan."""
        return self._player.plan[0] is not None

    def run(self, last, patience):
        """Answer states after period number ``last`` [1], as long as they come within ``patience`` [s].

        Returns why it ended, and the number of the last period answered [1].
        """
        c = self._counts[0]
        positions, c["start"], c["stopping"] = self._player.plan
        c["last"], c["patience_ns"] = last, round(patience * 1e9)
        c["inside_listened"] = self._insides.listeners
        work = (*self._work[:POSITIONS], positions, *self._work[POSITIONS + 1:])
        why = answer(self._handover.words, work, self._times)
        self._player.passed(int(c["last"]))
        return why, int(c["last"])
