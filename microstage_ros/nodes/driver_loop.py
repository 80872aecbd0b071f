"""Control periods of a simulated axis in compiled code, as long as nothing out of the ordinary happens.

`run_periods` does what `AxisDriver` does in Python, period after period, and returns to it for everything else:
a missing or strange command, no credit, the encoder beyond its travel, a request. So every rule about faults stays
in one place (`hardware.command_gate`), and none of it costs time in good periods.
"""

import math
import os

import numpy as np

from microstage_ros.axis.compiled import compiled
from microstage_ros.axis.period import advance_and_read
from microstage_ros.nodes.c_calls import (
    MONOTONIC, REALTIME, Frame, load_libraries, now, post, publish, set_policy, sleep_until, take, wait,
)
from microstage_ros.nodes.kept_rows import close, crowded, keep, new_ring
from microstage_ros.nodes.response_times import ResponseTimes
from microstage_ros.nodes.scheduling import SPIN

GOOD, ASKED, CROWDED, NO_CREDIT, TRAVEL, WAITED, STRANGE, MISSED = range(8)
"""Why `run_periods` returned. From `TRAVEL` on, the period that is under way has to be ended by the caller:
TRAVEL: read, nothing sent. WAITED: no command within a slice (lockstep). STRANGE: a command that is no answer to
this period, nor, paced, to one just before. MISSED: more periods without a command than tolerated (paced)."""

COUNTS = np.dtype([(name, "i8") for name in (
    "sequence", "credit", "paced", "pace_ns", "due_ns", "slice_ns", "spin_ns", "waking_ns", "grace_ns", "priority", "block", "every", "status",
    "held", "silent", "truth_listened", "tolerated", "last", "answered", "late", "lost", "overruns", "begun_ns", "time_ns")])
VALUES = np.dtype([(name, "f8") for name in ("voltage", "limit", "low", "high", "period", "command")])
LINKS = np.dtype([(name, "u8") for name in (
    "states", "state", "truths", "truth", "clocks", "clock", "commands", "command", "semaphore", "sender")])
"""Addresses: of publishers and the frames they send, of the subscription, its frame, its semaphore, the sender's."""

FRAMES = (("AxisState",), ("SimulationTruth",), ("VoltageCommand",), ("Clock", "rosgraph_msgs"))

SATURATED, LATE = 4, 8

SHORT_TIMER, GRACE = 5e-4, 5e-3
"""A kernel timer shorter than a scheduler's tick has to be put into the hardware: 16 us on a virtual machine, a sixth of
a period at 10 kHz. So with periods shorter than the first figure [s] the loop spins until the next one is due, and waits
so much longer [s] for a command that is late: the next period begins late. After a period without any command periods
begin in time again. The time without a command after which the driver trips stays the same."""

RELAXED = 3
"""One in so many periods the loop spins as a normal thread: Linux takes the processor from real-time threads for 50 ms
if they keep it for more than 95 % of a second (`sched_rt_runtime_us`), the time spent spinning included."""

SPARE_NS, FORGET = 5_000, 64
"""With longer periods the loop sleeps, and wakes this much sooner [ns] than its sleeps are late: at once as late as the
latest, and forgetting it over so many periods. `spin_ns` is the most."""

REAL_TIME, NORMAL = os.SCHED_FIFO, os.SCHED_BATCH


@compiled
def hold_back(c, times):
    """Sleep until the next period is due; as `AxisDriver._hold_back`."""
    present = now(MONOTONIC, times)
    if c.due_ns == 0:
        c.due_ns = present
    c.due_ns += c.pace_ns
    if present > c.due_ns + c.pace_ns // 2:
        c.overruns += 1
        if present > c.due_ns + c.pace_ns:
            c.due_ns = present
    relaxed = c.priority > 0 and c.sequence % RELAXED == 0
    if relaxed:
        set_policy(NORMAL, 0, times)
    late = sleep_until(c.due_ns, min(c.spin_ns, c.waking_ns + SPARE_NS), times)
    if late > c.waking_ns:
        c.waking_ns = late
    elif late >= 0:
        c.waking_ns -= (c.waking_ns - late) // FORGET
    if relaxed:
        set_policy(REAL_TIME, c.priority, times)


@compiled
def fill_stamp(message, time_ns):
    """The header of a message."""
    message["header.stamp.sec"] = time_ns // 1_000_000_000
    message["header.stamp.nanosec"] = time_ns % 1_000_000_000


@compiled
def send_state(links, c, v, reading, message, raw, ring):
    """The state of period ``c.sequence``."""
    fill_stamp(message, c.time_ns)
    message["sequence"] = c.sequence
    message["position"] = reading.encoder
    message["applied_voltage"] = v.voltage
    message["current"] = reading.current
    message["motor_angle"] = reading.motor_angle
    message["status"] = c.status | (SATURATED if v.command != v.voltage else 0) | (LATE if c.held else 0)
    message["fault"] = 0
    publish(links.states, links.state)
    keep(ring, raw, c.sequence)


@compiled
def send_truth(links, c, plant_state, reading, message, raw, ring):
    """What only the simulation knows, as `SimulatedAxis.truth`."""
    fill_stamp(message, c.time_ns)
    message["sequence"] = c.sequence
    message["stage_position"] = plant_state.x
    message["stage_velocity"] = plant_state.v
    message["actuator_torque"] = plant_state.torque_friction
    message["guideway_force"] = plant_state.guide_friction
    message["interferometer_position"] = reading.interferometer
    message["air_temperature"] = reading.air_temperature
    message["air_pressure"] = reading.air_pressure
    message["air_humidity"] = reading.air_humidity
    message["stage_temperature"] = reading.stage_temperature
    if c.truth_listened:
        publish(links.truths, links.truth)
    keep(ring, raw, c.sequence)


@compiled
def await_command(links, c, v, command, times):
    """GOOD when the answer to the period is in force, else why not."""
    while True:
        if take(links.commands, links.command):
            n = np.int64(command["sequence"])
            if n > c.sequence or n <= c.last or not math.isfinite(command["voltage"]) or (n < c.sequence and not c.paced):
                return STRANGE
            c.last = n
            v.command = command["voltage"]
            v.voltage = min(max(v.command, -v.limit), v.limit)
            if n == c.sequence:
                return GOOD
            c.late += 1
            continue
        present = now(MONOTONIC, times)
        if c.paced:
            until = c.due_ns + c.pace_ns + (0 if c.silent else c.grace_ns)
            if present >= until:
                return MISSED
            wait(links.semaphore, until, times)
        elif not wait(links.semaphore, present + c.slice_ns, times):
            return WAITED


@compiled
def count_answer(c, responses, times):
    """The command for the period came; count how long it took, and whether that was within the period."""
    present = now(MONOTONIC, times)
    c.held, c.silent = c.paced and present > c.due_ns + c.pace_ns, 0
    if c.held:
        c.late += 1
    else:
        c.answered += 1
    counts, longest = responses
    taken = present - c.begun_ns
    counts[min(taken // 1000, len(counts) - 1)] += 1
    longest[0] = max(longest[0], taken)


@compiled
def run_periods(stop, links, c, v, plants, states, works, readings, frames, raws, rings, responses, times):
    """Control periods until one of the reasons at the top.

    Parameters
    ----------
    stop : int64 of shape (1,), made 1 by another thread that asks for something.
    links, c, v : records `LINKS`, `COUNTS`, `VALUES`.
    plants, states, works, readings : arrays of one, as in `axis.period`.
    frames : messages of state, truth, command, clock (`c_calls.Frame.message`). raws : bytes of the first two.
    rings : blocks of state and truth (`kept_rows`). responses : arrays of `ResponseTimes`.
    times : int64 of shape (2,), to work in.
    """
    links, c, v = links[0], c[0], v[0]
    while stop[0] == 0:
        n = c.sequence + 1
        if n > c.credit:
            return NO_CREDIT
        if crowded(rings[0]):
            return CROWDED
        if c.pace_ns > 0:
            hold_back(c, times)
        c.begun_ns = now(MONOTONIC, times)
        advance_and_read(plants, states, works, readings, v.voltage)
        c.sequence = n
        c.time_ns = now(REALTIME, times) if c.paced else int(np.rint(n * v.period * 1e9))
        if not v.low <= readings[0].encoder <= v.high:
            return TRAVEL
        send_state(links, c, v, readings[0], frames[0][0], raws[0], rings[0])
        outcome = await_command(links, c, v, frames[2][0], times)
        if outcome == GOOD:
            count_answer(c, responses, times)
        elif outcome == MISSED and n - c.last + c.grace_ns // c.pace_ns <= c.tolerated:
            c.lost += 1
            c.held = c.silent = 1
        else:
            return outcome
        if n % c.every == 0:
            send_truth(links, c, states[0], readings[0], frames[1][0], raws[1], rings[1])
        if (n + 1) % c.block == 0:
            if links.clocks:
                frames[3][0]["clock.sec"] = c.time_ns // 1_000_000_000
                frames[3][0]["clock.nanosec"] = c.time_ns % 1_000_000_000
                publish(links.clocks, links.clock)
            close(rings[0])
            close(rings[1])
            if not c.paced:  # else who sends looks by itself: to wake another processor can take as long as a period
                post(links.sender)
    return ASKED


def timing(period, rate, slice_s, paced, priority):
    """Entries of `COUNTS` that tell how to keep time.

    Parameters
    ----------
    period : control period [s]. rate : times real time, 0 for as fast as it goes. slice_s : longest wait [s].
    paced : wall clock. priority : real-time priority of the thread, 0 if it has none.
    """
    short = paced and period < SHORT_TIMER
    rate = 1.0 if paced else rate
    spin = period if short else SPIN
    seconds = {"pace_ns": period / rate if rate else 0.0, "slice_ns": slice_s, "spin_ns": spin, "waking_ns": spin,
               "grace_ns": GRACE if short else 0.0}
    return {name: round(value * 1e9) for name, value in seconds.items()} | {"priority": priority if short else 0}


def load(arrays):
    """Load or make the compiled code now and not in the first control period; ``arrays``: `SimulatedAxis.arrays`."""
    load_libraries()
    frames, responses = [Frame(*name) for name in FRAMES], ResponseTimes()
    rings = tuple(new_ring(1, len(frame.raw)) for frame in frames[:2])
    run_periods(np.ones(1, np.int64), np.zeros(1, LINKS), np.zeros(1, COUNTS), np.zeros(1, VALUES), *arrays,
                tuple(frame.message for frame in frames), tuple(frame.raw for frame in frames[:2]), rings,
                (responses.counts, responses.longest), np.zeros(2, np.int64))


class QuickPeriods:
    """`run_periods` with everything that it works on.

    Parameters
    ----------
    servo, reader : `FastServoPath` and its reader of commands. sender : semaphore of who sends the blocks. topics : `DriverTopics`. gate : `CommandGate`.
    stop : int64 (1,), 1 while another thread asks for something. responses : `ResponseTimes`.
    settings : field of `COUNTS` or `VALUES` to its constant value.

    Attributes
    ----------
    state, command : frames of what was sent and came last.
    answered, late, lost, overruns : counters of all periods in compiled code, beside those of the gate; they may be read
        by any thread while the loop goes on, as may `sequence` and `time_ns`.
    """

    def __init__(self, servo, reader, sender, topics, gate, stop, responses, settings):
        load_libraries()
        self._topics, self._gate, self._stop, self._responses = topics, gate, stop, responses
        self._frames = [Frame(*name) for name in FRAMES]
        self.state, _, self.command, _ = self._frames
        self._links, self._counts, self._values = np.zeros(1, LINKS), np.zeros(1, COUNTS), np.zeros(1, VALUES)
        state, truth, command, clock = (frame.address for frame in self._frames)
        self._links[0] = (topics.states.address, state, topics.truths.address, truth, topics.clock_address, clock,
                          reader.address, command, servo.semaphore.address.value, sender.address.value)
        for name, value in settings.items():
            (self._counts if name in COUNTS.names else self._values)[name] = value
        self._rings = (topics.states.ring, topics.truths.ring)
        self._times = np.zeros(2, np.int64)

    def grant(self, credit):
        """Periods up to this one may begin; heard by the running loop."""
        self._counts["credit"] = credit

    def run(self, arrays, sequence, credit, due, tolerated):
        """Control periods after number ``sequence``. Returns why it ended; the gate is as after these periods.

        Parameters
        ----------
        arrays : `SimulatedAxis.arrays`. credit : last period that may begin. due : when the next one is due [s of
            time.perf_counter], None for now. tolerated : most periods in a row without a command, paced.
        """
        c, v, gate = self._counts[0], self._values[0], self._gate
        c["tolerated"] = tolerated
        c["sequence"], c["credit"], c["due_ns"] = sequence, credit, 0 if due is None else round(due * 1e9)
        c["held"] = c["silent"] = gate.last != gate.period
        c["last"] = gate.last
        c["truth_listened"] = self._topics.truths.listeners
        v["voltage"], v["command"] = gate.voltage, gate.command
        why = self._call(arrays)
        gate.voltage, gate.command = float(v["voltage"]), float(v["command"])
        gate.saturated = gate.voltage != gate.command
        gate.last = int(c["last"])
        gate.begin(self.sequence - (why == TRAVEL))
        return why

    def _call(self, arrays):
        return run_periods(
            self._stop, self._links, self._counts, self._values, *arrays,
            tuple(frame.message for frame in self._frames), (self._frames[0].raw, self._frames[1].raw), self._rings,
            (self._responses.counts, self._responses.longest), self._times)

    def __getattr__(self, name):
        if name in COUNTS.names:
            return int(self._counts[name][0])
        raise AttributeError(name)
