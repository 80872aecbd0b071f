"""The proof of a law, simulated on the identified axis: what the machine should show, and what it means where it does
not.

A machine whose moves leave far more than that has friction that the model does not describe, or a number of it is off.
One that leaves as much has friction that none of the laws holds closer with their margins: where the sliding torque
falls steeply with speed, a small error of the speed grows e-fold within a few control periods.
"""

import math
from dataclasses import replace

from microstage_ros.commissioning.design.law_choice import FLOOR_GAIN, FLOOR_PHASE
from microstage_ros.commissioning.experiments import proof
from microstage_ros.commissioning.experiments.closed_loop import Loop
from microstage_ros.commissioning.experiments.machine import Machine
from microstage_ros.commissioning.findings import Refused, refused
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import Setup

NOTICED = 3e-7  # error of moves or slow sine [m] that is compared with a simulation
MORE = "the machine has friction that the model does not describe, or a number of the identified axis is far off"
FAR_MORE = 3.2  # times the simulated error: √F of 9 and 9 degrees of freedom (ten moves each) is above it once in 10³


def simulated_proof(loop, seed):
    """(largest 4s or mean error of the moves [m], largest error in the slow sine [m], "") of a ``loop``'s law on a
    simulation of the axis that the loop has; (inf, inf, why) where the law does not come to rest there.

    ``seed``: of the simulation [1].
    """
    machine = loop.machine
    middle = 0.5 * (machine.travel[0] + machine.travel[1])
    backend = make_hardware("simulated", Setup(loop.axis, seed, {"position": middle}))
    backend.open()
    simulated = Machine(backend, loop.axis)
    simulated.begin()
    simulated.noise, simulated.safe_speed, simulated.limit = machine.noise, machine.safe_speed, machine.limit
    again = Loop(simulated, loop.axis, loop.law, loop.sliding, loop.gains)
    try:
        rows, _, sine = proof.prove(again, lambda name, record: None)
    except Refused as reason:
        return math.inf, math.inf, reason.check.says
    finally:
        backend.close()
    return proof.worst_of(rows), sine, ""


def judge_proof(loop, worst, sine, seed):
    """Sentence on a proof beside that of the same law in simulation; "" where it leaves little, or what was expected.

    Parameters
    ----------
    loop : `Loop` that was proven. worst : largest 4s or mean error of its moves [m]. sine : largest error in its slow
        sine [m]. seed : of the simulation [1].

    Raises
    ------
    Refused : runaway; the moves scatter, or the sine is off, by more than one move may end beside its target.
    """
    largest = max(worst, sine) if math.isfinite(worst) and math.isfinite(sine) else math.inf
    if largest <= NOTICED:
        return ""
    expected, slow, why = simulated_proof(loop, seed)
    more = worst > FAR_MORE * expected or sine > FAR_MORE * slow
    says = (
        f"{loop.law} leaves {_micrometres(worst)} in the moves (4s, or mean error) and {_micrometres(sine)} in a slow"
        f" sine{_beside(loop, expected, slow, why, more)}"
    )
    if largest > proof.most_beside(loop.machine):
        raise refused("runaway", largest, "m", says)
    return says + "." if more else ""


def beside_simulation(loop, check, seed):
    """The failed ``check`` (`Check`, its value in m) of a ``loop`` that did not come to rest, its sentence with what
    the same law does on the identified axis in simulation. ``seed``: of the simulation [1]."""
    expected, slow, why = simulated_proof(loop, seed)
    more = max(expected, slow) <= proof.most_beside(loop.machine)
    return replace(check, says=check.says + _beside(loop, expected, slow, why, more))


def _beside(loop, expected, slow, why, more):
    left = f"it leaves {_micrometres(expected)} and {_micrometres(slow)}" if not why else f"it does not rest ({why})"
    return f"; simulated on the identified axis {left}: {MORE if more else _why_so_much(loop.axis)}"


def _why_so_much(axis):
    held, names = f"none of the laws holds it closer with {FLOOR_PHASE:g}° and {FLOOR_GAIN:g} dB", ("coulomb", "static")
    keys = [f"contacts.actuator.{name}" for name in names]
    if not all(axis.has(key) for key in keys):
        return held
    left = axis.value(keys[0]) / axis.value(keys[1])
    return f"its friction falls to {left:.0%} as sliding begins, and {held} (look at lubricant and preload)"


def _micrometres(value):
    return f"{value * 1e6:.3g} µm"
