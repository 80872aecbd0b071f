"""The diagnosis examined: many axes with something hidden, and what the diagnosis says of them.

Every case has its own seed, from which axis records, effect and size are drawn; the diagnosis gets the
records alone. Scores: right name first, both of two, false alarms on healthy axes, wrong names for what
the catalogue does not hold, coverage of the stated intervals, held-out gain, time.
"""

import collections
import dataclasses
import time

import numpy as np

from microstage_ros.diagnosis.batch import diagnose_records, on_cores
from microstage_ros.diagnosis.fleet import on_cluster
from microstage_ros.diagnosis.validation import fault_injection as hidden
from microstage_ros.diagnosis.validation import ways as to_the_floor
from microstage_ros.diagnosis.validation.simulated_records import Hidden
from microstage_ros.diagnosis.validation.ways import CASES, SIGMAS
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.effects import effects_of

KINDS = ("single", "healthy", "two", "outside")
SHARES = (0.55, 0.15, 0.15, 0.15)          # of the kinds among mixed cases
FRICTION = (0.02, 0.06)                    # range of the relative random friction
RELIABILITY = (0.0, 0.8, 0.95, 1.0)       # edges of the classes of stated probabilities
NOTHING = "nothing"
MOST_TERMS = 5     # of a ripple; longer lists are profiles


@dataclasses.dataclass(frozen=True)
class Examination:
    """One case to be: its number decides everything else together with the campaign's seed."""

    number: int
    seed: int
    kind: str
    axis: str
    strength: float = 1.0
    effect: str = ""
    world: str = "first"
    baseline: bool = True


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a case; ``covered`` lists (parameter, inside its 95 % interval), ``stated`` (id, probability,
    χ² on held-out records, clarity, whether it was hidden) of every named cause, and ``doubted`` the same of those
    too unlikely to be named; ``errors`` lists (parameter, error, standard error, truth); ``ways`` a `ways.Way` of every
    named cause."""

    number: int
    kind: str
    hidden: tuple
    name: str
    verdict: str
    named: tuple
    rivals: tuple
    covered: tuple
    before: float
    after: float
    floor: float
    seconds: float
    sizes: dict
    error: str = ""
    stated: tuple = ()
    doubted: tuple = ()
    errors: tuple = ()
    ways: tuple = ()

    @property
    def removed(self):
        """Share of the way from before to the noise floor that the diagnosis went; NaN without such a way."""
        way = self.before - self.floor
        return (self.before - self.after) / way if way > 0.0 else float("nan")


def examinations(count, seed, axis, kind="mixed", strength=1.0, effect="", world="first", baseline=True):
    """``count`` [1] cases of a ``seed`` [1], effects ``strength`` [1] times the usual. Singles and pairs go through
    the whole catalogue before an effect comes again."""
    order = np.random.default_rng([seed, 0]).choice(len(KINDS), count, p=SHARES)
    kinds = [KINDS[k] for k in order] if kind == "mixed" else [kind] * count
    return [Examination(number, seed, one, axis, strength, effect, world, baseline) for number, one in enumerate(kinds)]


def draw(examination):
    """(`Hidden`, friction) of a case."""
    generator = np.random.default_rng([examination.seed, 1, examination.number])
    names = effects_of(load_axis(examination.axis))
    turn = np.random.default_rng([examination.seed, 2, examination.number // len(names)]).permutation(names)
    name = examination.effect or str(turn[examination.number % len(names)])
    friction = float(generator.uniform(*FRICTION))
    if examination.kind == "healthy":
        return Hidden("healthy"), friction
    if examination.kind == "outside":
        kind = sorted(hidden.OUTSIDE)[examination.number % len(hidden.OUTSIDE)]
        return hidden.outside(kind, generator, examination.strength), friction
    if examination.kind == "two":
        other = str(generator.choice([n for n in names if n != name]))
        return hidden.two((name, other), generator, examination.strength), friction
    return hidden.one(name, generator, examination.strength), friction


def examine(examination):
    """Make one case, diagnose it, compare. Returns `Outcome`; an error becomes part of it."""
    axis = load_axis(examination.axis)
    what, friction = draw(examination)
    machine = axis, what, examination.seed * 100_003 + examination.number, friction
    records, holdout, baseline = CASES[examination.world](*machine)
    twin = to_the_floor.twins(examination.world, *machine)
    if not examination.baseline:  # the axis file alone says what noise there is
        baseline = []
    start = time.perf_counter()      # making the records does not count
    known = dict(number=examination.number, kind=examination.kind, hidden=what.ids, name=what.name, sizes=what.effects)
    try:
        answer = diagnose_records(axis, records, holdout, baseline, seed=0, twin=twin)
    except Exception as error:  # noqa: BLE001  a case that fails is an outcome, too
        nothing = float("nan")
        return Outcome(**known, verdict="error", named=(), rivals=(), covered=(), before=nothing, after=nothing,
                       floor=nothing, seconds=time.perf_counter() - start, error=f"{type(error).__name__}: {error}")
    gain, seconds = answer.gain, time.perf_counter() - start
    return Outcome(
        **known,
        verdict=answer.verdict,
        named=tuple(cause.id for cause in answer.causes),
        rivals=tuple(tuple(rivals.ids) for rivals in answer.rivals),
        covered=tuple(covered(answer.causes, what.effects)),
        errors=tuple(errors_of(answer.causes, what.effects)),
        before=gain.before if gain else float("nan"),
        after=gain.after if gain else float("nan"),
        floor=gain.floor if gain else float("nan"),
        seconds=seconds,
        stated=_stated(answer.causes, what),
        doubted=_stated(answer.doubtful, what),
        ways=to_the_floor.ways_of(examination.world, *machine, answer, baseline),
    )


def _stated(causes, what):
    return tuple((c.id, c.probability, c.evidence, c.clarity, c.id in what.ids) for c in causes)


def covered(causes, truth):
    """(id.parameter, truth within 1.96 standard errors) for every scalar that was hidden and fitted by the same
    name."""
    for name, error, stderr, _ in errors_of(causes, truth):
        yield name, bool(abs(error) <= SIGMAS * stderr)


def errors_of(causes, truth):
    """(id.parameter, error, standard error, truth) for every scalar that was hidden and fitted by the same name, each
    in the parameter's unit.

    Phases are compared around the circle."""
    for cause in causes:
        mine = truth.get(cause.id, {})
        term = _term_of(cause, mine)
        if "factors" in mine and "factors" in cause.effect:      # of a profile its spread is stated
            mine = mine | {"rms": hidden.rms_along(mine, cause.effect)}
        for name, number in cause.parameters.items():
            value = mine.get(name)
            value = value[term] if isinstance(value, list) and len(value) < MOST_TERMS else value
            if isinstance(value, (int, float)) and np.isfinite(number.stderr):
                error = number.value - value
                if number.unit == "rad" and name.startswith("phase"):
                    error = (error + np.pi) % (2.0 * np.pi) - np.pi
                yield f"{cause.id}.{name}", float(error), float(number.stderr), float(value)


def _term_of(cause, truth):
    """Which of several hidden terms a cause states, the largest of those that it found: the nearest in frequency or
    period; the first where it states neither."""
    for name in ("cycles_per_turn", "period_m"):
        if name in cause.parameters and isinstance(truth.get(name), list):
            return int(np.argmin(np.abs(np.array(truth[name]) - cause.parameters[name].value)))
    return 0


def run(examined, jobs, scheduler=None):
    """Outcomes as they end, from ``jobs`` [1] processes or from the workers of a Dask ``scheduler``.

    Raises InputError if the scheduler cannot be used. A case whose worker died twice is left out.
    """
    if scheduler:
        for _, outcome in on_cluster(examined, examine, scheduler):
            if not isinstance(outcome, Exception):
                yield outcome
    elif jobs <= 1:
        yield from map(examine, examined)
    else:
        for _, outcome in on_cores(examined, examine, jobs):
            if isinstance(outcome, Exception):
                raise outcome
            yield outcome


def said(outcome):
    """The column of the confusion matrix: first name, or what stands in its place."""
    if outcome.named:
        return outcome.named[0]
    if outcome.rivals:
        return (
            "undetermined, right one among them"
            if set(outcome.hidden) & set(sum(outcome.rivals, ()))
            else "undetermined"
        )
    return NOTHING if outcome.verdict == "agrees" else outcome.verdict


def unexplained(outcome):
    """Whether the answer names nothing, not even rivals, but says that something stands out."""
    return outcome.verdict == "unexplained" and not outcome.named and not outcome.rivals


def false_alarm(outcome):
    """Whether anything but ``agrees`` is said of an axis; of a healthy one a false alarm. An error is counted apart."""
    return outcome.verdict not in ("agrees", "error")


def confusion(outcomes):
    """{hidden name: Counter of what was said first}, single effects, healthy axes and outside causes."""
    table = collections.defaultdict(collections.Counter)
    for outcome in outcomes:
        if outcome.kind != "two":
            table[outcome.name][said(outcome)] += 1
    return dict(table)


def scores(outcomes):
    """Named figures of a campaign: {figure: (hits, of)} and medians {figure: value}."""
    by = {kind: [o for o in outcomes if o.kind == kind] for kind in KINDS}
    covers = [inside for o in outcomes for _, inside in o.covered]
    single = by["single"]
    right = [o for o in single if o.named[:1] == o.hidden]
    named = [o for o in outcomes if o.named]
    clarity = [one[3] for o in outcomes for one in o.stated]
    ways = [to_the_floor.Way(*way) for o in outcomes for way in o.ways]
    counts = {
        "single: right name first": (len(right), len(single)),
        "single: undetermined": (sum(o.verdict == "undetermined" for o in single), len(single)),
        "single: a wrong name first": (sum(bool(o.named) and o.named[0] not in o.hidden for o in single), len(single)),
        "two: both named": (sum(set(o.hidden) <= set(o.named) for o in by["two"]), len(by["two"])),
        "two: at least one named": (sum(bool(set(o.hidden) & set(o.named)) for o in by["two"]), len(by["two"])),
        "healthy: something named": (sum(bool(o.named or o.rivals) for o in by["healthy"]), len(by["healthy"])),
        "healthy: unexplained": (sum(unexplained(o) for o in by["healthy"]), len(by["healthy"])),
        "healthy: false alarms": (sum(false_alarm(o) for o in by["healthy"]), len(by["healthy"])),
        "a wrong name anywhere in the answer": (
            sum(bool(set(o.named) - set(o.hidden)) for o in outcomes),
            len(outcomes),
        ),
        "outside: a wrong name": (sum(bool(o.named) for o in by["outside"]), len(by["outside"])),
        "outside: seen, and not explained away": (
            sum(o.verdict in ("unexplained", "partly_explained") for o in by["outside"]),
            len(by["outside"]),
        ),
        "sizes inside their 95 % interval": (sum(covers), len(covers)),
        "right and 90 % of the way to the noise": (sum(o.removed >= 0.9 for o in right), len(right)),
        "named, and 90 % of the way to the noise": (sum(o.removed >= 0.9 for o in named), len(named)),
        # of all channels together the floor of the quiet ones, which differs from record to record, is the larger part
        "causes named, and 90 % of the way in their own channel": (sum(c >= 0.9 for c in clarity), len(clarity)),
        **to_the_floor.counts(ways),
        "errors": (sum(bool(o.error) for o in outcomes), len(outcomes)),
    }
    seconds = [o.seconds for o in outcomes]
    medians = {
        "held-out gain, median share of the way": float(np.nanmedian([o.removed for o in right]))
        if right
        else float("nan"),
        to_the_floor.EXPECTED: to_the_floor.expected(ways),
        "seconds per case, median": float(np.median(seconds)),
        "seconds per case, longest": float(np.max(seconds)),
    }
    return counts, medians


def reliability(outcomes):
    """Reliability diagram of the stated probabilities: list of (low, high, mean stated, right, named) by class."""
    stated = [(probability, right) for o in outcomes for _, probability, _, _, right in o.stated]
    rows = []
    for low, high in zip(RELIABILITY, RELIABILITY[1:]):
        inside = [(p, right) for p, right in stated if low <= p < high or p == high == 1.0]
        if inside:
            rows.append(
                (low, high, float(np.mean([p for p, _ in inside])), sum(right for _, right in inside), len(inside))
            )
    return rows
