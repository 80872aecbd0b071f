"""When the compiled control periods of the driver begin: asleep or spinning until each is due; what the host takes."""

import os

from microstage_ros.numerics.compiled import in_place
from microstage_ros.ros.transport.c_calls import MONOTONIC, now, set_policy, sleep_until

HOST_STOP_NS = 1_000_000
"""A sleep that ends so much too late [ns] is time for which the host has stopped the loop; counted apart."""

SHORT_TIMER, GRACE = 5e-4, 5e-3
"""A kernel timer shorter than a scheduler's tick has to be put into the hardware: 16 us on a virtual machine, a sixth
of a period at 10 kHz. So with periods shorter than the first figure [s] the loop spins until the next one is due, and
waits so much longer [s] for a command that is late: the next period begins late. After a period without any command
periods begin in time again. The time without a command after which the driver trips stays the same."""

RELAXED = 3
"""One in so many periods the loop spins as a normal thread: Linux takes the processor from real-time threads for 50 ms
if they keep it for more than 95 % of a second (`sched_rt_runtime_us`), the time spent spinning included."""

SPARE_NS, FORGET = 5_000, 64
"""With longer periods the loop sleeps, and wakes this much sooner [ns] than its sleeps are late: at once as late as the
latest, and forgetting it over so many periods. `spin_ns` is the most."""

REAL_TIME, NORMAL = os.SCHED_FIFO, os.SCHED_BATCH


BURST_NS = 5_000_000
"""Simulated time that is held to a rate goes in steps of so long [ns of the wall clock], and the processor is free
between them: who slept before each period of 100 us would be woken, and wake others, 10 000 times a second. Derived:
fifty periods of 10 kHz a waking, and too short to be seen by a person; with 20 ms each period took a tenth less."""


@in_place
def early_ns(c):
    """How long before a period is due the loop must be awake."""
    return min(c.spin_ns, c.waking_ns + SPARE_NS)


@in_place
def learn_waking(c, late):
    """A sleep ended so late [ns]; -1 if there was none."""
    if late > c.waking_ns:
        c.waking_ns = late
    elif late >= 0:
        c.waking_ns -= (c.waking_ns - late) // FORGET


@in_place
def count_host_stop(c, late):
    """What should have happened happens so late [ns]: the host had the processor."""
    if late > HOST_STOP_NS:
        c.host_stops += 1
        c.host_stopped_ns += late


@in_place
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
    learn_waking(c, sleep_until(c.due_ns, early_ns(c), times))
    count_host_stop(c, now(MONOTONIC, times) - max(c.due_ns, present))
    if relaxed:
        set_policy(REAL_TIME, c.priority, times)


@in_place
def next_due(due_ns, present_ns, pace_ns):
    """When the next period of simulated time that is held to a rate is due [ns], and how long to sleep before it is
    looked at again [ns]; 0: it begins now, and the time is that of the one after it.

    ``due_ns`` : as returned before, 0 at first [ns]. ``present_ns`` : now [ns]. ``pace_ns`` : a period of wall time
    [ns].
    """
    if present_ns > due_ns + BURST_NS:
        due_ns = present_ns  # what was missed for longer than a step is not made up for
    if due_ns > present_ns + BURST_NS:
        return due_ns, due_ns - present_ns
    return due_ns + pace_ns, 0
