"""Control periods of a simulated machine in compiled code, as long as nothing out of the ordinary happens.

`Machine.run` does the same, period after period, in Python, for any backend. Whatever ends a run, or might, is left to
it: the compiled loop stops behind the reading that shows it.
"""

import math

import numpy as np

from microstage_ros.control.laws import registry as laws
from microstage_ros.control.laws.controller import Controller
from microstage_ros.numerics.compiled import compiled
from microstage_ros.solver.period import advance_and_read


class LawCommand:
    """The command of a control law that follows a reference.

    Parameters
    ----------
    controller : `Controller`. wanted : reference [m], shape (n,). offset : of the current [A], taken off what was
        read.

    Attributes
    ----------
    compiled : whether the law is all that the command takes: the controller has no step of its own.
    """

    def __init__(self, controller, wanted, offset):
        self.controller, self.offset = controller, offset
        self.compiled = type(controller) is Controller
        self._wanted, self._step = np.asarray(wanted, float).tolist(), controller.step

    def __call__(self, n, x, i):
        """Command for period ``n`` [1] from encoder ``x`` [m] and current ``i`` [A; NaN where there is none]."""
        return self._step(self._wanted[n], x, i - self.offset if i == i else 0.0)


@compiled
def law_periods(machine, law, held, wanted, added, table, bounds):
    """Periods under a law until one is out of the ordinary. Returns how many are done; the reading of the next has been
    taken if there is one.

    Parameters
    ----------
    machine : `SimulatedAxis.arrays`. law : `Controller.arrays`. held : command during the first [its unit].
    wanted, added : reference [m] and what is added to the command, shape (n,).
    table : filled, shape (5, n), as in `Machine.run`.
    bounds : shape (7,): encoder before, least and greatest encoder, largest change in a period, largest
        reference − encoder [m], largest command, offset of the current [A].
    """
    before, low, high, jump, error, limit, offset = bounds
    plants, states, works, readings = machine
    parameters, memories = law
    for n in range(len(wanted)):
        advance_and_read(plants, states, works, readings, held)
        x, i = readings[0].encoder, readings[0].current
        ordinary = abs(x - before) <= jump and low <= x <= high and abs(wanted[n] - x) <= error
        if not ordinary:
            return n
        u = laws.controller_step(parameters[0], memories[0], wanted[n], x, i - offset if i == i else 0.0) + added[n]
        held = min(max(u, -limit), limit) if math.isfinite(u) else 0.0
        table[0, n], table[1, n], table[2, n], table[3, n] = x, i, readings[0].motor_angle, held
        before = x
    return len(wanted)
