"""A mass on a spring, under a load, on a friction contact: the smallest system that can stick and slip.

    m dw/dt = load(t) − K x − F,     dx/dt = w

Each step takes the velocity as linear and finds its end by bracketing, with the friction at the mean of
its two ends (trapezoidal rule), or, for the static law whose force jumps at rest, at its end: there the
body stays at rest while the load is within ± static.

Derived: Newton's law of the body, by the trapezoidal rule over a step.
"""

import math

import numpy

from microstage_ros.model.friction.curve import DIRECTION_WIDTH, STATIC
from microstage_ros.model.friction.registry import advance_law
from microstage_ros.numerics.compiled import compiled

STATIC_MAP = 0  # the law that is a map of velocity, without a state
ROUNDS = 80


@compiled
def imbalance(law, packed, state, trial, inertia, spring, end, start, position, friction, load, period):
    """Residual of the momentum balance for a velocity ``end`` [F]."""
    trial[:] = state
    force = advance_law(law, packed, trial, start, end, period, 1.0)
    mean = force if law == STATIC_MAP else 0.5 * (force + friction)
    middle = position + 0.25 * period * (start + end)
    return inertia * (end - start) / period + spring * middle + mean - load


@compiled
def slide(law, packed, state, inertia, spring, load, period, stop_speed, position, velocity, friction):
    """Run the slider along ``load`` (n,); fills position, velocity, friction (n,), returns the samples done.

    Entry 0 of the three is the start. Ends early once the speed passes ``stop_speed``.
    """
    trial = state.copy()
    for i in range(1, load.size):
        x, start, before = position[i - 1], velocity[i - 1], friction[i - 1]
        push = 0.5 * (load[i - 1] + load[i])
        low = start
        at_low = imbalance(law, packed, state, trial, inertia, spring, low, start, x, before, push, period)
        reach = -at_low * period / inertia
        high, at_high = low, at_low
        for _ in range(ROUNDS):
            if at_high * at_low <= 0.0 and high != low or at_low == 0.0:
                break
            high = low + reach
            reach *= 2.0
            at_high = imbalance(law, packed, state, trial, inertia, spring, high, start, x, before, push, period)
        end, tolerance = high, 1e-14 * (abs(low) + abs(high))
        if law == STATIC_MAP and low * high <= 0.0:
            at_rest = imbalance(law, packed, state, trial, inertia, spring, 0.0, start, x, before, push, period)
            if -packed[STATIC] <= at_rest <= packed[DIRECTION_WIDTH + STATIC]:
                position[i], velocity[i], friction[i] = x + 0.5 * period * start, 0.0, -at_rest
                continue
        for _ in range(ROUNDS):
            if abs(high - low) <= tolerance or at_high == 0.0 or at_high == at_low:
                break
            end = high - at_high * (high - low) / (at_high - at_low)
            at_end = imbalance(law, packed, state, trial, inertia, spring, end, start, x, before, push, period)
            if at_end * at_high < 0.0:
                low, at_low = high, at_high
            else:
                at_low *= 0.5
            high, at_high = end, at_end
        friction[i] = advance_law(law, packed, state, start, high, period, 1.0)
        position[i], velocity[i] = x + 0.5 * period * (start + high), high
        if abs(high) > stop_speed:
            return i + 1
    return load.size


def run_slider(contact, load, period, inertia, spring=0.0, stop_speed=math.inf):
    """(position [rad], velocity [rad/s], friction [N m]) of a slider from rest, each (n,), n the samples done.

    ``load`` (samples,) [N m], one each ``period`` [s]; ``inertia`` m [N m s²/rad], ``spring`` K [N m/rad]; ends early
    beyond ``stop_speed`` [rad/s].

    ``contact`` is a :class:`~microstage_ros.model.friction.properties.contact.Contact`; its state is carried on.
    """
    columns = numpy.zeros((3, load.size))
    done = slide(contact.law.number, contact.packed, contact.state, inertia, spring, load, period, stop_speed, *columns)
    return columns[:, :done]
