"""The examination of `diagnose --log`: rates of right and wrong names, false alarms, coverage, and what shows in which
signals."""

import collections
import dataclasses
import json
import math
import pathlib
import time

from microstage_ros import __version__
from microstage_ros.diagnosis.logs.case import diagnose_logs
from microstage_ros.diagnosis.validation import campaign, carried
from microstage_ros.diagnosis.validation.simulated_logs import EFFECTS, SIGNALS, draw_case
from microstage_ros.files import write_text
from microstage_ros.metrology.rates import rate

__all__ = ["EFFECTS", "run", "scores", "sentences", "line", "visibility_table", "write"]


@dataclasses.dataclass
class Outcome:
    """What was hidden in one case and what was said.

    ``visible``: hidden effects that the signals carry (`carried`); ``declared``: those that the diagnosis says these
    signals show; ``distance``: change of the signals by each hidden effect, in standard deviations of the healthy
    scatter, empty where it was not computed. ``covered``: (effect, parameter, truth inside the 95 % interval, truth,
    value, standard error).
    ``stated``: (id, probability, χ² on repetitions held back, clarity, was it hidden) of each named cause.
    """

    number: int
    truth: tuple
    signals: str
    rate: float
    runs: int
    files: int
    reassembled: bool
    verdict: str
    named: tuple
    rivals: tuple
    visible: tuple
    declared: tuple
    distance: tuple
    covered: tuple
    seconds: float
    stated: tuple = ()

    @property
    def judged(self):
        """Whether it is known what the signals carry."""
        return len(self.distance) == len(self.truth)

    @property
    def first_right(self):
        """Whether the first name is right, or, where none is sure, a rival is."""
        if self.named:
            return self.named[0] in self.truth
        return any(i in self.truth for group in self.rivals for i in group)

    @property
    def result(self):
        """right, rival, nothing, unexplained or wrong; for a healthy machine quiet or alarm."""
        if not self.truth:
            return "quiet" if self.verdict == "agrees" else "alarm"
        if set(self.named) - set(self.truth):
            return "wrong"
        if self.named:
            return "right"
        opened = {i for group in self.rivals for i in group}
        if opened:
            return "rival" if opened & set(self.truth) else "wrong"
        return "nothing" if self.verdict == "agrees" else "unexplained"


def run(cases, seed=1, kind="mixed", effect="", strength=1.0, names_only=False):
    """Yield one `Outcome` per case of a ``seed`` [1]; ``strength``: of effects, times the usual [1]; ``names_only``:
    not what the signals carry, which takes most of the time."""
    for number in range(cases):
        case = draw_case(number, seed, kind, effect, strength=strength)
        began = time.monotonic()
        result = diagnose_logs(list(case.baseline), list(case.now), case.description, seed)
        found, seconds = result.diagnosis, time.monotonic() - began
        sizes = [] if names_only else [(step[0], carried.distance(case, k)) for k, step in enumerate(case.steps)]
        yield Outcome(
            number,
            tuple(map(str, case.truth)),
            case.signals,
            case.rate,
            case.runs,
            case.files,
            case.reassembled,
            found.verdict,
            tuple(c.id for c in found.causes),
            tuple(r.ids for r in found.rivals),
            tuple(name for name, size in sizes if size > carried.LIMIT),
            tuple(name for name, _ in sizes if result.visibility.get(name, (False,))[0]),
            tuple(round(size, 2) for _, size in sizes),
            _covered(case, result),
            seconds,
            tuple((c.id, c.probability, float(c.evidence), c.clarity, c.id in case.truth) for c in found.causes),
        )


def _covered(case, result):
    """Whether the 95 % intervals of the hidden effects' sizes hold the truth, where these are named or among the
    rivals."""
    out = []
    stated = [(cause.id, cause.parameters) for cause in result.diagnosis.causes]
    stated += [(name, parameters) for group in result.rival_sizes for name, parameters in group.items()]
    for effect, parameters in stated:
        for name, value in case.sizes.get(effect, {}).items():
            p = parameters.get(name)
            of_force = name in ("force", "stiffness", "coefficient", "coefficient_change")
            if p is not None and not (of_force and p.unit.startswith("m")):      # of an error in metres, no force
                factor = case.effort_factor if of_force else 1.0
                truth = float(value * factor)
                inside = bool(abs(p.value - truth) <= 1.96 * p.stderr)
                out.append((effect, name, inside, truth, float(p.value), float(p.stderr)))
    return tuple(out)


def scores(outcomes):
    """{figure: (hits, cases, lower, upper)} with exact 95 % intervals."""
    healthy = [o for o in outcomes if not o.truth]
    seen = [o for o in outcomes if o.truth and o.visible]
    hidden = [o for o in outcomes if o.truth and o.judged and not o.visible]
    stated = [cause for o in outcomes for cause in o.stated]
    both = [o for o in seen if o.declared]
    covered = [c for o in outcomes for c in o.covered]
    sets = {
        "healthy machines left in peace": (sum(o.result == "quiet" for o in healthy), len(healthy)),
        "visible: right name first, or a rival": (sum(o.first_right for o in seen), len(seen)),
        "visible: right name without rival": (sum(o.result == "right" for o in seen), len(seen)),
        "visible: wrong name anywhere": (sum(o.result == "wrong" for o in seen), len(seen)),
        "visible and declared so: right name first, or a rival": (
            sum(o.first_right for o in both),
            len(both),
        ),
        "hidden: no wrong name": (sum(o.result != "wrong" for o in hidden), len(hidden)),
        "95 % intervals that hold the truth": (sum(c[2] for c in covered), len(covered)),
        "a wrong name anywhere": (sum(o.result == "wrong" or bool(set(o.named) - set(o.truth)) for o in outcomes),
                                  len(outcomes)),
        "names right": (sum(cause[-1] for cause in stated), len(stated)),
    }
    out = {}
    for name, (hits, cases) in sets.items():
        if cases:
            found = rate(hits, cases)
            out[name] = {
                "hits": hits,
                "cases": cases,
                "rate": hits / cases,
                "ci95": [float(found.low), float(found.high)],
            }
    return out


def visibility_table(outcomes):
    """{effect: {signals: [named or rival, cases]}}: what was found of each effect in each set of signals."""
    table = {}
    for o in outcomes:
        for effect in o.truth:
            entry = table.setdefault(effect, {}).setdefault(o.signals, [0, 0])
            entry[0] += effect in o.named or any(effect in group for group in o.rivals)
            entry[1] += 1
    return table


def _shown(outcome):
    if not outcome.truth or not outcome.judged:
        return ""
    return "seen" if outcome.visible else "blind"


def line(outcome):
    """One case in one line."""
    opened = "".join(f" ({' | '.join(ids)})" for ids in outcome.rivals)
    return (
        f"{outcome.number:4d} {'+'.join(outcome.truth) or 'healthy':40s} {outcome.signals:26s} {outcome.rate:6g} Hz"
        f" {outcome.runs:3d} runs {_shown(outcome):5s}"
        f" {'declared' if outcome.declared else '':8s} {' '.join(f'{d:.3g}' for d in outcome.distance):>6s} sd"
        f" {outcome.result:11s} {outcome.verdict:16s} {', '.join(outcome.named)}{opened} {outcome.seconds:.1f} s"
        + "".join(f" [{c[1]} {c[4]:.3g} ± {c[5]:.2g}, truth {c[3]:.3g}]" for c in outcome.covered)
    )


def sentences(figures, outcomes):
    """Lines for a terminal."""
    out = [
        f"{name}: {f['hits']} of {f['cases']} ({f['rate']:.0%}, 95 %: {f['ci95'][0]:.0%} … {f['ci95'][1]:.0%})"
        for name, f in figures.items()
    ]
    for low, high, mean, right, named in campaign.reliability(outcomes):
        out.append(f"names stated with a probability of {low:g} to {high:g}, mean {mean:.3f}: right"
                   f" {rate(right, named)}")
    table = visibility_table(outcomes)
    out.append("found (named or among the rivals) by set of signals:")
    for effect, row in sorted(table.items()):
        out.append(
            f"  {effect:30s}"
            + "".join(f"  {signals}: {row[signals][0]}/{row[signals][1]}" for signals in SIGNALS if signals in row)
        )
    wrong = collections.Counter((o.truth, o.named or o.rivals) for o in outcomes if o.result == "wrong")
    out += [f"  wrong: {' + '.join(truth)} reported as {said} ({n})" for (truth, said), n in wrong.most_common(12)]
    return out


def write(outcomes, figures, arguments):
    """Write examination.json into the folder of the command."""
    def plain(value):
        return None if isinstance(value, float) and not math.isfinite(value) else value

    tree = {
        "version": __version__,
        "seed": arguments.seed,
        "kind": arguments.kind,
        "figures": figures,
        "reliability": campaign.reliability(outcomes),
        "visibility": visibility_table(outcomes),
        "cases": [{k: plain(v) for k, v in dataclasses.asdict(o).items()} | {"result": o.result} for o in outcomes],
    }
    write_text(pathlib.Path(arguments.out) / "examination.json", json.dumps(tree, indent=1) + "\n")
