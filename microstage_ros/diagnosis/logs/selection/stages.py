"""A stage of the diagnosis: one set of channels, its difference between now and baseline, and the causes chosen in
it."""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.logs.selection import decide, stacking
from microstage_ros.diagnosis.logs.preprocessing import spread
from microstage_ros.diagnosis.logs.preprocessing.channels import FLUCTUATION
from microstage_ros.diagnosis.logs.preprocessing.coordinates import FREE
from microstage_ros.diagnosis.logs.selection.effects import SIGNATURES
from microstage_ros.diagnosis.logs.selection.visibility import visibility

# times the usual largest size, up to which an effect may be named: a size is no reason to doubt it
UNUSUAL = 4.0
PEAK = 2.0                 # standard deviations by which the largest of some twenty samples exceeds their mean
TELLING = 0.1              # of the information on an effect that a repetition left out must have to judge its spread
PRIOR_LOO = 4.0            # weight, in repetitions, of "the spread is as learned" against the repetitions left out
#: Shares of a change that a column misses at steady speed, and at starts and stops, where friction is not yet that of
#: sliding. A judgement, held by `microstage log --examine` on machines of four friction laws.
FORM = {"effort": (0.08, 0.35), "voltage": (0.08, 0.35), "error": (0.15, 0.6)}
MOST_LEFT_OUT = 30         # repetitions that are left out in turn


@dataclasses.dataclass
class Stage:
    """One problem with its answer: the drive's effort (and voltage), or the following error.

    ``coordinates``, ``spreads``: {channel: …}; ``only``: ids that are looked for here, None for all; ``without``: ids
    that are not; ``also``: rivals by nature of these signals; ``free``: names of columns that the error may follow
    without a cause of its own; ``largest``: usual sizes by column (`visibility.visibility`).
    """

    coordinates: dict
    spreads: dict
    only: tuple | None = None
    without: tuple = ()
    also: dict = dataclasses.field(default_factory=dict)
    free: tuple = ()
    largest: dict = dataclasses.field(default_factory=dict)
    problem: decide.Problem = dataclasses.field(init=False)
    seen: dict = dataclasses.field(default_factory=dict)
    chosen: list = dataclasses.field(default_factory=list)
    whole: float = 0.0
    share: float = 1.0
    left: float = 0.0

    def solve(self, open_sign):
        """Choose causes; keep none that explain too little of what stands out. Returns a sentence, or an empty one."""
        self.problem = build(self)
        calibrate(self)
        without_form = build(self, form=False)        # what would show does not depend on how large a change there is
        without_form.inflation = self.problem.inflation
        self.seen = visibility(without_form, self.largest)
        possible = {name for name, entry in self.seen.items() if entry[1] < UNUSUAL * entry[3]}
        self.chosen = decide.choose(self.problem, possible, open_sign, self.also)
        self.whole, self.share = decide.stands_out(self.problem, self.chosen)
        said = ""
        if (
            self.chosen
            and self.share < decide.EXPLAINED
            and self.whole < decide.WHOLE
            and self.chosen[0].log_p > decide.BEYOND_DOUBT
        ):
            said = (
                f"Best single name, not held to be the answer because it removes only {self.share:.0%} of what stands"
                f" out: {decide.plain(self.chosen[0].name)}."
            )
            self.chosen = []
        self._measure()
        return said

    def drop(self, name):
        """Leave out the chosen cause of this form."""
        self.chosen = [choice for choice in self.chosen if choice.name != name]
        self._measure()

    def _measure(self):
        """Share of what stands out that the causes remove, and log p of what they leave."""
        self.share = decide.stands_out(self.problem, self.chosen)[1]
        removed = self.problem.taken([c.name for c in self.chosen])[0]
        k = len(self.problem.difference)
        self.left = float(
            decide.log_sf(
                max(self.problem.whole - removed, 0.0) / k / self.problem.whole_inflation, k, self.problem.dof
            )
        )


def form_error(coordinates, difference):
    """Variances (K,) for what the columns miss of a change's form: in proportion to the change at steady speed.

    ``difference``: of the means of now and of the baseline, shape (K,).
    """
    kinds = coordinates.kind.astype(str)
    steady, changing = kinds == "steady", np.isin(kinds, ("start", "brake"))
    steadily, starting = FORM[coordinates.channel.name]
    at_speed, at_change = (float(np.mean(difference[own] ** 2)) if own.any() else 0.0 for own in (steady, changing))
    of_steady = steadily**2 * (at_speed + at_change)       # a start rings on into the steady part
    of_change = starting**2 * max(at_speed, 0.5 * at_change)
    return np.select(
        [steady, changing, kinds == "breakaway"],
        [of_steady, of_change, of_change + _of_peaks(coordinates, difference)],
        0.0,
    )


def _of_peaks(coordinates, difference):
    """Variance of a peak by what else makes peaks: ripple of another amplitude, and noise of another size."""
    kinds = coordinates.kind.astype(str)
    ripple = np.isin(kinds, ("ripple", "ripple high"))
    rough = (kinds == "rough") & (coordinates.direction != 0.0)
    noise = 0.0
    if rough.any():
        # of a second difference of white noise
        level = np.exp(np.nanmean(coordinates.baseline[:, rough])) / np.sqrt(6.0)
        noise = PEAK * level * (np.exp(np.mean(difference[rough])) - 1.0)
    return (float(np.sum(difference[ripple] ** 2)) if ripple.any() else 0.0) + float(noise) ** 2


def stages_of(reduced, spreads, without=()):
    """The stages that the channels allow, in order: the effort first, for what it shows the error follows.

    ``reduced``: {channel: `Coordinates`}.
    """
    strong = {n: c for n, c in reduced.items() if n != "error"}
    stages = [Stage(strong, {n: spreads[n] for n in strong}, without=without)] if strong else []
    if "error" in reduced:
        only = (
            tuple(
                n
                for n, s in SIGNATURES.items()
                if not s.effort and (s.error or any(c == "error" for c, _ in s.amplitudes))
            )
            if strong
            else None
        )
        if reduced["error"].channel.kind == FLUCTUATION:
            only = ("floor_vibration", "sampling_jitter")
        stages.append(Stage({"error": reduced["error"]}, {"error": spreads["error"]}, only, without))
    return stages


def build(stage, now=None, base=None, assembly=True, form=True):
    """`Problem` of the mean of now against the mean of the baseline.

    ``now``, ``base``: {channel: vectors (repetitions, K)} in place of those of the stage; ``assembly``: whether the two
    sides may be different states of assembly; ``form``: whether what columns miss of the change itself counts as noise.
    """
    differences, blocks, where, kinds = [], [], [], []
    for name, coordinates in stage.coordinates.items():
        vectors_now = coordinates.now if now is None else now[name]
        vectors_base = coordinates.baseline if base is None else base[name]
        number_now, number_base = (np.isfinite(v).sum(axis=0) for v in (vectors_now, vectors_base))
        d = spread.mean_of(vectors_now)[0] - spread.mean_of(vectors_base)[0]
        good = np.isfinite(d)
        c = stage.spreads[name].covariance(coordinates, number_now, number_base, assembly)
        for column in stage.free:
            for free in coordinates.columns.get(column, np.zeros((len(d), 0))).T:
                c = c + FREE**2 * np.outer(free, free)
        if now is None:
            c = c + np.diag(coordinates.grown / np.maximum(number_now, 1))
        if form:
            c = c + np.diag(form_error(coordinates, np.nan_to_num(d)))
        c[~good, :] = 0.0
        c[:, ~good] = 0.0
        c[~good, ~good] = FREE**2
        differences.append(np.nan_to_num(d))
        blocks.append(c)
        where += [name] * len(d)
        kinds += list(coordinates.kind)
    size = sum(len(d) for d in differences)
    covariance, at = np.zeros((size, size)), 0
    for block in blocks:
        covariance[at: at + len(block), at: at + len(block)] = block
        at += len(block)
    effects, parts = stacking.effects_of(stage.coordinates, stage.only, stage.without)
    of_effort = "error" not in stage.coordinates
    return decide.Problem(
        np.concatenate(differences),
        covariance,
        effects,
        parts,
        np.array(where),
        np.array(kinds, dtype=object),
        _dof(next(iter(stage.spreads.values()))),
        direction=np.concatenate([c.direction for c in stage.coordinates.values()]) if of_effort else None,
    )


def _dof(learned):
    """Degrees of freedom behind the covariance: those of the repetitions and of assembly, by their usual shares
    (Satterthwaite)."""
    share = 0.4
    return 1.0 / (share**2 / learned.dof_repetition + (1.0 - share) ** 2 / learned.dof_assembly)


def calibrate(stage):
    """Inflation of each effect's variance so that repetitions left out of the baseline show what the spread predicts.

    Variance factor = (ν₀ + Σ F) / (ν₀ + n) with the F ratio of every repetition against the others, at least 1.
    """
    first = next(iter(stage.coordinates.values()))
    count = len(first.baseline)
    if count < 3:
        return
    problem, whole = stage.problem, []
    ratios = {name: [] for name in problem.effects}
    for left in range(min(count, MOST_LEFT_OUT)):
        codes = set(first.condition[np.isfinite(first.baseline[left])])
        like = [k for k in range(count) if k != left and set(first.condition[np.isfinite(first.baseline[k])]) & codes]
        others = [k for k in like if first.group_baseline[k] == first.group_baseline[left]]
        across = not others
        rows = np.array(others or like)
        if not len(rows):
            continue
        single = build(stage, {n: r.baseline[[left]] for n, r in stage.coordinates.items()},
                       {n: r.baseline[rows] for n, r in stage.coordinates.items()}, assembly=across)
        for name in ratios:
            if np.sum(single.white[name] ** 2) < TELLING * np.sum(problem.white[name] ** 2):
                continue           # this repetition says next to nothing of the effect
            ratios[name].append(single.taken([name])[0] / single.white[name].shape[1])
        whole.append(single.whole / len(single.difference))
    for name, values in ratios.items():
        problem.inflation[name] = max(1.0, (PRIOR_LOO + sum(min(v, 100.0) for v in values)) / (PRIOR_LOO + len(values)))
    if whole:
        problem.whole_inflation = max(1.0, (PRIOR_LOO + sum(whole)) / (PRIOR_LOO + len(whole)))
