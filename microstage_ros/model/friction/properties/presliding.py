"""Experiments of slow, small motion: hysteresis and the four rules of its memory.

All run at a speed of 1e-4 Stribeck velocities, so that what is seen depends on displacement alone, and
up to 80 % of the largest force that the law reaches. Errors are relative to the largest force of the
experiment. A memory rule counts as kept if it is broken by less than 3 %, half of the smallest scatter
(±6 %) of the paper's own measurements: less could not be seen in a measured loop.
"""

import numpy

from microstage_ros.model.friction.properties.contact import CURVE, Contact, Finding

SPEED = 1e-4 * CURVE["stribeck_velocity"]
LEVEL = 0.8  # of the largest force in slow loading
RULE = 0.03


def hysteresis(name):
    """Pre-sliding hysteresis: area of a settled loop over that of the rectangle around it [1].

    Shown if the area is above 1 % and the force passes the reversal without a jump (in the first
    1/400 of the way back it changes by less than half of the loop's height).
    """
    contact = Contact.of(name)
    amplitude = contact.reach(LEVEL, SPEED)
    contact.travel(amplitude, SPEED)
    for _ in range(3):
        _, back = contact.travel(-2.0 * amplitude, SPEED)
        _, forth = contact.travel(2.0 * amplitude, SPEED)
    height = max(forth.max(), back.max()) - min(forth.min(), back.min())
    area = (forth.mean() - back.mean()) / height
    jump = abs(back[0] - forth[-1]) / height  # the two ends of one reversal
    return Finding(bool(area > 0.01 and jump < 0.5), float(area))


def rule(experiment):
    """Make a memory rule of an experiment that returns its relative error; static maps have none."""

    def measured(name):
        if not hysteresis(name).shown:
            return Finding(None, float("nan"))
        error = experiment(name)
        return Finding(bool(error < RULE), float(error))

    measured.__doc__ = experiment.__doc__.rstrip() + " Kept if below 3 %."
    measured.__name__ = experiment.__name__
    return measured


@rule
def masing(name):
    """Masing: a reversal branch is the first-loading curve scaled by two; largest deviation [1]."""
    contact = Contact.of(name)
    amplitude = contact.reach(LEVEL, SPEED)
    _, virgin = contact.travel(amplitude, SPEED)
    _, back = contact.travel(-2.0 * amplitude, SPEED)
    return numpy.abs(virgin[-1] - 2.0 * virgin - back).max() / virgin[-1]


@rule
def return_point(name):
    """Return point: force at the tip of an inner loop before and after the loop; largest difference [1].

    From first loading down to −80 % of its displacement, then a loop of 40 %, 60 % or 80 % of the outer one.
    """
    worst = 0.0
    for span in SPANS:
        contact, amplitude, tip, largest = _at_tip(name)
        contact.travel(span * amplitude, SPEED)
        _, closing = contact.travel(-span * amplitude, SPEED)
        worst = max(worst, abs(closing[-1] - tip) / largest)
    return worst


@rule
def congruency(name):
    """Congruency: loops between the same displacements after different histories have one shape [1]."""
    shapes, scale = [], 0.0
    for turn in (1.0, 0.6):  # the first loading turns here; both then descend to −0.2 and loop from there
        contact = Contact.of(name)
        amplitude = contact.reach(LEVEL, SPEED)
        _, first = contact.travel(turn * amplitude, SPEED)
        contact.travel((-0.2 - turn) * amplitude, SPEED)
        _, up = contact.travel(0.5 * amplitude, SPEED)
        _, down = contact.travel(-0.5 * amplitude, SPEED)
        shapes.append(numpy.concatenate((up, down)) - up[-1])
        scale = max(scale, first.max())
    return numpy.abs(shapes[0] - shapes[1]).max() / scale


@rule
def wipe_out(name):
    """Wipe-out: past the tip of a closed inner loop the outer branch goes on as if it had not been [1].

    The loops of the return-point experiment; largest deviation from the branch without a loop.
    """
    worst = 0.0
    for span in SPANS:
        contact, amplitude, _, largest = _at_tip(name)
        straight = contact.copy()
        contact.travel(span * amplitude, SPEED)
        contact.travel(-span * amplitude, SPEED)
        _, after = contact.travel(-0.6 * amplitude, SPEED)
        _, without = straight.travel(-0.6 * amplitude, SPEED)
        worst = max(worst, numpy.abs(after - without).max() / largest)
    return worst


SPANS = (0.8, 1.2, 1.6)  # of inner loops, in amplitudes


def _at_tip(name):
    """(contact, amplitude, force, largest force) at −0.8 amplitudes on the branch that came down from +1."""
    contact = Contact.of(name)
    amplitude = contact.reach(LEVEL, SPEED)
    _, first = contact.travel(amplitude, SPEED)
    _, outer = contact.travel(-1.8 * amplitude, SPEED)
    return contact, amplitude, outer[-1], max(first.max(), -outer.min())
