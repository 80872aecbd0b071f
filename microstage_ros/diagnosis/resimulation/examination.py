"""The diagnosis by re-simulation examined on simulated axes, and how sure its names are.

    ./microstage shell python -m microstage_ros.diagnosis.resimulation.examination --cases 400 --seed 1
    ./microstage shell python -m microstage_ros.diagnosis.resimulation.examination --drive piezo --cases 100 --seed 1

Each case has a seed of its own, from which the axis's numbers, the motion, the noise and what is hidden are drawn
(`examined_axes`): one effect, two, or none. Half of the cases come with a record of the healthy axis, and in half of
them a further record is held out. With ``--calibrate FILE`` the stated probability is fitted to what was right
(`selection.calibration`, with χ² = z² of the cause's surest size and its share for the clarity); without it the stated
probabilities are compared with it.
"""

import argparse
import concurrent.futures
import dataclasses
import multiprocessing
import sys
from typing import NamedTuple

import numpy as np

from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.diagnosis.resimulation.diagnose import diagnose_force_axis
from microstage_ros.diagnosis.resimulation.examined_axes import DRIVES, drawn_axis
from microstage_ros.diagnosis.selection.calibration import calibrate, write_calibration
from microstage_ros.metrology.rates import rate
from microstage_ros.records import Record
from microstage_ros.records.columns import SIMULATED_COLUMNS

KINDS, SHARES = ("one", "two", "healthy"), (0.6, 0.25, 0.15)    # what is hidden, and in how many of the cases
MOST_REPEATS = 4               # of a motion
CLASSES = (0.0, 0.9, 0.97, 1.0)    # edges of the classes of stated probabilities


class Case(NamedTuple):
    """One case to be: with the campaign's seed, its number decides everything; ``drive``: one of `DRIVES`; ``kind``:
    one of `KINDS`, drawn if it is empty."""

    seed: int
    number: int
    drive: str = "force"
    kind: str = ""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What was hidden and what was said.

    ``stated``: (χ² [1], share [1], probability [1], was it hidden) of each named cause; ``baseline``: whether a healthy
    record was there; ``repeats``: how often the learnt record repeats its motion [1].
    """

    number: int
    hidden: tuple
    verdict: str
    named: tuple
    rivals: tuple
    stated: tuple
    baseline: bool
    repeats: int


def examine(case):
    """The `Outcome` of a `Case`."""
    generator, drive = np.random.default_rng([case.seed, case.number]), DRIVES[case.drive]
    axis = drawn_axis(drive, generator)
    effects = _drawn_effects(drive, axis, generator, case.kind)
    hidden = axis.with_effects(effects) if effects else axis
    noise = drive.noise(generator)
    with_baseline, with_holdout = generator.uniform(size=2) < 0.5

    def record(machine, name, repeats):
        run = Run(noise=noise, program=drive.program(generator, axis, repeats))
        columns = simulate(machine, run, seed=int(generator.integers(2**31)))
        seen = drive.seen or [key for key in columns if key not in SIMULATED_COLUMNS]
        return Record(axis.value("period"), {key: columns[key] for key in seen}, name)

    repeats = [int(generator.integers(1, MOST_REPEATS + 1)) for _ in range(3)]
    records = [record(hidden, "learned", repeats[0])]
    holdout = [record(hidden, "held out", repeats[1])] if with_holdout else []
    baseline = [record(axis, "healthy", repeats[2])] if with_baseline else []
    answer = diagnose_force_axis(axis, records, holdout, baseline, seed=0)
    stated = tuple((float(one.evidence), one.share, one.probability, one.id in effects) for one in answer.causes)
    return Outcome(case.number, tuple(effects), answer.verdict, tuple(one.id for one in answer.causes),
                   tuple(one.ids for one in answer.rivals), stated, bool(baseline), repeats[0])


def _drawn_effects(drive, axis, generator, kind):
    """{id: parameters} of one effect, two or none that this `Drive` can have, clearly visible on the ``axis``; how
    many: a ``kind`` of `KINDS`, or drawn."""
    drawn = str(generator.choice(KINDS, p=SHARES))
    count = {"one": 1, "two": 2, "healthy": 0}[kind or drawn]
    sizes = drive.sizes(axis, generator)
    return {str(name): sizes[str(name)] for name in generator.choice(sorted(sizes), count, replace=False)}


def report(outcomes):
    """The figures of ``outcomes``, `Outcome` each, as lines of text with 95 % intervals."""
    hidden = [one for one in outcomes if one.hidden]
    healthy = [one for one in outcomes if not one.hidden]
    named = [bool(one.named or one.rivals) for one in healthy]
    wrong = [bool(set(one.named) - set(one.hidden)) for one in outcomes]
    stated = [cause for one in outcomes for cause in one.stated]
    lines = [
        f"first name right, or a rival right: {rate(sum(_first(one) for one in hidden), len(hidden))}",
        f"nothing seen of what is hidden: {rate(sum(one.verdict == 'agrees' for one in hidden), len(hidden))}",
        f"a wrong name anywhere: {rate(sum(wrong), len(wrong))}",
        f"healthy axes with a name or rivals: {rate(sum(named), len(healthy))}",
        f"healthy axes unexplained: {rate(sum(one.verdict == 'unexplained' for one in healthy), len(healthy))}",
        f"names right: {rate(sum(cause[3] for cause in stated), len(stated))}",
    ]
    for low, high in zip(CLASSES, CLASSES[1:]):
        inside = [(p, right) for _, _, p, right in stated if low <= p < high or p == high == 1.0]
        if inside:
            lines.append(f"stated {low:g} to {high:g}, mean {np.mean([p for p, _ in inside]):.3f}: right "
                         f"{rate(sum(right for _, right in inside), len(inside))}")
    return lines


def _first(outcome):
    named = outcome.named[:1] or sum(outcome.rivals, ())
    return bool(set(named) & set(outcome.hidden))


def main(argv=None):
    """Examine, print the figures, and write the calibration where one is asked for. Returns 0."""
    parser = argparse.ArgumentParser(prog="examination", description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--drive", choices=sorted(DRIVES), default="force")
    parser.add_argument("--kind", choices=KINDS, default="", help="what to hide in every case (default: drawn)")
    parser.add_argument("--calibrate", metavar="FILE")
    parser.add_argument("--verbose", action="store_true")
    arguments = parser.parse_args(argv)
    outcomes = []
    cases = [Case(arguments.seed, number, arguments.drive, arguments.kind) for number in range(arguments.cases)]
    fresh = multiprocessing.get_context("spawn")     # processes that inherit no threads
    with concurrent.futures.ProcessPoolExecutor(arguments.jobs, mp_context=fresh) as pool:
        for outcome in pool.map(examine, cases):
            outcomes.append(outcome)
            if arguments.verbose:
                print(outcome, flush=True)
    print("\n".join(report(outcomes)))
    if arguments.calibrate:
        words = " ".join(["./microstage shell python -m microstage_ros.diagnosis.resimulation.examination",
                          *(sys.argv[1:] if argv is None else argv)])
        named = [(evidence, share, right) for one in outcomes for evidence, share, _, right in one.stated]
        write_calibration(arguments.calibrate, calibrate(named), words)
    return 0


if __name__ == "__main__":
    sys.exit(main())
