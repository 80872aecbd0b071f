"""The driver's compiled control periods (`driver_loop`) with everything that they work on."""

from typing import NamedTuple

import numpy as np

from microstage_ros.hardware.limits import LIMITS, MEMORY, look
from microstage_ros.hardware.watchdog import WORDS
from microstage_ros.numerics.compiled import called_from_c, kind_of
from microstage_ros.ros.loops.driver_loop import (
    COUNTS,
    LINKS,
    TRAVEL,
    VALUES,
    on_message,
    run_periods,
)
from microstage_ros.ros.loops.period_timing import GRACE, SHORT_TIMER
from microstage_ros.ros.transport.block_buffer import new_ring
from microstage_ros.ros.transport.blocks import Refusals
from microstage_ros.ros.transport.c_calls import INFO_WORDS, Frame, load_libraries
from microstage_ros.ros.transport.response_times import ResponseTimes
from microstage_ros.ros.transport.scheduling import SPIN
from microstage_ros.ros.transport.work_handover import SIZE, Handover

COUNTERS = frozenset(COUNTS.names or ())
FRAMES = (("AxisState",), ("SimulationTruth",), ("VoltageCommand",), ("Clock", "rosgraph_msgs"))


def timing(period, rate, slice_s, paced, priority, hold=0.004, trip=0.25):
    """Entries of `COUNTS` that tell how to keep time.

    Parameters
    ----------
    period : control period [s]. rate : times real time [1], 0 for as fast as it goes. slice_s : longest wait [s].
    paced : whether by the wall clock. priority : real-time priority of the thread [1], 0 if it has none.
    hold : longest time without a valid command with voltage [s]. trip : the same without a fault [s].
    """
    short = paced and period < SHORT_TIMER
    rate = 1.0 if paced else rate
    spin = period if short else SPIN
    seconds = {"pace_ns": period / rate if rate else 0.0, "slice_ns": slice_s, "spin_ns": spin, "waking_ns": spin,
               "grace_ns": GRACE if short else 0.0, "hold_ns": hold, "ahead_ns": 0.0 if short or not paced else period,
               "trip_ns": trip}
    return {name: round(value * 1e9) for name, value in seconds.items()} | {"priority": priority if short else 0}


def load(arrays):
    """Load or make the compiled code now and not in the first control period; ``arrays``: `SimulatedAxis.arrays`."""
    load_libraries()
    frames = [Frame(*name) for name in FRAMES]
    rings = tuple(new_ring(1, len(frame.raw)) for frame in frames[:2])
    records = np.zeros(1, LINKS), np.zeros(1, COUNTS), np.zeros(1, VALUES)
    work = new_work(
        np.ones(1, np.int64), records, arrays, frames, rings, ResponseTimes(), new_guard(frames[2], _no_watch())
    )
    look(np.zeros(1, LIMITS), np.zeros(1, MEMORY), 0.0, 0.0, 0.0, 0.0)
    run_periods(np.zeros(SIZE, np.int64), work, np.zeros(2, np.int64))
    called_from_c(on_message, kind_of(work))
    run_periods.disable_compile()  # other types would be no work for `on_message`


def new_guard(command, watch):
    """What `run_periods` takes as its guard; ``command``: `Frame` of the commands; ``watch``: `Watch`."""
    return (
        watch.words,
        watch.volts,
        np.zeros(INFO_WORDS, np.int64),
        watch.holder,
        command.length,
        watch.limits,
        watch.memory,
    )


class Watch(NamedTuple):
    """What watches the compiled loop: shared memory of `OutputGuard`, words of `identity.Holder`, records of
    `hardware.limits`."""

    words: np.ndarray
    volts: np.ndarray
    holder: np.ndarray
    limits: np.ndarray
    memory: np.ndarray


def _no_watch():
    words = np.zeros(WORDS, np.int64)
    return Watch(words, words.view(np.float64), np.zeros(2, np.int64), np.zeros(1, LIMITS), np.zeros(1, MEMORY))


def new_work(stop, records, arrays, frames, rings, responses, guard):
    """What `run_periods` takes as its work.

    Parameters
    ----------
    stop : word that ends it, shape (1,). records : links, counts, values. arrays : `SimulatedAxis.arrays`.
    frames : four of `Frame`. rings : of `new_ring`, one per topic, shape (2,).
    responses : `ResponseTimes`. guard : tuple of `new_guard`.
    """
    return (stop, *records, *arrays, tuple(frame.message for frame in frames), tuple(frame.raw for frame in frames[:2]),
            rings, (responses.counts, responses.longest), np.zeros(2, np.int64), guard)


class QuickPeriods:
    """`run_periods` with everything that it works on.

    Parameters
    ----------
    servo, reader : `FastServoPath` and its reader of commands. sender : semaphore of who sends the blocks. topics :
        `DriverTopics`. gate : `CommandGate`. stop : int64 (1,), 1 while another thread asks for something. responses :
        `ResponseTimes`. machine : `SimulatedAxis`. settings : field of `COUNTS` or `VALUES` to its constant
        value. watch : `Watch`.

    Attributes
    ----------
    state, command : frames of what was sent and came last.
    answered, late, lost, overruns, zeroed, host_stops, host_stopped_ns, foreign, malformed : counters of all periods in
        compiled code, beside those of the gate; they may be read by any thread while the loop goes on, as may
        `sequence` and `time_ns`.
    """

    def __init__(self, servo, reader, sender, topics, gate, stop, responses, machine, settings, watch):
        load_libraries()
        self.machine, arrays = machine, machine.own_arrays
        self._topics, self._gate, self._refused = topics, gate, Refusals(topics.states)
        self._frames = [Frame(*name) for name in FRAMES]
        self.state, _, self.command, _ = self._frames
        self._links, self._counts, self._values = np.zeros(1, LINKS), np.zeros(1, COUNTS), np.zeros(1, VALUES)
        state, truth, command, clock = (frame.address for frame in self._frames)
        self._links[0] = (topics.states.address, state, topics.truths.address, truth, topics.clock_address, clock,
                          reader.address, command, servo.semaphore.address.value, sender.address.value)
        for name, value in settings.items():
            (self._counts if name in COUNTERS else self._values)[name] = value
        self._work = new_work(stop, (self._links, self._counts, self._values), arrays, self._frames,
                              (topics.states.ring, topics.truths.ring), responses,
                              new_guard(self.command, watch))
        self._counts["command_bytes"] = len(self.command.raw)
        load(arrays)
        self._handover, self._times = Handover(on_message, self._work, servo), np.zeros(2, np.int64)
        self._handover.answer(reader)

    def grant(self, credit):
        """Periods up to number ``credit`` [1] may begin; heard by the running loop."""
        self._counts["credit"] = credit

    def look_for_listeners(self):
        """Begin or end to send the simulated instruments singly, renew a publisher that refuses; while the loop goes
        on."""
        self._refused.look(self._counts, self._links, "states")
        self._counts["truth_listened"] = self._topics.truths.listeners if self._topics.truths is not None else 0

    def run(self, sequence, credit, due, valid_ns):
        """Control periods after number ``sequence`` [1]. Returns why it ended; the gate is as after these periods.

        Parameters
        ----------
        credit : number of the last period that may begin [1]. due : when the next one is due [s], by
            time.perf_counter, None for now. valid_ns : when the last valid command came [ns of the monotonic clock].
        """
        c, v, gate = self._counts[0], self._values[0], self._gate
        c["valid_ns"] = valid_ns
        c["sequence"], c["credit"], c["due_ns"] = sequence, credit, 0 if due is None else round(due * 1e9)
        c["held"] = c["silent"] = gate.last != gate.period
        c["last"] = gate.last
        c["truth_listened"] = self._topics.truths.listeners
        v["voltage"], v["command"] = gate.voltage, gate.command
        why = run_periods(self._handover.words, self._work, self._times)
        gate.voltage, gate.command = float(v["voltage"]), float(v["command"])
        gate.saturated = gate.voltage != gate.command
        gate.placed = gate.placed or gate.last != int(c["last"])
        gate.last, gate.valid_ns = int(c["last"]), int(c["valid_ns"])
        gate.begin(self.sequence - (why == TRAVEL))
        return why

    def __getattr__(self, name):
        if name in COUNTERS:
            return int(self._counts[name][0])
        raise AttributeError(name)
