"""Contacts whose law is not made of blocks: carried over a chunk by the library's own step.

Compiling all laws of the library takes longer than the rest of the step. So the type of the work record says
whether they are wanted (`linear_core.new_work`), and a step for blocks alone does not contain them.
"""

from microstage_ros.model.friction.registry import advance_law
from microstage_ros.numerics.compiled import internal, overload
from microstage_ros.solver.contact import direction_factor


def any_law(work):
    """Whether the step compiled for this work record knows laws that are not made of blocks."""
    raise NotImplementedError("compiled code only")


def follow_law(work, contact, c, w0, w1, h):
    """Carry a contact with another law of the library over a chunk, velocity linear from w0 to w1.

    ``contact``, ``c``: its parts of `PLANT` and `STATE`; ``w0``, ``w1`` [q/s]; ``h``: length of the chunk [s].
    """
    raise NotImplementedError("compiled code only")


@internal
def _follow(work, contact, c, w0, w1, h):
    # all of the law is scaled by the level, so that it keeps its shape below the limit too
    factor, law, parameters = c.factor / contact.level, contact.law - 1, contact.law_parameters
    c.law_before = c.law_force
    if contact.asymmetry != 0.0 and w0 * w1 < 0.0:     # each way with its own limits, down to the noise of a rest
        turn = h * w0 / (w0 - w1)
        advance_law(law, parameters, c.law_state, w0, 0.0, turn, factor * direction_factor(contact, w0))
        w0, h = 0.0, h - turn
    factor *= direction_factor(contact, w0 + w1)
    c.law_force = contact.level * advance_law(law, parameters, c.law_state, w0, w1, h, factor)


@overload(any_law, inline="always")
def _any_law(work):
    if "any_law" in work.fields:
        return lambda work: True
    return lambda work: False


@overload(follow_law)
def _follow_law(work, contact, c, w0, w1, h):
    if "any_law" in work.fields:
        return lambda work, contact, c, w0, w1, h: _follow(work, contact, c, w0, w1, h)
    return lambda work, contact, c, w0, w1, h: None
