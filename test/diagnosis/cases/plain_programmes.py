"""`diagnose` on records as a user makes them: the shipped axis under one of its laws, on short programmes.

    ./microstage shell python test/diagnosis/cases/plain_programmes.py [--law TYPE] [--programme NAME ...] [--effect NAME ...]
        [--kind single|two|healthy] [--no-baseline | --baseline NAME ...] [--cases N] [--seed N] [--period S] [--by-channel]

One line per case: two records with the hidden effects to learn from, one to judge on, one healthy as the baseline, as
`simulate` makes them. "right": all that is hidden is named, and nothing else; "rival": all of it is among the names and
the open questions; "missed"; "WRONG": a name that was not hidden, or an open question without any that was. Behind it,
for every number of the effect that the answer states, by how much it is off: relative, and in stated standard errors;
of a healthy axis the largest residuals, over the thresholds above which they are findings.
--baseline: the healthy record is of these programmes in turn, each other than that of the records.
Friction along the stroke may be nearly even on the part of the stroke that a programme covers, and cannot be told then.
--period: of the control, 1e-4 s.
--by-channel: by how much each channel alone is off, too, where several tell a size, with what it states of itself.
--cases: pairs or healthy axes of each programme (20), or how often each single effect is drawn (1).
"""

import argparse
import contextlib
import itertools
import json
import math
from collections import Counter

import numpy as np

from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.control.runs.simulate import simulated_record
from microstage_ros.diagnosis import case
from microstage_ros.diagnosis.batch import diagnose_records
from microstage_ros.diagnosis.validation import fault_injection
from microstage_ros.diagnosis.validation.campaign import effects_of
from microstage_ros.metrology.rates import rate
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file


def move(target, dwell):
    """A move to ``target`` [m] and ``dwell`` [s] there."""
    return {"move_to_m": target, "dwell_s": dwell}


def sine(amplitude, frequency, cycles):
    """So many ``cycles`` [1] of a sine, ``amplitude`` [m], ``frequency`` [Hz]."""
    return {"sine": {"amplitude_m": amplitude, "frequency_hz": frequency, "cycles": cycles}}


PROGRAMMES = {
    "plain": [move(1e-5, 0.5), sine(1e-5, 1.0, 4), move(1e-3, 0.5), sine(3e-4, 0.5, 3), move(-1e-4, 1.0)],
    "moves": [move(x, 0.4) for x in (1e-6, 1e-5, -1e-5, 1e-4, 0.0, 1e-3, 5e-4, -5e-4, 2e-5, 0.0, 1e-3, 0.0)],
    "rest": [move(0.0, 10.0)],
    "tenths": [move(x, 1.0) for x in 4 * (1e-7, 0.0)],
    "micrometres": [move(x, 1.0) for x in 4 * (2e-6, 0.0)],
    "there and back": [move(x, 2.0) for x in 2 * (1e-3, 0.0)],
    "half a stroke": [move(x, 0.7) for x in 6 * (5e-4, 0.0)],
    "small sine": [sine(1e-7, 0.2, 2)],
    "slow sine": [sine(1e-4, 0.1, 1)],
    "wide sine": [sine(1e-3, 0.1, 1)],
    "sines": [sine(5e-6, 2.0, 6), sine(1e-4, 1.0, 4), move(2e-3, 0.5), sine(1e-3, 0.5, 3), move(0.0, 1.0)],
}


def records(axis, law, programme, effects, seed, period=1e-4, baseline=None):
    """([two to learn from], [one to judge on], [baseline]) under a ``law`` with ``effects`` {id: parameters}; ``seed`` [1] of the first; control
    ``period`` [s]; ``baseline``: its programme, if it is another."""
    run = {"period_s": period, "controller": {"type": law}}
    made = [simulated_record(axis, run_from_dict({**run, "program": PROGRAMMES[name], "effects": hidden}), seed + number)
            for number, (name, hidden) in enumerate([(programme, effects)] * 3 + [(baseline or programme, {})])]
    return made[:2], made[2:3], made[3:]


def drawn(names, seed):
    """{id: parameters} of the effects ``names``, of a clear size, by a ``seed`` [1]; None if one has a course that no run file holds."""
    generator, effects = np.random.default_rng([seed, *(sum(map(ord, name)) for name in names)]), {}
    for name in names:
        hidden = fault_injection.one(name, generator)
        if hidden.change or hidden.after or not hidden.effects:
            return None
        effects.update(hidden.effects)
    return json.loads(json.dumps(effects, default=lambda value: value.tolist()))


def judged(answer, hidden):
    """"right", "rival", "missed" or "WRONG": see above."""
    named, open_ = {cause.id for cause in answer.causes}, [set(rivals.ids) for rivals in answer.rivals]
    if named - hidden or any(not ids & hidden for ids in open_):
        return "WRONG"
    if named == hidden and not open_ and (hidden or answer.verdict == "agrees"):
        return "right"
    return "rival" if hidden and hidden <= named.union(*open_) else "missed"


def errors_of(answer, effects):
    """[(effect.parameter, relative error, error in stated standard errors)] of the plain numbers of ``effects`` that the answer states."""
    found = []
    for cause in answer.causes:
        for name, true in effects.get(cause.id, {}).items():
            told = cause.parameters.get(name)
            if told is not None and isinstance(true, (int, float)) and true and told.stderr:
                off = told.value - true
                off = math.remainder(off, 2.0 * math.pi) if "phase" in name else off
                found.append((f"{cause.id}.{name}", off / true, off / told.stderr))
    return found


@contextlib.contextmanager
def by_channel(effects):
    """What each channel tells of the plain numbers of ``effects`` within the block, in words: a list, filled as they are stated."""
    told, usual = [], case.stated_sizes

    def heard(evidences, choice, choices, form):
        sizes = usual(evidences, choice, choices, form)
        for name, (value, stderr, _) in sizes[0].items():
            true = effects.get(choice.effect, {}).get(name)
            if isinstance(true, (int, float)) and true:
                told.append(f"{name} by {form.channel} {100 * (value / true - 1.0):+.2g} ± {100 * stderr / abs(true):.2g} %")
        return sizes

    case.stated_sizes = heard
    try:
        yield told
    finally:
        case.stated_sizes = usual


def loudest(answer):
    """How far the healthy axis is from a finding: the three largest of what is left over its threshold, by channel and coordinate."""
    parts = sorted(((finding.left / finding.threshold, finding.channel, finding.coordinate) for finding in answer.findings), reverse=True)
    return ", ".join(f"{channel} by {coordinate} {part:.2f}" for part, channel, coordinate in parts[:3])


def cases_of(axis, options):
    """The names hidden in each case, a list of tuples."""
    names = options.effect or list(effects_of(axis))
    if options.kind == "single":
        return [(name,) for name in names] * (options.cases or 1)
    if options.kind == "healthy":
        return [()] * (options.cases or 20)
    generator = np.random.default_rng([options.seed, 77])
    return [tuple(generator.choice(names, 2, replace=False)) for _ in range(options.cases or 20)]


def main():
    """Print a line per case, how many were right, open, missed and wrong, and how many numbers were within 1.96 of their stated errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--law", default="self_tuning_observer")
    parser.add_argument("--programme", nargs="+", choices=PROGRAMMES, default=list(PROGRAMMES))
    parser.add_argument("--effect", nargs="+", default=[])
    parser.add_argument("--kind", choices=("single", "two", "healthy"), default="single")
    known = parser.add_mutually_exclusive_group()
    known.add_argument("--no-baseline", action="store_true", help="diagnose without a record of the healthy axis")
    known.add_argument("--baseline", nargs="+", choices=PROGRAMMES, default=[], help="programmes of the healthy record")
    parser.add_argument("--cases", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--period", type=float, default=1e-4, help="control period [s]")
    parser.add_argument("--by-channel", action="store_true", help="what each channel alone tells")
    options = parser.parse_args()
    axis, count, errors = load_axis(config_file("axis.yaml")), Counter(), []
    unknown = set(options.effect) - set(effects_of(axis))
    if unknown:
        parser.error(f"--effect {' '.join(sorted(unknown))}: expected some of {', '.join(effects_of(axis))}")
    for programme, baseline in itertools.product(options.programme, options.baseline or [None]):
        for number, names in enumerate(cases_of(axis, options) if baseline != programme else []):
            effects = drawn(names, options.seed + number)
            if effects is None:
                continue
            learn, held, base = records(axis, options.law, programme, effects, 10 * (options.seed + number), options.period, baseline)
            with by_channel(effects) as channels:
                answer = diagnose_records(axis, learn, held, [] if options.no_baseline else base, seed=0)
            word = judged(answer, set(names))
            off = errors_of(answer, effects)
            count[word], errors = count[word] + 1, errors + off
            print(word, programme, *([f"beside {baseline}"] if baseline else []), number, "+".join(names) or "healthy", answer.verdict, [cause.id for cause in answer.causes],
                  [list(rivals.ids) for rivals in answer.rivals], *(f"{name} {100 * part:+.2g} % {sigmas:+.1f} s" for name, part, sigmas in off),
                  *(channels if options.by_channel else ()),
                  loudest(answer) if not names else "" if word == "right" else json.dumps(effects)[:120], flush=True)
    for word, found in count.items():
        print(f"{word}: {rate(found, sum(count.values()))}")
    print(f"numbers within 1.96 stated errors: {rate(sum(abs(sigmas) < 1.96 for _, _, sigmas in errors), len(errors))}")


if __name__ == "__main__":
    main()
