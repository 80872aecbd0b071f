"""Gain of the causes on repetitions that neither chose nor sized them.

The repetitions of now are halved, every second one in each half. Causes are chosen and sized on one half alone and
judged on the other, and the other way round. What counts are the causes of the answer, which all repetitions chose: one
that a half does not choose by itself takes nothing from the other. What a stage looks for beside a changed effort, and
what these signals can show, are settled before, on all repetitions.
"""

import math

import numpy as np

from microstage_ros.diagnosis.logs.selection import decide
from microstage_ros.diagnosis.logs.selection.stages import UNUSUAL, build
from microstage_ros.diagnosis.result import OverallImprovement

METRIC = "rms of the change over its healthy spread"
OF_HALVES = ", each half of the repetitions with the causes chosen and sized on the other"
OF_ITSELF = ", on the one repetition that chose and sized the causes: no gain on others"
LEAST = 1e-9               # derived: a divisor, never nothing


def gain_of_confirmed(stages, groups, open_sign):
    """`gain_of` once causes without rivals are left out, the worst first, that leave more of repetitions held back than
    there was without them: what one half of the repetitions shows of such a cause, the other one does not. One that has
    rivals is open in any case.

    ``stages`` (list of `Stage`), ``groups``, ``open_sign`` and what is returned: as for `gain_of` (shares and χ² [1]).
    """
    left_out: list = []
    while True:
        gain, parts, said = gain_of(stages, groups, open_sign)
        alone = [choice.name for stage in stages for choice in stage.chosen if not choice.rivals]
        worst = min(alone, key=lambda name: parts[name][3], default=None)
        if worst is None or parts[worst][3] >= 0.0:
            return gain, parts, [*said, *left_out]
        for stage in stages:
            stage.drop(worst)
        left_out.append(f"{decide.plain(worst)}, which all repetitions together show, is not named: one half of them is"
                        " worse described with what the other one says of it.")


def gain_of(stages, groups, open_sign):
    """(`OverallImprovement`, {form: (share [1], rms before [1], rms after [1], χ² that it takes [1])} of the causes of
    all ``stages``, a list of `Stage`, sentences for the notes).

    ``groups``: {side: list of `Rows`}; ``open_sign``: as for `Stage.solve`.
    """
    totals = {"before": 0.0, "after": 0.0, "floor": 0.0, "k": 0}
    parts, excesses, coordinates, not_again = {}, [], 0, []
    single = len(next(iter(stages[0].coordinates.values())).now) < 2
    for stage in stages:
        before = after = floor = 0.0
        names = [choice.name for choice in stage.chosen]
        taken, shown = dict.fromkeys(names, 0.0), {name: [0.0, 0.0, 0] for name in names}
        for learn, held in _halves(stage):
            teacher, judge = (_of(stage, half) for half in (learn, held))
            forms = {name: name for name in names} if learn is None else _chosen_again(stage, teacher, names, open_sign)
            k, left = len(judge.difference), _left(teacher, judge, forms.values())
            before, after = before + judge.whole, after + left
            floor += min(stage.problem.whole_inflation * k, judge.whole)
            totals["k"] += k
            for name in names:
                without = _left(teacher, judge, [form for one, form in forms.items() if one != name])
                taken[name] += without - left
                shown[name] = [a + b for a, b in zip(shown[name], (without, left, k))]
            not_again += [decide.plain(name) for name in names if name not in forms]
        coordinates += len(stage.problem.difference)
        excesses.append(max(before - floor, before - after, LEAST))
        for key, value in (("before", before), ("after", after), ("floor", floor)):
            totals[key] += value
        parts |= {name: (taken[name], *(math.sqrt(max(v, 0.0) / shown[name][2]) for v in shown[name][:2]))
                  for name in names}
    excess = max(sum(excesses), sum(max(p[0], 0.0) for p in parts.values()), LEAST)
    parts = {name: (float(np.clip(p[0] / excess, 0.0, 1.0)), p[1], p[2], p[0]) for name, p in parts.items()}
    rms = {name: math.sqrt(max(value, 0.0) / totals["k"]) for name, value in totals.items() if name != "k"}
    # derived: 95 % of a Gaussian; the relative standard error of an rms of n values is 1/√(2n). Both halves are held
    # against one baseline, and count once
    half = 1.96 / math.sqrt(2.0 * coordinates) * rms["after"]
    gain = OverallImprovement(
        METRIC + (OF_ITSELF if single else OF_HALVES),
        "1",
        tuple(dict.fromkeys(rows.log.source for rows in groups["now"])),
        rms["before"],
        rms["after"],
        rms["floor"],
        (max(rms["after"] - half, 0.0), rms["after"] + half),
    )
    return gain, parts, _said(single and bool(parts), list(dict.fromkeys(not_again)))


def _said(of_itself, not_again):
    said = ["There is one repetition of now only: the gain is measured on what chose and sized the causes, and says"
            " nothing of others."] if of_itself else []
    if not_again:
        said.append("Half of the repetitions alone would not name this, and the gain does not count it there: "
                    f"{', '.join(not_again)}.")
    return said


def _halves(stage):
    """Pairs of rows to learn from and to judge on; (None, None), all of them, of a single repetition."""
    count = len(next(iter(stage.coordinates.values())).now)
    if count < 2:
        return [(None, None)]
    even, odd = np.arange(0, count, 2), np.arange(1, count, 2)
    return [(even, odd), (odd, even)]


def _of(stage, half):
    """`decide.Problem` of these repetitions of now, with the inflation that the baseline has taught."""
    if half is None:
        return stage.problem
    problem = build(stage, {n: r.now[half] for n, r in stage.coordinates.items()},
                    {n: r.baseline for n, r in stage.coordinates.items()})
    problem.inflation, problem.whole_inflation = stage.problem.inflation, stage.problem.whole_inflation
    return problem


def _chosen_again(stage, teacher, names, open_sign):
    """{form of the answer: form in which these repetitions alone choose the same cause}."""
    if not names:
        return {}
    possible = {name for name, entry in stage.seen.items() if entry[1] < UNUSUAL * entry[3]}
    again = {decide.plain(c.name): c.name for c in decide.choose(teacher, possible, open_sign, stage.also)}
    return {name: again[decide.plain(name)] for name in names if decide.plain(name) in again}


def _left(teacher, judge, forms):
    """χ² [1] that the forms leave of one half with the sizes of the other."""
    forms = list(forms)
    if not forms:
        return judge.whole
    rest = judge.factor[0] - np.hstack([judge.white[form] for form in forms]) @ teacher.taken(forms)[1]
    return float(rest @ rest)
