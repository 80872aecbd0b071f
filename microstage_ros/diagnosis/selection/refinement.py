"""Sizes that enter non-linearly (a stiffness, a mass, a time constant), refined beyond the catalogue's grid."""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.catalogue import electrical, friction
from microstage_ros.diagnosis.catalogue.form import Form
from microstage_ros.diagnosis.residuals.evidence_set import STRETCH, Choice
from microstage_ros.diagnosis.selection.sizes import LEAST_FORM_ERROR

# of the size's logarithm; derived: two steps to either side cover what half of the step before leaves open
STEPS = (0.08, 0.03, 0.015)
# of the logarithm of a size at which χ² is not bent; derived: what the steps look at, between the first and the second
UNBENT = 0.05
# with one step, while the best size lies at the end of those tried; derived: 5 · 2 steps of 8 % reach a factor of 2.2
MOST_MOVES = 5
# of the size's logarithm, tried for every stretch; derived: a factor of two to either side, as `resonant.MASS_REACH`,
# in steps that a form's error of 0.06 does not see
VALLEYS = np.linspace(-np.log(2.0), np.log(2.0), 29)
DRAWS = 500      # derived: a standard deviation is known to 1/√1000, 3 %


@dataclasses.dataclass(frozen=True)
class Family:
    """Forms of one effect in one channel over a continuous size: ``columns(size)``, with β = 1 at the right one."""

    columns: object
    parameter: str
    unit: str
    value: object       # value(size, frame) of the effect's parameter


FAMILIES = {
    ("drive_compliance", "resonance"): Family(electrical.drive_compliance, "stiffness_factor", "1", lambda s, f: s),
    ("payload_change", "resonance"): Family(
        electrical.payload_resonance, "mass_kg", "kg", lambda s, f: (s - 1) * f.drive.mass
    ),
    ("frictional_lag", "torque"): Family(friction.frictional_lag, "time_s", "s", lambda s, f: s),
}


def about_their_sizes(evidences, choices):
    """Choices whose forms' columns, where they depend on the sizes, are those at the sizes fitted beside each other.

    A derivative taken at a small size tells an effect from others; at its own size an asymmetry of a fifth, or friction
    that varies by a third along the stroke, is not in proportion any more.
    """
    def form_about(form):
        if form.about is None:
            return form
        keys = evidences._keys(form.channel, choices)
        return form.about(evidences.learn[form.channel].sizes(keys)[form.key])

    return [Choice(choice.effect, tuple(map(form_about, choice.forms))) for choice in choices]


def refine(collection, choices):
    """Choices with their non-linear sizes refined."""
    result = list(choices)
    for place, choice in enumerate(result):
        for form in choice.forms:
            family = FAMILIES.get((choice.effect, form.channel))
            if family is not None and "," not in form.variant:  # two sizes were fitted as one form
                new = _refined(collection, family, form, result, choice)
                forms = tuple(
                    new if f is form else f for f in result[place].forms
                )  # noqa: PLR1736  changed in this loop
                result[place] = Choice(choice.effect, forms)
    return result


def _bootstrap_error(channels, family, log, frame):
    """Standard deviation of the ``log`` of a size at which least is left in the ``channels``, by how their stretches
    disagree (bootstrap: B. Efron, Annals of Statistics 7 (1979) 1; drawn with a fixed seed).

    A resonance that friction excites, and the motor hardly, has several valleys about as deep as one another; the bend
    of the deepest knows nothing of the others.
    """
    left = []
    for step in VALLEYS:
        columns = family.columns(float(np.exp(log + step)))
        white = [one.whiten(one.residual[:, None] - columns(one, frame))[0][:, 0] for one in channels]
        counts = [max(round(STRETCH / float(one.time[1] - one.time[0])), 1) for one in channels]
        left.append(np.concatenate([np.add.reduceat(w**2, np.arange(0, len(w), n)) for w, n in zip(white, counts)]))
    stretches = len(left[0])
    drawn = np.random.default_rng(0).multinomial(stretches, np.full(stretches, 1.0 / stretches), DRAWS)
    return float(np.std(VALLEYS[np.argmin(np.array(left) @ drawn.T, axis=0)]))


def _refined(collection, family, form, choices, choice):
    """The form at its best size; its sizes are that size itself, with the standard error of a parabola."""
    channel = form.channel
    others = [f for c in choices for f in c.forms if f.channel == channel and c.effect != choice.effect]
    keys = [f.key for f in others]
    size = float(form.variant)

    def trial(values):
        forms = [Form(choice.effect, channel, f"{v:.6g}", family.columns(v)) for v in values]
        evidence = collection.gather(channel, [*others, *forms], "learn")
        gains = []
        for one in forms:
            index = evidence.indices([one.key])
            # β = 1: what is left after one whole effect, then the others
            matrix = evidence.matrix.copy()
            matrix[0] -= evidence.matrix[index].sum(axis=0)
            matrix[:, 0] = matrix[0]
            matrix[0, 0] = (
                evidence.matrix[0, 0]
                - 2 * evidence.matrix[0, index].sum()
                + evidence.matrix[np.ix_(index, index)].sum()
            )
            left = dataclasses.replace(evidence, matrix=matrix)
            gains.append(evidence.energy() - left.energy() + left.fit(keys)[2])
        return np.array(gains)

    log = np.log(size) if size > 0 else 0.0
    stderr = UNBENT
    for step in STEPS:
        for _ in range(MOST_MOVES):
            at = log + step * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
            gains = trial(np.exp(at))
            best = int(np.argmax(gains))
            # derived: neither the first nor the last of the five
            if 0 < best < 4:
                break
            log = at[best]
        best = int(np.clip(best, 1, 3))
        a, b, c = gains[best - 1: best + 2]
        bend = 2 * b - a - c
        log = at[best] + (0.5 * step * (c - a) / bend if bend > 0 else 0.0)
        log = float(np.clip(log, at[0], at[-1]))
        if bend > 0:
            stderr = step * np.sqrt(2.0 / bend)
    if channel == "resonance":
        learn = [record[channel] for record in collection.channels["learn"]]
        stderr = float(np.hypot(stderr, _bootstrap_error(learn, family, log, collection.frame)))
    size, stderr = float(np.exp(log)), float(np.hypot(stderr, LEAST_FORM_ERROR))
    value = float(family.value(size, collection.frame))
    error = abs(float(family.value(size * (1 + stderr), collection.frame)) - value)

    def sizes(beta, covariance, frame):
        return {family.parameter: (value, error, family.unit)}, {family.parameter: value}

    return Form(choice.effect, channel, f"{size:.6g}", family.columns(size), sizes)
