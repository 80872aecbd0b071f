"""How far the named causes of a case go towards the noise floor, which a simulation can show.

What a cause takes from the held-out record is compared with what is left in its channel above a floor:

* the healthy twin: same machine, programme and noise, and nothing hidden. Where two effects are hidden it is no floor
  of either: a machine that hangs on a soft drive, or leans on its friction at rest, is louder for any cause.
* the machine without the cause: the same with everything hidden but this one, diagnosed by itself. What another effect
  makes louder is in both; what is left of the cause, of its name or its size, is in one. Of a single effect it is the
  healthy twin.

The twin is made several times with other readings' noise: how what it leaves scatters is what no diagnosis can tell.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from scipy.stats import norm, t

from microstage_ros.diagnosis.batch import diagnose_records
from microstage_ros.diagnosis.selection.leftover import above
from microstage_ros.diagnosis.validation import second_world, simulated_records

CASES = {"first": simulated_records.make_case, "second": second_world.make_case}     # who makes the records
TWINS = {"first": simulated_records.make_twin, "second": second_world.make_twin}
LAWS = {"first": lambda hidden, seed, friction: {},
        "second": lambda hidden, seed, friction: {"law": second_world.law_of(hidden, seed, friction)}}
DRAWS = 4           # of the twin's noise; derived: three degrees of freedom, with which a quantile of 97.5 % is 3.2
WHOLE_WAY = 0.9     # of what is to be explained; source: what the project asks of its diagnosis
SIGMAS = 1.96       # of a 95 % interval
TWO_SIDED = 0.975   # quantile of the same, with few degrees of freedom
# standard errors by which what is left stays below what may be left, so that another floor decides nothing; derived:
# one in 3·10⁶ by chance
CERTAIN = 5.0
OVER_TWIN = "causes named, and 90 % of the way to the floor of the healthy twin"
WITHIN_ERROR = OVER_TWIN + ", within 1.96 standard errors"
WITHOUT = "causes named, and 90 % of the way to the floor of the machine without the cause"
EXPECTED = "as many would if nothing were left but noise, expected"
DECIDED = WITHOUT + ", of those that noise does not hide"


class Way(NamedTuple):
    """How far one named cause goes.

    Attributes
    ----------
    cause : its id. hidden : whether it was hidden.
    part : χ² that it takes from the held-out records [1].
    left, stderr : χ² that the causes leave in its channel above what the twin leaves, and its standard error by how
        stretches disagree [1].
    without, without_stderr : the same above what the machine without the cause leaves [1]; above the twin where that is
        the same machine, where it makes no difference (`CERTAIN`), or where that machine's own diagnosis is wrong.
    noise : standard deviation of a difference of two records of other noise [1]; 0 where no twin was drawn again.
    """

    cause: str
    hidden: bool
    part: float
    left: float
    stderr: float
    without: float = math.nan
    without_stderr: float = math.nan
    noise: float = 0.0

    @property
    def needed(self):
        """χ² that may be left where nine tenths of the way are gone [1]."""
        return self.part * (1.0 / WHOLE_WAY - 1.0)


def twins(world, axis, what, seed, friction):
    """Held-out records of the healthy machine: `DRAWS` of one programme, each with other noise; [] for a healthy case.

    Parameters
    ----------
    world : of `CASES`. axis : `Axis`. what : `Hidden`. seed, friction : of `make_case` [1].
    """
    return TWINS[world](axis, what, seed, friction * level_of(what), DRAWS) if what.ids else []


def ways_of(world, axis, what, seed, friction, answer, baseline):
    """A `Way` of every cause that an ``answer`` names.

    Parameters
    ----------
    world, axis, what : as in `twins`. seed, friction : of `make_case` [1].
    answer : `Diagnosis` of the case, with its floors and remains.
    baseline : list of `Record`, the case's.
    """
    found = []
    for cause in answer.causes:
        # what lies outside the regression has no twin: what was left there by the baseline's floor
        rest = cause.evidence / cause.clarity - cause.evidence if cause.clarity > 0.0 else math.inf
        left, stderr, leaves = answer.floors.get(cause.channel, (rest, 0.0, ()))
        noise = float(np.std(leaves, ddof=1) * math.sqrt(2.0)) if len(leaves) > 1 else 0.0
        way = Way(cause.id, cause.id in what.ids, cause.evidence, left, stderr, left, stderr, noise)
        if way.hidden and len(what.ids) > 1 and way.left + CERTAIN * way.stderr > way.needed:
            other = _without(world, axis, what, seed, friction, cause, answer, baseline)
            way = way._replace(without=other[0], without_stderr=other[1]) if other else way
        found.append(way)
    return tuple(found)


def _without(world, axis, what, seed, friction, cause, answer, baseline):
    """(χ² above the machine without the ``cause``, its standard error); None where the diagnosis of that machine names
    anything but what it hides: then it is no floor."""
    other = _all_but(what, cause.id)
    friction, law = friction * level_of(what) / level_of(other), LAWS[world](what, seed, friction)
    records, holdout, _ = CASES[world](axis, other, seed, friction, **law)
    its = diagnose_records(axis, records, holdout, baseline, seed=0)
    if {one.id for one in its.causes} != set(other.ids):
        return None
    mine, floor = answer.remains.get(cause.channel), its.remains.get(cause.channel)
    return above(mine, floor) if mine and floor and len(mine.energy) == len(floor.energy) else None


def _all_but(what, name):
    """`Hidden` without one effect; one that is no entry of ``effects`` is the course in ``after``."""
    kept = {one: section for one, section in what.effects.items() if one != name}
    return dataclasses.replace(what, ids=tuple(one for one in what.ids if one != name), effects=kept,
                               after=what.after if name in what.effects else None)


def level_of(what):
    """Factor on all of the friction that is hidden [1]: its random part grows with it, and no cause explains that part,
    so a twin's friction varies by as many newtons."""
    return what.effects.get("friction_level_change", {}).get("factor", 1.0)


def reached(way, sigmas=0.0):
    """Whether a ``way``, `Way`, goes nine tenths to the floor of the healthy twin; a wrong name never does.

    ``sigmas``: standard errors of what is left that are forgiven [1].
    """
    return bool(way.hidden) and way.left - sigmas * way.stderr <= way.needed


def reached_without(way):
    """Whether a ``way``, `Way`, goes nine tenths to the floor of the machine without the cause; a wrong name never
    does."""
    return bool(way.hidden) and way.without <= way.needed


def decided(way):
    """Whether noise does not hide if a ``way``, `Way`, goes nine tenths: what is left differs from what may be left by
    more than 95 % of differences between two records of other noise. A wrong name is never hidden."""
    return not way.hidden or abs(way.without - way.needed) >= t.ppf(TWO_SIDED, DRAWS - 1) * way.noise


def expected(ways):
    """How many of ``ways``, `Way` each, would go nine tenths if nothing were left but noise [1]."""
    return float(sum(norm.cdf(way.needed / way.noise) if way.noise > 0.0 else 1.0 for way in ways))


def counts(ways):
    """{figure: (hits, of)} [1] of ``ways``, `Way` each."""
    clear = [way for way in ways if decided(way)]
    return {
        OVER_TWIN: (sum(map(reached, ways)), len(ways)),
        WITHIN_ERROR: (sum(reached(way, SIGMAS) for way in ways), len(ways)),
        WITHOUT: (sum(map(reached_without, ways)), len(ways)),
        DECIDED: (sum(map(reached_without, clear)), len(clear)),
    }
