"""Which causes a force-driven axis has: forward selection, look-alikes, backward check.

A candidate is first screened with derivatives at the present model (a few re-simulations), the best ones
are fitted. A candidate is kept if the mean square of the force falls on time left out and on parts of the
motion left out (see `folds`) by more than a smallest gain, and if its size is far outside its own
uncertainty. In the end every cause must still pay when it alone is taken out and all else is fitted again.

The axis's own numbers (mass, friction, offset) come first, with a larger smallest gain: they are named as a
change only if that alone explains much; else they are fitted along with the causes, as re-identification.
"""

from dataclasses import dataclass

import numpy as np

from microstage_ros.discrepancy.resimulation.fit import BLOCK_S, fit, jacobian, standard_errors
from microstage_ros.discrepancy.resimulation.folds import left_out_residual, mean_square

SMALLEST_GAIN = 0.02           # of the mean square that is there: causes below it are not worth a name
OWN_GAIN = 0.10                # the same for the axis's own numbers: a file's numbers may be a little off
LARGEST_COUNT = 8              # causes
CERTAIN = 4.0                  # size over standard error; with about 15 candidates a healthy axis passes in < 0.1 %
LOOK_ALIKE = 0.15              # rivals differ in gain by less than this share of it
REPLACED = 0.3                 # and gain less than this share of it on top of the chosen one
REFITTED = 3                   # candidates fitted at every step


@dataclass(frozen=True)
class Stage:
    """A fitted model with its residual, derivatives and mean squares on left-out time and motion."""

    model: object
    residual: np.ndarray
    columns: np.ndarray
    time: float
    motion: float

    @property
    def last(self):
        """The cause that was added last."""
        return self.model.chosen[-1]


@dataclass(frozen=True)
class Selection:
    """What `Selector.select` found.

    ``stages``: the axis as given, then with every cause added, then re-identified and checked (the last is
    the answer). ``rivals``: {id: [ids that the records cannot tell from it]}. ``own``: what fitting the
    axis's own numbers alone gives, a `Stage`.
    """

    stages: tuple
    rivals: dict
    own: Stage

    @property
    def model(self):
        """The model with all causes that stayed."""
        return self.stages[-1].model


class Selector:
    """Forward and backward selection over one closed loop."""

    def __init__(self, loop, folds, period, progress=None):
        self.loop, self.folds, self.progress = loop, folds, progress or (lambda text: None)
        self.block = max(int(BLOCK_S / period), 1)

    def stage(self, model, residual, known=None):
        """Judge a fitted model on left-out time and motion (one of them where the motion has no repetition)."""
        columns = jacobian(self.loop, model, residual, known)
        time, motion = self.left_out(columns, residual)
        return Stage(model, residual, columns, time, motion)

    def left_out(self, columns, residual):
        """Mean squares on time and on motion left out."""
        learn = self.folds.learn
        time = mean_square(left_out_residual(columns, residual, learn, self.folds.time), learn)
        if not self.folds.motion:
            return time, time
        return time, mean_square(left_out_residual(columns, residual, learn, self.folds.motion), learn)

    def select(self, model, own_pool, pool):
        """Run the selection; ``model`` has all own parameters free; returns `Selection`."""
        keys = model.keys
        given = model.holding(keys)
        stages, rivals = [self.stage(given, self.loop.residual(given.extended))], {}
        self.forward(stages, rivals, own_pool, OWN_GAIN)
        named = {key for cause in stages[-1].model.chosen for key in cause.candidate.stands_for}
        own = self.refit(given.freeing(keys))
        if stages[-1].model.chosen and own.time < (1 - OWN_GAIN) * stages[-1].time or not stages[-1].model.chosen:
            stages.append(self.refit(stages[-1].model.freeing([key for key in keys if key not in named])))
        self.forward(stages, rivals, pool, SMALLEST_GAIN)
        stages.append(self.refit(stages[-1].model))
        stages.append(self.check_backward(stages[-1]))
        return Selection(tuple(stages), rivals, own)

    def refit(self, model):
        """Fit everything anew."""
        return self.stage(*fit(self.loop, model, self.folds.learn))

    def forward(self, stages, rivals, pool, smallest):
        """Add causes from the pool as long as they pay; appends to ``stages``, fills ``rivals``."""
        while len(stages[-1].model.chosen) < LARGEST_COUNT:
            now = stages[-1]
            trials = self.trials(now, pool)
            paying = [trial for trial in trials if self.pays(trial, now, smallest)]
            if not paying:
                return
            best = paying[0]
            rivals[best.last.candidate.id] = self.look_alikes(best, trials, now)
            stages.append(self.stage(best.model, best.residual))
            self.progress(f"{best.last.candidate.id}: {np.sqrt(best.time):.3g} N on time left out")

    def trials(self, now, pool):
        """Stages with one candidate more, the best screened ones fitted; best first by time left out."""
        taken = {cause.candidate.id for cause in now.model.chosen}
        held = {key for cause in now.model.chosen for key in cause.candidate.stands_for}
        screened = []
        for candidate in pool:
            if candidate.id not in taken and not held & set(candidate.stands_for):
                for shape in candidate.starts():
                    more = self.size_columns(now, candidate, shape)
                    screened.append((self.left_out(np.hstack([now.columns, more]), now.residual)[0], candidate, shape))
        screened.sort(key=lambda entry: entry[0])
        trials, seen = [], set()
        for _, candidate, shape in screened:
            if candidate.form not in seen and len(seen) < REFITTED:
                seen.add(candidate.form)
                sizes = [0.2 * fitted.step for fitted in candidate.sizes]
                model = now.model.with_cause(candidate, (*sizes, *shape))
                trials.append(self.stage(*fit(self.loop, model, self.folds.learn, now.columns), now.columns))
        return sorted(trials, key=lambda trial: trial.time)

    def size_columns(self, now, candidate, shape):
        """Derivatives of the residual by the candidate's sizes about zero, shape (rows, sizes)."""
        columns = np.empty((len(now.residual), len(candidate.sizes)))
        for k, fitted in enumerate(candidate.sizes):
            sizes = np.zeros(len(candidate.sizes))
            sizes[k] = fitted.step
            moved = now.model.with_cause(candidate, (*sizes, *shape)).extended
            columns[:, k] = (self.loop.residual(moved) - now.residual) / fitted.step
        return columns

    def pays(self, trial, now, smallest):
        """Whether the trial gains enough on both kinds of left-out parts, with certainty."""
        return (trial.time < (1 - smallest) * now.time and trial.motion < (1 - smallest) * now.motion
                and self.certainty(trial) > CERTAIN)

    def certainty(self, trial):
        """Largest size of the last cause over its standard error."""
        learn = self.folds.learn
        errors = standard_errors(trial.columns[learn], trial.residual[learn], self.block)
        count, sizes = len(trial.last.values), len(trial.last.candidate.sizes)
        first = len(errors) - count
        return float(np.max(np.abs(trial.last.values[:sizes]) / np.maximum(errors[first: first + sizes], 1e-300)))

    def look_alikes(self, best, trials, now):
        """Other effects that gain as much as the best one and nothing on top of it."""
        gain, found = now.time - best.time, []
        for trial in trials:
            candidate = trial.last.candidate
            if candidate.id == best.last.candidate.id or now.time - trial.time < (1 - LOOK_ALIKE) * gain:
                continue
            shape = trial.last.values[len(candidate.sizes):]
            both = np.hstack([best.columns, self.size_columns(best, candidate, shape)])
            if best.time - self.left_out(both, best.residual)[0] < REPLACED * gain:
                found.append(candidate.id)
        return found

    def check_backward(self, last):
        """Take out each cause in turn and fit the rest again; drop those without which nothing is lost."""
        for cause in last.model.chosen[:-1]:
            smallest = OWN_GAIN if cause.candidate.stands_for else SMALLEST_GAIN
            less = self.refit(last.model.without(cause.candidate.id))
            if last.time > (1 - smallest) * less.time or last.motion > (1 - smallest) * less.motion:
                last = self.refit(less.model.freeing(cause.candidate.stands_for)) if cause.candidate.stands_for else less
        return last
