"""How near the diagnosis of many cases comes to its constants: between which values of each no decision turns.

A constant that is only compared with something is replaced, while cases of a campaign are diagnosed, by a number that
keeps the value at which each comparison would have turned out otherwise. All are watched at once, in one run; the
ranges that stand beside constants ("calibrated by: validation.margins (low to high)") are of

    ./microstage shell python -m microstage_ros.diagnosis.validation.margins --seed 9811

and, where a comment says so, of the same command with other cases: ``--effect`` names what each of them has,
``--known`` goes no further than to what is found before anything is selected.

Wherever in its range a constant lies, the others as they are, every decision of these cases (27, one of each effect)
is the same. A range is no more than that: a case that comes nearer makes it narrower. A constant to which no case comes
near from one of the two sides is not calibrated by them, and its comment names no range.
"""

import argparse
import collections
import contextlib
import importlib
import itertools
import math
import pkgutil
import sys

import numpy as np

from microstage_ros import diagnosis
from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.diagnosis.prerequisites.encoder import seen_interpolation
from microstage_ros.diagnosis.prerequisites.prerequisites import find_known
from microstage_ros.diagnosis.validation.campaign import KINDS, draw, examinations, examine, said
from microstage_ros.diagnosis.validation.ways import CASES
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file

TINY = np.finfo(float).tiny
#: Module of the diagnosis to those of its constants that are watched.
WATCHED = {
    "prerequisites.amplifier": ("CLEAR", "IN_BASELINE", "TAUGHT_SHARE"),
    "prerequisites.lines": ("NARROW",),
    "prerequisites.lost_motion": ("STANDS_OUT", "EXPLAINS", "EXPLAINS_FIRST", "LEAST"),
    "prerequisites.periods": ("REAL", "ONE_PHASE", "SNAP", "LEAST_VALUES"),
    "prerequisites.resonant": ("STANDS_OUT", "BETTER", "FAR", "EXPLAINS"),
    "prerequisites.slow_drift": ("PREDICTED_SHARE", "LEAST", "MATTERS", "OF_ALL"),
    "prerequisites.timing": ("LEAST_LOST", "LOST_AGAIN"),
    "selection.judge": ("RIVAL_SHARE", "SCATTER", "UNSEEN", "STRANGER", "STRANGER_IN_TORQUE", "READING_SHARE",
                        "LEFT_SHARE", "LOOSE", "SLACK", "MOST_LEFT"),
    "selection.selection": ("HELD_SHARE", "ONE_RESONANCE", "SIMPLER", "SIMPLER_SHARE"),
    "selection.splinters": ("FAINT", "FAINT_GAIN", "MAJOR", "MINOR", "MINOR_BESIDE", "OWN_SHARE"),
}


class Turns(list):
    """Values at which comparisons with a ``constant`` turn out otherwise."""

    def __init__(self, constant):
        super().__init__()
        self.constant = constant


class Watched(float):
    """scale · C + offset of a ``constant`` C, which adds to the list ``turns`` the C at which each comparison turns out
    otherwise."""

    __array_ufunc__ = None      # numbers of numpy leave operations to this class
    constant: float
    turns: list
    scale: float
    offset: float

    def __new__(cls, constant, turns, scale=1.0, offset=0.0):
        made = super().__new__(cls, scale * constant + offset)
        made.constant, made.turns, made.scale, made.offset = constant, turns, scale, offset
        return made

    def _with(self, scale, offset):
        return Watched(self.constant, self.turns, scale, offset)

    def __mul__(self, other):
        return self._with(self.scale * float(other), self.offset * float(other))

    def __truediv__(self, other):
        return self._with(self.scale / float(other), self.offset / float(other))

    def __add__(self, other):
        return self._with(self.scale, self.offset + float(other))

    def __sub__(self, other):
        return self._with(self.scale, self.offset - float(other))

    def __rsub__(self, other):
        return self._with(-self.scale, float(other) - self.offset)

    def __rtruediv__(self, other):
        return float(other) / float(self)

    __rmul__, __radd__ = __mul__, __add__

    def _turn(self, other):
        if self.scale and math.isfinite(float(other)):
            self.turns.append((float(other) - self.offset) / self.scale)
        return float(other)

    def __lt__(self, other):
        return float(self) < self._turn(other)

    def __le__(self, other):
        return float(self) <= self._turn(other)

    def __gt__(self, other):
        return float(self) > self._turn(other)

    def __ge__(self, other):
        return float(self) >= self._turn(other)

    __hash__, __eq__ = float.__hash__, float.__eq__


def modules_with(name, value):
    """Modules of the diagnosis in which ``name`` is this very ``value`` [any unit]: where it stands or was imported."""
    every = pkgutil.walk_packages(diagnosis.__path__, "microstage_ros.diagnosis.")
    return [module for module in (importlib.import_module(found.name) for found in every)
            if vars(module).get(name) is value]


@contextlib.contextmanager
def watching(names):
    """Context in which these constants are `Watched`, wherever they were imported: {(module, name): list of turns}."""
    turns, before = {}, []
    for place, constants in names.items():
        owner = importlib.import_module(f"microstage_ros.diagnosis.{place}")
        for name in constants:
            value = getattr(owner, name)
            before += [(module, name, value) for module in modules_with(name, value)]
            watched = _watched(value, place, name, turns)
            for module in modules_with(name, value):
                setattr(module, name, watched)
    try:
        yield turns
    finally:
        for module, name, value in before:
            setattr(module, name, value)


def _watched(value, place, name, turns):
    """`Watched` of a number, or a table {key: `Watched`} of a table of numbers; their lists are added to ``turns``."""
    if isinstance(value, dict):
        return {key: _watched(one, place, f"{name}[{key!r}]", turns) for key, one in value.items()}
    return Watched(value, turns.setdefault((place, name), Turns(value)))


def around(constant, turns):
    """(largest below, smallest not below) of the values at which a comparison with a constant turns.

    Parameters
    ----------
    constant : its value [any unit]. turns : those values, shape (n,).
    """
    return (max((t for t in turns if t < constant), default=-math.inf),
            min((t for t in turns if t >= constant), default=math.inf))


def main(argv=None):
    """Print the range of every watched constant in which no decision of the cases turns."""
    parser = argparse.ArgumentParser(prog="margins", description=__doc__.split("\n")[0])
    parser.add_argument("--kind", nargs="+", default=["single"], choices=KINDS)
    parser.add_argument("--world", nargs="+", default=["first"], choices=list(CASES))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=27, help="of each kind in each world")
    parser.add_argument("--effect", nargs="+", default=[""], help="that every case has, one after the other")
    parser.add_argument("--known", action="store_true", help="only what is found before anything is selected")
    parser.add_argument("--no-baseline", action="store_true", help="give the diagnosis no healthy record")
    given = parser.parse_args(argv)
    axis, errors = str(config_file("axis.yaml")), collections.defaultdict(list)
    with watching(WATCHED) as turns:
        for world, kind, effect in itertools.product(given.world, given.kind, given.effect):
            for case in examinations(given.cases, given.seed, axis, kind, effect=effect, world=world,
                                     baseline=not given.no_baseline):
                if given.known:
                    look_for_known(case)
                    continue
                outcome = examine(case)
                for name, *numbers in outcome.errors:
                    errors[name].append(numbers)
                print(f"{case.number:4d} {outcome.name:40} {said(outcome)} {outcome.error}", file=sys.stderr,
                      flush=True)
            print(f"up to {kind} {effect}, {world} world", *rows(turns), *size_rows(errors), sep="\n", flush=True)


def look_for_known(case):
    """Find what must be known of an `Examination` before any of its residuals means something: a gap, a slow amplifier,
    lines of the floor, a drive train far from the model's, a drift."""
    axis, (what, friction) = load_axis(case.axis), draw(case)
    records = CASES[case.world](axis, what, case.seed * 100_003 + case.number, friction)
    groups = dict(zip(("learn", "held", "base"), records if case.baseline else (*records[:2], [])))
    find_known(groups, seen_interpolation(drive_of(axis), groups["base"]))


def rows(turns):
    """A line of text for every constant of ``turns`` {(module, name): values}."""
    for (place, name), values in turns.items():
        value = values.constant
        low, high = around(value, values)
        yield f"{place + '.' + name:45} {value:10.4g}   {low:10.4g} to {high:10.4g}   {len(values)} comparisons"


def size_rows(errors):
    """A line of text for every parameter of ``errors`` {name: [(error, standard error, truth)], shape (n, 3)}.

    It says how far sizes are off: root mean square of the error in its stated standard errors, and relative to truth.
    """
    for name in sorted(errors):
        error, stderr, truth = np.array(errors[name]).T
        stated, relative = (np.sqrt(np.mean((error / np.maximum(np.abs(of), TINY)) ** 2)) for of in (stderr, truth))
        yield f"{name:45} {stated:6.2f} standard errors, {relative:8.3g} of the truth   {len(error)} sizes"


if __name__ == "__main__":
    main()
