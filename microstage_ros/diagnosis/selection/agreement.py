"""Whether an effect is more than what the model of the healthy axis leaves unexplained.

χ² of a candidate is right if the noise is as the model has it. Friction of another law, or friction that varies
otherwise, leaves residuals that no noise model holds; they look like an effect of another size, or of another sign, in
every stretch of the records. So the scatter of the fitted size between stretches, of the records under test and of the
baseline, is its noise.
"""

import math

import numpy as np
from scipy.stats import t as student

from microstage_ros.model.effects import REGISTRY

# derived: by Bonferroni's inequality one healthy axis in a hundred gets any of the names
OF_NAMES = math.log(0.01 / len(REGISTRY))
# derived: the name is chosen by then, and is asked once whether it is there and was not before
OF_ONE = math.log(0.01)
# of two names that are as likely beforehand; derived: the other one in a case of twenty
LEADING_ODDS = math.log(19.0)
# times the noise model's variance of a size; derived: twice as much, of the tens of stretches that carry an effect,
# comes by chance once in a hundred
FAITHFUL = 2.0
# in units of what was learned; derived: least squares learn one, and only a prior takes less of it
LEAST_SIZE = 1.0e-3
# of a cause's size that the baseline may show, if that stands two standard errors out there; calibrated by: microstage
# campaign --world second --kind single --seed 2103, case 18: with 0.2 a level of friction of 18 % was no longer named
# because the baseline had 3.7 % of it
BASE_SHARE = 0.3
# relative standard error of a size that is certain; derived: five standard errors, a chance of 3·10⁻⁷ in the learning
# records, and again in the held-out ones
CERTAIN = 0.2
# of a cause's size from which on the baseline shows the same thing; derived: midway between none of it and all
HALF = 0.5
SIGMAS = 3.0            # derived: a chance of 1.3·10⁻³


def size_beyond_baseline(evidences, choice, others):
    """Factor on an effect's learned sizes that all records under test show beyond the baseline: value, standard error,
    degrees of freedom; None where the rows were not kept."""
    learned = evidences.agreement(choice, others, "learn")
    if learned is None:
        return None
    held = evidences.agreement(choice, others, "held")
    return beyond(_pooled(learned, held), _of_baseline(evidences, choice, others))


def unsteadiness(evidences, choice, others):
    """Relative standard error [1] of a cause's size by how stretches of the learning records scatter, or of the
    held-out ones, whichever is larger; infinite where a record group does not tell it.

    What the form of another cause leaves unexplained grows and shrinks with that cause, and has no one size; a linear
    cause has one in every stretch.
    """
    sizes = [evidences.agreement(choice, others, group) for group in ("learn", "held")]
    if any(size is None or size[0] <= 0.0 for size in sizes):
        return math.inf
    return max(stderr / value for value, stderr, _ in sizes)


def has_two_sizes(evidences, choice, others):
    """Whether a cause has another size in the held-out records than in the learning ones: the two differ by more than
    `SIGMAS` of their standard errors, by the scatter between stretches, and by more than half the learned size. Such a
    cause is none, however certain it is in either. A form that is not exact may differ by less."""
    sizes = [evidences.agreement(choice, others, group) for group in ("learn", "held")]
    if None in sizes:
        return False
    (learned, stderr, _), (held, error, _) = sizes
    return abs(held - learned) > max(SIGMAS * math.hypot(stderr, error), HALF * abs(learned))


def agrees_with_itself(evidences, choice, others):
    """Whether an effect is there beyond how its own size scatters between stretches of the records, and between these
    and the baseline.

    Its significance by χ² holds if the noise is as the model has it. A healthy axis whose friction follows another law
    leaves more, which then looks like an effect of another size, or sign, in every stretch (`Evidences.agreement`).
    """
    learned = evidences.agreement(choice, others, "learn")
    if learned is None:     # the rows were not kept
        return True
    held, base = evidences.agreement(choice, others, "held"), _of_baseline(evidences, choice, others)
    if log_tail(learned) > OF_NAMES and not _certain_alone(learned, held, base):
        return False
    # where the model is not the machine's, every name is there: that the baseline has less of it is all that tells
    level = OF_ONE if _as_modelled(evidences, choice, others, learned) else OF_NAMES
    return log_tail(beyond(held, base)) < OF_ONE and log_tail(beyond(_pooled(learned, held), base)) < level


def _as_modelled(evidences, choice, others, learned):
    """Whether the learned size scatters between stretches as the noise model has it.

    Then this shape is none of those by which the machine's law differs, and the baseline, which may not have gone
    there, is asked once.
    """
    return learned[1] ** 2 * evidences.signal(choice, others, "learn") < FAITHFUL


def _certain_alone(learned, held, base):
    """Whether the held-out records, which did not choose the size, tell it alone with the certainty that is asked of
    all names, and the learning records with the one that is asked of one.

    By their own degrees of freedom: those of the baseline say nothing of how few stretches carry it here. And beyond
    what the baseline clearly shows; whether it may show as much is asked beside this (`agrees_with_itself`).
    """
    more, stderr, _ = beyond(held, clear_part(base))
    return log_tail(learned) < OF_ONE and log_tail((more, stderr, held[2])) < OF_NAMES


def held_out_records_show(evidences, choice, others):
    """Whether the held-out records alone tell an effect's size with the certainty that is asked of all names."""
    held = evidences.agreement(choice, others, "held")
    return held is not None and log_tail(held) < OF_NAMES


def in_baseline(evidences, choice, others):
    """Whether the baseline shows the effect already, at half its size or clearly at `BASE_SHARE` of it.

    Clearly by the noise model's error alone. How the baseline's stretches disagree is larger on machines of another
    friction law, and by that error names would come back that healthy axes get.

    What the healthy model took from the baseline counts, too: it does not hold to the last on another programme, nor on
    a part of the stroke where the baseline was not, and what is left of it there is no other cause than it was.
    """
    if any(is_wave_of_baseline(evidences, form, others) for form in choice.forms):
        return True
    if evidences.raw:
        amplitude, stderr = evidences.amplitude_in_base(choice, others, raw=True)
        if amplitude > HALF and stderr < HALF:
            return True
    amplitude, stderr = evidences.amplitude_in_base(choice, others)
    return bool((amplitude > HALF and stderr < HALF) or amplitude > max(BASE_SHARE, 2.0 * stderr))


def is_wave_of_baseline(evidences, form, others):
    """Whether the baseline has a wave of this length and at least half this height, at whatever phase.

    Of friction along the stroke: a wave number is read to a per cent or so; some millimetres on, where the baseline
    was, the phase is another. What the healthy model took from the baseline counts. Of an encoder's error: its phase
    belongs to the scale. One that the baseline shows at another phase, once its own error is taken out, is noise of
    that size.
    """
    waves_of_friction = form.effect == "position_dependent_friction" and form.variant.startswith("wave")
    if not waves_of_friction and form.effect != "encoder_sde":
        return False
    keys = [key for choice in others for key in choice.keys(form.channel)]
    usual = evidences.usual(form.channel, form.key, raw=waves_of_friction)
    return usual > HALF**2 * evidences.more(form.channel, keys, form.key)


def log_tail(size):
    """ln of the probability [1] that a ``size`` [1] (value, standard error, degrees of freedom) is as large by chance
    (Student's t, one-sided). A size without any scatter is no chance where it is above zero, and nothing where it is
    not."""
    value, stderr, freedom = size
    if stderr == 0.0:
        return -math.inf if value > 0.0 else 0.0
    return float(student.logsf(value / stderr, freedom))


def log_odds(lead, base=(0.0, 0.0, 0.0)):
    """ln [1] of how much more likely a factor ½ + lead is if the first of two names is right, and the factor one, than
    if the second is, and the factor nothing.

    ``lead``: value, standard error [1], degrees of freedom; Student's t. Where the factor lies further from one than
    its error allows neither name is right to the last, and the error is at least that distance. ``base``: the same of
    what the healthy axis clearly shows of the difference, with its sign. It is the machine's, and then it is in the
    records, too, as it is; or random friction's, and then the records have another one of that size. Either is as
    likely beforehand, and the distance is that from the nearer of the two.
    """
    value, stderr, freedom = lead
    shown, error, more = base
    least = min(abs(value - 0.5 - shown), abs(value - 0.5))
    first, second = [], []
    for shift, spread in ((shown, math.hypot(stderr, error)), (0.0, math.hypot(stderr, shown))):
        away = value - 0.5 - shift                  # from what is expected under the first name
        spread = max(spread, least)
        if spread == 0.0:
            return math.inf
        for found, distance in ((first, away), (second, away + 1.0)):
            found.append(student.logpdf(distance / spread, freedom + more) - math.log(spread))
    return float(np.logaddexp(*first) - np.logaddexp(*second))


def leads(lead, base):
    """Whether a ``lead`` of the first of two names is certain beyond what the healthy axis clearly shows of the same
    difference (``base``), or the odds are `LEADING_ODDS`: value, standard error [1], degrees of freedom each.

    The two names differ by the very shapes in which the machine's law differs from the model's, and by as much of that
    difference as the healthy axis shows either of them may gain on the other where nothing has changed.
    """
    return _certainly_nearer(lead, base) or log_odds(lead, base) > LEADING_ODDS


def _certainly_nearer(lead, base):
    shown, *error = base
    return log_tail(beyond(lead, (abs(shown), *error))) < OF_NAMES


def is_the_first(evidences, one, other, others):
    """Whether of two names the stretches of the records put the factor of `Evidences.lead` at one, the first name,
    within `SIGMAS`, and certainly beyond ½, more than the healthy axis shows of the difference.

    Then the first is right to the last, and nothing is left of the difference that a form which is not exact could have
    made; how small it is beside what both explain says nothing.
    """
    lead = evidences.lead(one, other, others)
    if lead is None or abs(lead[0] - HALF) > SIGMAS * lead[1]:
        return False
    return _certainly_nearer(lead, clear_part(evidences.lead_of_baseline(one, other, others)))


def shortfall(evidences, choice, others):
    """Factor on what an effect takes from χ² at which its size would just be certain in the learning records: below one
    where it is.

    What counts is the size beyond the one that the baseline shows, the scatter of both counted: on a machine of another
    friction law a healthy record has such shapes too, larger or smaller as its programme goes.
    """
    learned = evidences.agreement(choice, others, "learn")
    if learned is None:
        return 0.0
    base = _of_baseline(evidences, choice, others)
    return max(_shortfall(learned), _shortfall(beyond(learned, base)))


def _shortfall(size):
    value, stderr, freedom = size
    return float((student.isf(math.exp(OF_NAMES), freedom) * stderr / max(value, LEAST_SIZE)) ** 2)


def _of_baseline(evidences, choice, others):
    """`Evidences.agreement` of the baseline; zeros where there is none, or one without the column that the effect acts
    through."""
    base = evidences.agreement(choice, others, "base")
    return (0.0, 0.0, 0.0) if base is None or not math.isfinite(base[1]) else base


def _pooled(one, other):
    """Mean of two sizes, weighted by their precision: value, standard error, degrees of freedom."""
    if not (one[1] > 0.0 and other[1] > 0.0):
        return one
    weights = one[1] ** -2.0, other[1] ** -2.0
    total = sum(weights)
    return (weights[0] * one[0] + weights[1] * other[0]) / total, total**-0.5, one[2] + other[2]


def clear_part(size):
    """What of a ``size`` [1] stands above its own error: value, standard error, degrees of freedom.

    The positive part of the James–Stein estimator, (1 − σ²/a²) a: a baseline that shows a little within its error
    neither takes it from the records nor adds that error to theirs.
    """
    value, stderr, freedom = size
    share = max(1.0 - (stderr / value) ** 2, 0.0) if value else 0.0
    return share * value, math.sqrt(share) * stderr, freedom


def beyond(size, base):
    """A ``size`` [1] less the baseline's: value, standard error, degrees of freedom."""
    return size[0] - base[0], math.hypot(size[1], base[1]), size[2] + base[2]
