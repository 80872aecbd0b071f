"""The friction law that the healthy axis follows, where it is not the file's: asked of the baseline.

The blocks of an axis file are fitted to a first loading. LuGre's bristles and Leuven's rate equation have the same
first loading and the same sliding curve, but other transitions, at every reversal; on such a machine the torque
balance leaves there ten to forty per cent of the friction, which hides all that shows at reversals. The baseline
tells the law: its residual r is compared with what each law would leave, r − (F_law − F_file), both whitened by one
noise model. The factor on that difference is 1 where the machine follows the law and 0 where it follows the file's
(J test of models that do not contain each other: Davidson and MacKinnon, Econometrica 49, 1981), and its error is how
seconds of the baseline disagree (`residuals.evidence_set.factor`).

Of each law one number is fitted: the stiffness of LuGre's bristles, the exponent of Leuven's transition. Limits,
sliding curve and blocks are the file's. LuGre's bristles relax along the whole path ∫|dq|, and the path of a reading's
noise, micrometres in every second of rest, is none of the machine's: its replay is driven by the position through a
play, whose half width is fitted, too.
"""

import dataclasses

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import t as student

from microstage_ros.diagnosis.catalogue.friction import COARSE
from microstage_ros.diagnosis.preprocessing.friction_replay import replay, replayed_force
from microstage_ros.diagnosis.preprocessing.motion import through_play
from microstage_ros.diagnosis.preprocessing.threads import side_by_side
from microstage_ros.diagnosis.residuals.evidence_set import factor
from microstage_ros.diagnosis.residuals.healthy import PIECE
from microstage_ros.diagnosis.residuals.mechanical import Mechanical
from microstage_ros.model.friction.equivalent import equivalent_blocks
from microstage_ros.model.friction.registry import law_named

CHANCE = 0.01       # derived: of a machine of the file's law to be taken for one of another, shared by the laws
HALF = 0.5          # of the factor; derived: from there on the law is nearer to the machine than the file's
# of all blocks' stiffness together, for LuGre's bristles; derived: the slope at the very start, which few blocks make,
# is an upper bound, and a tenth of it is softer than the slope at half the limit of any six blocks of the paper
BRISTLES = (0.1, 0.3, 1.0)
# for Leuven's transition; derived: from where it begins at once to where it is the blocks' own
EXPONENTS = (3.0, 9.0)
TOLERANCE = 0.05    # of the logarithm of the fitted number; derived: a twentieth of it changes the friction by less
MOST = 10           # replays per law; derived: golden sections from two decades to `TOLERANCE`


@dataclasses.dataclass(frozen=True)
class Law:
    """A law that may be the machine's: its ``name``, the one ``parameter`` that is fitted, ``starts(contact)``: the
    values that are tried first, ascending; ``values(contact, number)``: its parameters by a contact and that number;
    ``plays``: half widths of the play [m] that are tried."""

    name: str
    parameter: str
    starts: object
    values: object
    plays: tuple = (0.0,)


# m; derived: none, and steps of a factor of 1.7 up to the noise of the motor's position (`preparation.MOTOR_NOISE`)
PLAYS = (0.0, 4.0e-10, 7.0e-10, 1.2e-9, 2.0e-9)
#: Both leave the first loading and the sliding curve as they are.
LAWS = (
    Law(
        "lugre",
        "stiffness",
        lambda contact: np.sum(contact.stiffness) * np.array(BRISTLES),
        lambda contact, number: {"stiffness": number},
        PLAYS,
    ),
    Law(
        "leuven",
        "exponent",
        lambda contact: np.array(EXPONENTS),
        lambda contact, number: {"stiffness": contact.stiffness, "weight": contact.weight, "exponent": number},
    ),
)


@dataclasses.dataclass(frozen=True)
class OwnLaw:
    """The law that the healthy axis follows: its ``name`` in axis files, its title, and the fitted number with its
    name; ``play``: half width [m] of that through which the motor's position drives its replay."""

    name: str
    title: str
    parameter: str
    number: float
    play: float = 0.0

    def replayed(self, prepared, drive):
        """``prepared``, `preparation.Prepared` each, with the actuator's friction [N m] replayed by this law, which
        ``drive`` has."""
        return side_by_side(lambda one: _replayed(one, drive, self.play), prepared)

    @property
    def words(self):
        """The sentence for the answer."""
        return (
            f"The healthy axis follows the law of {self.title} ({self.parameter} {self.number:.3g}) more nearly than"
            " the axis file's: friction is judged by it."
        )


def own_law(prepared, drive):
    """The friction law of the healthy axis's actuator.

    Parameters
    ----------
    prepared : {group: list of `preparation.Prepared`}. drive : `drive.Drive` of the axis file.

    Returns
    -------
    (prepared, drive, `OwnLaw` or None): with the actuator's friction [N m] replayed by that law; as they were where the
    file's is as near, where it is not made of blocks, or without a baseline.
    """
    if drive.actuator.law >= 0 or not prepared["base"]:
        return prepared, drive, None
    channels = [Mechanical(one, drive) for one in prepared["base"]]
    found = [one for one in (_fitted(law, channels, drive.actuator) for law in LAWS) if one is not None]
    if not found:
        return prepared, drive, None
    _, law, number, play = max(found, key=lambda one: one[0])
    drive = dataclasses.replace(drive, actuator=contact_of(law, drive.actuator, number))
    own = OwnLaw(law.name, law_named(law.name).title, law.parameter, number, play)
    return {name: own.replayed(group, drive) for name, group in prepared.items()}, drive, own


def contact_of(law, contact, number):
    """`drive.Contact` of a `Law`, with the limits and the sliding curve of ``contact``.

    ``number``: the value of its fitted parameter [N m/rad], of an exponent [1].
    """
    curve = ("static", "coulomb", "stribeck_velocity", "stribeck_exponent")
    values = {**{name: getattr(contact, name) for name in curve}, **law.values(contact, number)}
    stiffness, weight = equivalent_blocks(law.name, values)
    packed = law_named(law.name).pack({**values, "viscous": 0.0})
    number = law_named(law.name).number
    return dataclasses.replace(contact, stiffness=stiffness, weight=weight, law=number, packed=packed)


def _speed(prepared, play):
    """Speed (n,) [m/s] of the motor's position through a play of half a width ``play`` [m]."""
    if play == 0.0:
        return prepared.speed
    return np.gradient(through_play(prepared.position, play), prepared.period)


def _replayed(prepared, drive, play):
    speed = _speed(prepared, play)
    actuator, stuck = replay(drive.actuator, speed / drive.radius, prepared.period)
    return dataclasses.replace(prepared, contact_speed=speed, actuator=actuator, stuck=stuck)


def _fitted(law, channels, contact):
    """(reduction of the baseline's χ², law, number, play) where the law is nearer to the machine than the file's, else
    None.

    ``channels``: the baseline's `Mechanical`; ``contact``: the file's.
    """
    asked = {}

    def gain(number, play=0.0):
        if (number, play) not in asked:
            with_law = contact_of(law, contact, number)
            asked[number, play] = np.concatenate([_pieces(one, with_law, play) for one in channels], axis=1)
        u, d = asked[number, play]
        return float((2.0 * u - d).sum())

    starts = law.starts(contact)
    if max(map(gain, starts)) <= 0.0:
        return None
    for play in law.plays[1:]:
        for number in starts:
            gain(number, play)
    ratio = starts[1] / starts[0]
    number, play = max(asked, key=lambda key: gain(*key))
    minimize_scalar(lambda log: -gain(float(np.exp(log)), play), bounds=np.log([number / ratio, number * ratio]),
                    method="bounded", options={"xatol": TOLERANCE, "maxiter": MOST})
    number, play = max(asked, key=lambda key: gain(*key))
    for other in law.plays:
        gain(number, other)
    number, play = max(asked, key=lambda key: gain(*key))
    size, stderr, freedom = factor(*asked[number, play])
    certain = student.sf((size - HALF) / stderr, freedom) < CHANCE / len(LAWS)
    return (gain(number, play), law, float(number), play) if certain else None


def _pieces(channel, contact, play):
    """(u, d), shape (2, pieces): inner products of what another contact's friction is beyond the file's with the
    residual, and with itself, by pieces of `PIECE`; all white."""
    p, drive = channel.prepared, channel.drive
    speed = _speed(p, play)[::COARSE] / drive.radius
    more = channel.mean(replayed_force(contact, speed, COARSE * p.period) - channel.coarse_friction(COARSE), COARSE)
    left, signal = channel.whiten(np.stack([channel.residual, more], axis=1))[0].T
    count = max(round(PIECE / float(channel.time[1] - channel.time[0])), 1)
    starts = np.arange(0, max(len(left) - count // 2, 1), count)
    return np.stack([np.add.reduceat(signal * left, starts), np.add.reduceat(signal**2, starts)])
