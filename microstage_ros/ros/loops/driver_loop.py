"""Control periods of a simulated axis in compiled code, as long as nothing out of the ordinary happens.

`run_periods` does what `AxisDriver` does in Python, period after period, and returns to it for everything else:
a missing or strange command, no credit, the encoder beyond its travel, a request. So every rule about faults stays
in one place (`hardware.command_gate`), and none of it costs time in good periods.
"""

import math

import numpy as np

from microstage_ros.hardware.limits import breach
from microstage_ros.hardware.watchdog import BEAT, TAKEN, VOLTS
from microstage_ros.hardware.watchdog import ZEROED as WENT_TO_ZERO
from microstage_ros.numerics.compiled import in_place
from microstage_ros.ros.loops.period_timing import early_ns, hold_back, learn_waking, next_due
from microstage_ros.ros.transport.block_buffer import close, crowded, keep
from microstage_ros.ros.transport.c_calls import (
    MONOTONIC,
    REALTIME,
    known,
    now,
    post,
    publish,
    take_from,
    wait,
)
from microstage_ros.ros.transport.work_handover import (
    WAITING, begin_work, end_work, hand_back, hand_over, handover_of, may_take
)
from microstage_ros.solver.period import advance_and_read

GOOD, ASKED, CROWDED, NO_CREDIT, EARLY, TAKEN_AWAY, TRAVEL, WAITED, STRANGE, MISSED, ANSWERED = range(11)
"""Why `run_periods` returned; EARLY goes no further than it. From `TRAVEL` on, the period that is under way has to be
ended by the caller:
TAKEN_AWAY: the watchdog has taken the voltage away. TRAVEL: a limit of `hardware.limits` was breached; read, nothing
sent. WAITED: no command within a slice (lockstep). STRANGE: a command that is no answer to this period, nor, paced, to
one just before. MISSED: no valid command for longer than `trip_ns` (paced). ANSWERED goes no further than
`wait_for_work`."""

COUNTS = np.dtype([(name, "i8") for name in (
    "sequence", "credit", "paced", "pace_ns", "due_ns", "slice_ns", "spin_ns", "waking_ns", "grace_ns", "priority",
    "block", "every", "status", "held", "silent", "truth_listened", "last", "answered", "late", "lost",
    "overruns", "begun_ns", "time_ns", "valid_ns", "hold_ns", "ahead_ns", "trip_ns", "zeroed", "host_stops",
    "host_stopped_ns", "foreign", "malformed", "command_bytes", "fault", "refused")])
VALUES = np.dtype([(name, "f8") for name in ("voltage", "limit", "period", "command", "holds")])
LINKS = np.dtype([(name, "u8") for name in (
    "states", "state", "truths", "truth", "clocks", "clock", "commands", "command", "semaphore", "sender")])
"""Addresses: of publishers and the frames they send, of the subscription, its frame, its semaphore, the sender's."""

SATURATED, LATE, ZEROED = 4, 8, 64
CONTROLLER = 1  # VoltageCommand.SENDER_CONTROLLER

MOMENT_NS = 5_000_000
"""Who is asked for credit has every block that is full, and answers soon; only after this wait [ns] are those sent that
are not: small blocks are many blocks."""


@in_place
def zero_when_silent(c, v, guard, present, ahead):
    """No voltage if the last valid command will be older than `hold_ns` at the next look, ``ahead`` from ``present``
    [ns]."""
    if v.holds == 0.0 and present + ahead > c.valid_ns + c.hold_ns and (v.voltage != 0.0 or v.command != 0.0):
        v.voltage = v.command = guard[1][VOLTS] = 0.0
        guard[0][WENT_TO_ZERO] = present
        c.zeroed += 1


@in_place
def fill_stamp(message, time_ns):
    """The header of a message."""
    message["header.stamp.sec"] = time_ns // 1_000_000_000
    message["header.stamp.nanosec"] = time_ns % 1_000_000_000


@in_place
def send_state(links, c, v, reading, message, raw, ring):
    """The state of period ``c.sequence``."""
    fill_stamp(message, c.time_ns)
    message["sequence"] = c.sequence
    message["position"] = reading.encoder
    message["applied_voltage"] = v.voltage
    message["current"] = reading.current
    message["motor_angle"] = reading.motor_angle
    zeroed = c.paced and c.begun_ns + c.ahead_ns > c.valid_ns + c.hold_ns
    message["status"] = (
        c.status | (SATURATED if v.command != v.voltage else 0) | (LATE if c.held else 0) | (ZEROED if zeroed else 0)
    )
    message["fault"] = 0
    if not publish(links.states, links.state):
        c.refused += 1
    keep(ring, raw, c.sequence)


@in_place
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


@in_place
def take_command(links, c, guard):
    """The oldest command that waits and comes from the holder of the axis, whole, into its frame; False if none
    does."""
    _, _, info, holder, length, _, _ = guard
    while take_from(links.commands, links.command, info):
        if not known(info, holder):
            c.foreign += 1
        elif length[0] < c.command_bytes:
            c.malformed += 1
        else:
            return True
    return False


@in_place
def in_force(c, v, command, guard, times):
    """Obey the command in its frame; False if it is strange."""
    words, volts, memory = guard[0], guard[1], guard[6][0]
    n = np.int64(command["sequence"])
    if n > c.sequence or n <= c.last or not math.isfinite(command["voltage"]) or (n < c.sequence and not c.paced):
        return False
    c.last = n
    if words[TAKEN]:  # it waited while we stood still: whether we go on is decided first
        if v.holds == 0.0:
            v.voltage = v.command = 0.0
        return True
    v.command = command["voltage"]
    v.voltage = min(max(v.command, -v.limit), v.limit)
    volts[VOLTS] = v.voltage
    memory.reference = command["reference"] if command["sender"] == CONTROLLER else math.nan
    c.valid_ns = words[BEAT] = now(MONOTONIC, times)
    return True


@in_place
def await_command(stop, links, c, v, command, guard, times):
    """GOOD when the answer to the period is in force, else why not; by the wall clock."""
    while True:
        if take_command(links, c, guard):
            if not in_force(c, v, command, guard, times):
                return STRANGE
            if c.last == c.sequence:
                return GOOD
            c.late += 1
            continue
        present = now(MONOTONIC, times)
        until = c.due_ns + c.pace_ns + (0 if c.silent else c.grace_ns)
        if present >= until or stop[0]:
            return MISSED
        silent = c.valid_ns + c.hold_ns
        wait(links.semaphore, min(until, silent + 1) if present <= silent else until, times)
        zero_when_silent(c, v, guard, now(MONOTONIC, times), 0)


@in_place
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


@in_place
def begin_period(stop, links, c, v, plants, states, works, readings, frames, raws, rings, responses, times, guard):
    """Read and send the state of the next period. WAITING for its command, or why the loop ends."""
    links, c, v, reading = links[0], c[0], v[0], readings[0]
    if stop[0]:
        return ASKED
    if guard[0][TAKEN]:
        return TAKEN_AWAY
    n = c.sequence + 1
    if n > c.credit:
        return NO_CREDIT
    if crowded(rings[0]):
        return CROWDED
    if c.paced:
        hold_back(c, times)
    elif c.pace_ns > 0:
        c.due_ns, rest = next_due(c.due_ns, now(MONOTONIC, times), c.pace_ns)
        if rest > 0:
            return EARLY
    c.begun_ns = now(MONOTONIC, times)
    if c.paced:
        zero_when_silent(c, v, guard, c.begun_ns, c.ahead_ns)
    advance_and_read(plants, states, works, readings, v.voltage)
    c.sequence = n
    c.time_ns = now(REALTIME, times) if c.paced else int(np.rint(n * v.period * 1e9))
    c.fault = breach(guard[5][0], guard[6][0], reading.encoder, reading.current, reading.motor_angle, v.voltage)
    if c.fault:
        return TRAVEL
    send_state(links, c, v, reading, frames[0][0], raws[0], rings[0])
    return WAITING


@in_place
def end_period(stop, links, c, v, plants, states, works, readings, frames, raws, rings, responses, times, guard):
    """What else is to be sent of a period whose command is in force, or that has to do without."""
    links, c, clock = links[0], c[0], frames[3][0]
    n = c.sequence
    if n % c.every == 0:
        send_truth(links, c, states[0], readings[0], frames[1][0], raws[1], rings[1])
    if (n + 1) % c.block == 0:
        if links.clocks:
            clock["clock.sec"], clock["clock.nanosec"] = c.time_ns // 1_000_000_000, c.time_ns % 1_000_000_000
            publish(links.clocks, links.clock)
        close(rings[0])
        close(rings[1])
        if not c.paced:  # else who sends looks by itself: to wake another processor can take as long as a period
            post(links.sender)


@in_place
def begin_when_allowed(work, times):
    """As `begin_period`, asleep while it is too early, and after a moment's wait for credit if there is none."""
    links, c, until = work[1][0], work[2][0], 0
    while True:
        why, present = begin_period(*work), now(MONOTONIC, times)
        if why == EARLY:
            wait(links.semaphore, min(c.due_ns, present + c.slice_ns), times)
        elif why == NO_CREDIT:
            until = until if until > 0 else present + MOMENT_NS
            if not wait(links.semaphore, until, times):
                return why
        else:
            return why


@in_place
def timed_periods(handover, work, times):
    """Control periods by the wall clock. Why they ended."""
    links, c, v, frames, responses, guard = work[1][0], work[2][0], work[3][0], work[8], work[11], work[13]
    while True:
        why = begin_period(*work)
        if why == WAITING:
            why = wait_for_work(handover, c, work, times)
        if why == WAITING and c.last == c.sequence:
            continue  # whoever brought the command has done the rest
        if why == WAITING:
            zero_when_silent(c, v, guard, now(MONOTONIC, times), 0)
            why = await_command(work[0], links, c, v, frames[2][0], guard, times)
        if why == GOOD:
            count_answer(c, responses, times)
        elif why == MISSED and now(MONOTONIC, times) - c.valid_ns <= c.trip_ns:
            c.lost += 1
            c.held = c.silent = 1
        else:
            return why
        end_period(*work)


@in_place
def wait_for_work(handover, c, work, times):
    """Let who brings the command take it: then none of its response time is spent on waking this thread, which ranks
    above him and would take the processor while he holds the lock of the reader that it needs. WAITING, or why the loop
    ends.

    Where periods are long this thread sleeps until it is time to wait for the next one (`hold_back`). Where it has to
    spin (`SHORT_TIMER`) it is woken when the command is in force, and sleeps no longer than the voltage may last.
    """
    spins, until, woken, why = c.grace_ns > 0, c.due_ns + c.pace_ns, True, WAITING
    if spins:
        until = min(until + (0 if c.silent else c.grace_ns), c.valid_ns + c.hold_ns + 1)
    else:
        until -= early_ns(c)
    while woken and why == WAITING and now(MONOTONIC, times) < until:
        if spins and work[0][0]:
            return WAITING
        woken, why = hand_over(handover, work, until, times)
        if woken and why == WAITING:
            why = go_on(work)
    if not woken and not spins:
        learn_waking(c, now(MONOTONIC, times) - until)
    return WAITING if why == ANSWERED else why


@in_place
def go_on(work):
    """Take what waits; where it answers the period, do the rest of it, and in lockstep begin the next. WAITING;
    ANSWERED, if a loop that spins must be woken for it; or why the loop ends."""
    links, c, v, command, responses, times = work[1][0], work[2][0], work[3][0], work[8][2][0], work[11], work[12]
    while take_command(links, c, work[13]):
        if not in_force(c, v, command, work[13], times):
            return STRANGE
        if c.last == c.sequence:
            count_answer(c, responses, times)
            end_period(*work)
            if c.paced:
                return ANSWERED if c.grace_ns > 0 else WAITING
            return begin_period(*work)
        c.late += 1
    return WAITING


@in_place
def run_periods(handover, work, times):
    """Control periods until one of the reasons at the top.

    Parameters
    ----------
    handover : `work_handover.Handover.words`.
    work : stop, int64 of shape (1,), made 1 by another thread that asks for something; records `LINKS`, `COUNTS`,
        `VALUES`; plants, states, works, readings, arrays of one as in `solver.period`; messages of state, truth,
        command, clock (`c_calls.Frame.message`); bytes of the first two; blocks of state and truth (`kept_rows`);
        arrays of `ResponseTimes`; int64 (2,), to work in; the guard: shared words and volts of `OutputGuard`, int64
        (INFO_WORDS,) for what the middleware tells of a command, the holder of the axis (`identity.Holder.words`),
        length of the command, limits and their memory (`hardware.limits`).
    times : another int64 (2,), for the loop's thread while others work.
    """
    c = work[2][0]
    begin_work(handover)
    if c.paced:
        why = timed_periods(handover, work, times)
        end_work(handover)
        return why
    why = begin_when_allowed(work, times)
    while why == WAITING:
        before = c.sequence
        woken, why = hand_over(handover, work, now(MONOTONIC, times) + c.slice_ns, times)
        if why == WAITING:
            why = go_on(work)
            if why == WAITING and not woken and c.sequence == before:
                why = WAITED
        if why == NO_CREDIT or why == EARLY:
            why = begin_when_allowed(work, times)
    end_work(handover)
    return why


def on_message(work, count):
    """A command has come, or ``count`` [1] of them: it is obeyed, and in lockstep the next period begins, where it
    came, unless the loop's thread is needed."""
    handover = handover_of(work)
    if may_take(handover):
        hand_back(handover, go_on(work[0]))
