"""What a slow amplifier leaves in the torque balance where its time is not known to the last.

The motor's speed comes from the back-EMF, and so from the command as the amplifier passed it on: a time τ that is off
by dτ leaves (∂r/∂τ) dτ in the residual r. What of a cause stands beside that shape is none of it. Derived: the residual
to first order in τ.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.catalogue.form import Form
from microstage_ros.diagnosis.residuals.mechanical import Mechanical

OTHER_TIME = "generic:slowness"     # nameless: what an amplifier of a slightly other time leaves
STEP = 0.02     # of the time; derived: the difference of two preparations is then far above their rounding


def forms_of_slowness(groups, drive, known, collection):
    """[`Form`] of ∂r/∂ln τ [N m] of the slow amplifier that is ``known``, a `prerequisites.Known`; none without one.

    ``groups``: records {group: [`Record`]}; ``drive``: with which they were prepared; ``collection``: their
    `Collection`.
    """
    if known.slow is None or "torque" not in collection.names:
        return []
    sides = [_residuals(groups, drive, known, collection, 1.0 + sign * STEP) for sign in (1.0, -1.0)]

    def columns(channel, frame):
        more, less = (side.get(id(channel), np.zeros(len(channel.residual))) for side in sides)
        return ((more - less) / (2.0 * STEP))[:, None]

    return [Form(OTHER_TIME, "torque", "", columns)]


def _residuals(groups, drive, known, collection, factor):
    """{id of a torque balance under test: its residual (blocks,) [N m] with the slow amplifier's time × ``factor``}."""
    slow = dataclasses.replace(known.slow, time=known.slow.time * factor, lag=known.slow.lag * factor)
    prepared = dataclasses.replace(known, slow=slow).prepare(groups, drive, collection.prepared)
    return {
        id(own["torque"]): Mechanical(anew, collection.frame.drive).residual
        for group in ("learn", "held")
        for own, anew in zip(collection.channels[group], prepared[group])
    }
