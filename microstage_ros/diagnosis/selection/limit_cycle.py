"""Records of a loop that drives its amplifier from one limit to the other.

Such a loop rattles through every gap and excites every resonance by itself: lost motion, a soft drive and a payload
then leave residuals of the same kind, and no linear form follows the motion cycle by cycle.
"""

import math
from collections.abc import Callable

import numpy as np

from microstage_ros.diagnosis.result import Rivals

FOLLOWS = {"windup", "resonance", "torque"}     # channels that follow the motion
LOOSE_OR_SOFT = ("backlash", "drive_compliance", "payload_change")
#: Share of the periods with the command at the amplifier's limit; calibrated by: microstage simulate with gaps of
#: 0.005, 0.01 and 0.02 rad under the plain PID and the self-tuning law: 0.001 and less where the gap is named, 0.4
#: where the loop swings between the limits and the gap was taken for a soft drive.
MOST_AT_LIMIT = 0.05
# relative standard errors of a stiffness, by how stretches scatter (`agreement.unsteadiness`), above which a loop that
# swings between the limits, and one that does not, may rattle in a gap; calibrated by: microstage campaign --world
# second --kind two --seed 6105 (soft drives 0.002 to 0.012, loops that swing among them; a gap taken for one 0.095)
ONE_SIZE, SOME_SIZE = 0.02, 0.06
AT_LIMIT = 0.999    # of the limit; derived: the converter's rounding is a thousandth of it at most


def share_at_limit(prepared, limit):
    """Share of the periods [1] of some `Prepared` records in which the command stands at the voltage limit [V]."""
    at = [np.abs(record.commanded) >= AT_LIMIT * limit for record in prepared]
    return float(np.mean(np.concatenate(at)))


def judged(share, causes, unsure, scattered, errors=(), no_gap: Callable[[], bool] = lambda: False):
    """(causes, rivals, note) of records with this share at the limit: what rattle feigns becomes an open question.

    Parameters
    ----------
    share : of `share_at_limit` [1]. causes, unsure : sequences of `Cause` and `Rivals`, as found.
    scattered : channels that stand above the noise floor.
    errors : {id: `agreement.unsteadiness` [1]} of the causes; without an entry a loop that swings gives it no one size.
    no_gap : asked where a cause may be a gap's, () → whether force over deflection shows that there is none.
    """
    errors = dict(errors)
    followed = any(cause.id == "backlash" for cause in causes)  # the replay through the gap kept its place
    left = {"windup", "resonance"} & set(scattered)
    swings = share > MOST_AT_LIMIT
    most, unknown = (ONE_SIZE, math.inf) if swings else (SOME_SIZE, 0.0)
    feigned = [c for c in causes if c.id in LOOSE_OR_SOFT and not followed and errors.get(c.id, unknown) > most]
    if feigned and no_gap():
        feigned = []
    # a channel that is not followed to the noise tells a swing's size, and no fault beside it
    unfollowed = [c for c in causes if swings and c.channel in FOLLOWS & set(scattered) and c.id not in LOOSE_OR_SOFT]
    causes = [c for c in causes if c not in unfollowed]
    nameless = not causes and not unsure and left
    if unfollowed and not (feigned or nameless):
        return causes, unsure, (
            f"The command stands at its limit {share:.0%} of the time: the loop swings by itself, and beside its swing "
            f"the records tell nothing of {' and '.join(sorted({c.channel for c in unfollowed}))}. Records under a law "
            "that rests (self_tuning) would.")
    if swings and (feigned or nameless):
        note = (f"The command stands at its limit {share:.0%} of the time: the loop swings by itself. Records under a "
                "law that rests (self_tuning) would tell lost motion from a soft drive.")
        why = "a loop that swings between the amplifier's limits rattles and rings, whichever of these it is"
    elif feigned and left:
        note = ("The stiffness that fits is another in every stretch of the records. Records under a law that rests "
                "(self_tuning) would tell lost motion from a soft drive.")
        why = "a drive train has one stiffness; a gap has as many as there are amplitudes"
    else:
        return causes, unsure, None
    open_question = Rivals(LOOSE_OR_SOFT, why, {})
    return [cause for cause in causes if cause not in feigned], [*unsure, open_question], note
