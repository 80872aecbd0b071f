"""Rows of a record at which the command of a loop tells of its machine.

Friction holds a resting stage wherever noise has left it, and a law with integral action winds up on what is missing
from there to its target: another command in every rest, up to the breakaway force, which no model of the machine
foretells. Such rows, and those in which the loop forgets them, say nothing of mass, friction or delay.
"""

import numpy as np

from microstage_ros.model.actuators import actuator_of

AFTER_REST = 0.04       # examined by: `test/diagnosis/resimulation/test_rests.py`
"""s after a rest until its command is forgotten; derived: of three healthy voice coils the residual is at its noise
again from the second or third block of 20 ms on."""
TELLING = 0.1        # share of a record that has to tell something, or all of it is used; derived: a fit of some sizes
HELD_OFF = 1e-6      # m that a law is held off its target to see whether it winds up; derived: a linear law has any
EARLY, LATE = 20, 40    # rows after which its command is compared; derived: difference quotients have settled by then


def rows_that_tell(reference, axis, controller):
    """Mask (n,) of the rows at which the command says what the machine does.

    All where nothing holds the stage at rest, where the law does not wind up, and of a record that hardly moves.

    Parameters
    ----------
    reference : (n,) [m]. axis : `Axis`. controller : a `Controller` of its law, as new; it is stepped.
    """
    reference = np.asarray(reference)
    every = np.ones(len(reference), bool)
    if not _is_held(axis) or not _winds_up(controller):
        return every
    rests = np.diff(reference, prepend=reference[0]) == 0.0
    reach = max(int(round(AFTER_REST / axis.value("period"))), 1)
    tell = np.convolve(rests, np.ones(reach + 1))[: len(reference)] < 0.5
    return tell if tell.mean() >= TELLING else every


def _is_held(axis):
    """Whether friction holds the stage: a command of force, and a contact with a level of friction."""
    levels = [f"contacts.{contact}.{leaf}" for contact in ("actuator", "guideway") for leaf in ("coulomb", "static")]
    return not actuator_of(axis).holds_position and any(axis.has(key) and axis.value(key) > 0.0 for key in levels)


def _winds_up(controller):
    """Whether the law's command grows, beyond rounding, while the stage stands beside a target that does not move."""
    commands = [controller.step(HELD_OFF, 0.0) for _ in range(LATE + 1)]
    return abs(commands[LATE] - commands[EARLY]) > 1e-3 * abs(commands[EARLY])
