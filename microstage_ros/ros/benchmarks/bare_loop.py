"""Cycles of the compiled loop without ROS: machine, limits and control law, period after period, as the nodes run them.

Shows that neither memory, open files, threads nor the processor time of a cycle grow with the number of cycles, for
numbers that a cell on topics takes hours for.
"""

import math
import os
import time

import numpy as np

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.laws.registry import controller_step
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.limits import breach, in_words, new_limits
from microstage_ros.hardware.protocol import Setup
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.axis_file import load_axis
from microstage_ros.numerics.compiled import compiled
from microstage_ros.places import config_file
from microstage_ros.ros.benchmarks.healthy import HELD, MOST_GROWTH, held
from microstage_ros.solver.period import advance_and_read

AMPLITUDE, FREQUENCY = 1e-3, 0.5
PARTS = 100
SLOWER = 1.1
"""Factor of the time of a cycle from the first to the last fifth that counts as growth."""

MARGIN = 1e-4
"""Beyond the travel [m], as the driver allows."""


@compiled
def run(count, first, period, clip, machine, law, limits, memory):
    """Cycles ``first`` to ``first + count``; the code of the limit that was breached, 0 for none.

    Parameters
    ----------
    machine : plants, states, works, readings, arrays of one. law : parameters and memories of the law, arrays of one.
    limits, memory : of `hardware.limits`. clip : voltage limit [V]. period : control period [s].
    """
    plants, states, works, readings = machine
    voltage = 0.0
    for k in range(first, first + count):
        advance_and_read(plants, states, works, readings, voltage)
        reading = readings[0]
        code = breach(limits[0], memory[0], reading.encoder, reading.current, reading.motor_angle, voltage)
        if code:
            return code
        reference = AMPLITUDE * math.sin(2.0 * math.pi * FREQUENCY * k * period)
        voltage = controller_step(law[0][0], law[1][0], reference, reading.encoder, reading.current)
        voltage = min(max(voltage, -clip), clip)
    return 0


def run_cycles(count, seed, tell=lambda share: None):
    """``count`` cycles [1] in `PARTS` parts; the facts as plain data.

    ``seed``: of the simulated axis [1]; ``tell``: called with the share done [1].
    """
    axis = load_axis(config_file("axis.yaml"))
    hardware = make_hardware("simulated", Setup(axis, seed, {}))
    hardware.open()
    law = make_controller(axis.controller.get("type", "self_tuning"), axis).arrays
    travel = axis.value("travel.minimum") - MARGIN, axis.value("travel.maximum") + MARGIN
    limits, memory = new_limits(axis, travel, {})
    fixed = (
        axis.value("period"),
        actuator_of(axis).command_limit(axis),
        tuple(hardware.own_arrays),
        tuple(law),
        limits,
        memory,
    )
    run(10, 0, *fixed)  # compiled now
    part, rows, times, done, code = max(count // PARTS, 1), [], [], 10, 0
    while done < count and not code:
        began = time.thread_time()
        code = run(min(part, count - done), done, *fixed)
        times.append((time.thread_time() - began) / min(part, count - done))
        done += min(part, count - done)
        rows.append(held(os.getpid()))
        tell(done / count)
    fifth = max(len(rows) // 5, 1)
    grown = (np.median(rows[-fifth:], axis=0) - np.median(rows[:fifth], axis=0)).astype(int).tolist()
    early, late = float(np.median(times[:fifth])), float(np.median(times[-fifth:]))
    short = [
        text
        for text, bad in (
            (f"a limit was breached: {in_words(code, limits, memory) if code else ''}", code),
            (f"grew by {dict(zip(HELD, grown))}", grown[0] > MOST_GROWTH or grown[1] > 0 or grown[2] > 0),
            (f"a cycle takes {late / early:.2f} times as long", late > SLOWER * early),
        )
        if bad
    ]
    return {
        "cycles": done,
        "seconds": round(sum(times) * part, 1),
        "cycle_first_fifth_s": early,
        "cycle_last_fifth_s": late,
        "growth": dict(zip(HELD, grown)),
        "fell_short": "; ".join(short),
    }
