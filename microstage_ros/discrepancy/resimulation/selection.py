"""Which causes a force-driven axis has: forward selection, backward check, look-alikes.

A candidate is first screened with derivatives at the present model (a few re-simulations), the best ones
are fitted in full. It is kept if the mean square of the force falls on time left out and on parts of the
motion left out (see `folds`), by more than `SMALLEST_GAIN`, and if its size is far outside its own
uncertainty. In the end every cause must still pay when it alone is taken out and all else is fitted again.
"""

from dataclasses import dataclass, replace

import numpy as np

from microstage_ros.discrepancy.resimulation.fit import BLOCK_S, fit, jacobian, standard_errors
from microstage_ros.discrepancy.resimulation.folds import left_out_residual, mean_square

SMALLEST_GAIN = 0.02           # of the mean square that is there: causes below it are not worth a name
LARGEST_COUNT = 8              # causes
CERTAIN = 4.0                  # size over standard error; with about 15 candidates a healthy axis passes in < 0.1 %
LOOK_ALIKE = 0.1               # a rival gains all but this share of what the chosen one gains
REFITTED = 3                   # candidates fitted in full at every step


@dataclass(frozen=True)
class Trial:
    """One candidate on top of a model: mean squares on left-out time and motion, fitted model, certainty."""

    model: object
    residual: np.ndarray
    time: float
    motion: float
    certainty: float

    @property
    def chosen(self):
        """The cause that the trial added."""
        return self.model.chosen[-1]


@dataclass(frozen=True)
class Selection:
    """What `select` found: the model with all causes, its residual, steps taken, look-alikes by cause."""

    model: object
    residual: np.ndarray
    columns: np.ndarray
    steps: tuple
    lookalikes: dict
    own: float
    start: float


class Selector:
    """Forward and backward selection over one closed loop."""

    def __init__(self, loop, folds, period, progress=None):
        self.loop, self.folds, self.progress = loop, folds, progress or (lambda text: None)
        self.block = max(int(BLOCK_S / period), 1)

    def left_out(self, columns, residual):
        """Mean squares on time and on motion left out; without repetition both are those of time."""
        learn = self.folds.learn
        time = mean_square(left_out_residual(columns, residual, learn, self.folds.time), learn)
        if not self.folds.motion:
            return time, time
        return time, mean_square(left_out_residual(columns, residual, learn, self.folds.motion), learn)

    def select(self, model, pool):
        """Run the selection; returns `Selection`."""
        given = self.loop.residual(model.extended)
        start = mean_square(given, self.folds.learn)
        model, residual, _ = fit(self.loop, model, self.folds.learn)
        columns = jacobian(self.loop, model, residual)
        now = self.left_out(columns, residual)
        own, steps, lookalikes = now[0], [], {}
        while len(model.chosen) < LARGEST_COUNT:
            trials = self.step(model, residual, columns, pool)
            best = self.best(trials, now)
            if best is None:
                break
            lookalikes[best.chosen.candidate.id] = self.rivals(best, trials, now)
            steps.append((best.chosen.candidate.id, now[0], best.time))
            model, residual, now = best.model, best.residual, (best.time, best.motion)
            columns = jacobian(self.loop, model, residual)
            self.progress(f"{best.chosen.candidate.id}: {np.sqrt(best.time):.3g} N on time left out")
        model, residual, columns, dropped = self.check_backward(model, residual, columns, now)
        steps = tuple(step for step in steps if step[0] not in dropped)
        return Selection(model, residual, columns, steps, lookalikes, own, start)

    def step(self, model, residual, columns, pool):
        """Trials of the best candidates on top of a model, best first (by time left out)."""
        taken = {c.candidate.id for c in model.chosen}
        screened = []
        for candidate in pool:
            if candidate.id in taken:
                continue
            for shape in candidate.starts():
                more = self.size_columns(model, residual, candidate, shape)
                screened.append((self.left_out(np.hstack([columns, more]), residual)[0], candidate, shape))
        screened.sort(key=lambda entry: entry[0])
        trials, seen = [], set()
        for _, candidate, shape in screened:
            if candidate.form not in seen and len(seen) < REFITTED:
                seen.add(candidate.form)
                trials.append(self.trial(model, candidate, shape))
        return sorted(trials, key=lambda trial: trial.time)

    def size_columns(self, model, residual, candidate, shape):
        """Derivatives of the residual by the candidate's sizes about zero, shape (rows, sizes)."""
        columns = np.empty((len(residual), len(candidate.sizes)))
        for k, fitted in enumerate(candidate.sizes):
            sizes = np.zeros(len(candidate.sizes))
            sizes[k] = fitted.step
            moved = model.with_cause(candidate, (*sizes, *shape)).extended
            columns[:, k] = (self.loop.residual(moved) - residual) / fitted.step
        return columns

    def trial(self, model, candidate, shape):
        """Fit the candidate with everything else and judge it on time and motion left out."""
        sizes = [0.2 * fitted.step for fitted in candidate.sizes]
        model, residual, _ = fit(self.loop, model.with_cause(candidate, (*sizes, *shape)), self.folds.learn)
        columns = jacobian(self.loop, model, residual)
        time, motion = self.left_out(columns, residual)
        return Trial(model, residual, time, motion, self.certainty(model, residual, columns, len(candidate.sizes)))

    def certainty(self, model, residual, columns, sizes):
        """Largest size of the last cause over its standard error."""
        learn = self.folds.learn
        errors = standard_errors(columns[learn], residual[learn], self.block)
        last = model.theta[len(model.theta) - len(model.chosen[-1].values):]
        spread = errors[len(errors) - len(last):]
        return float(np.max(np.abs(last[:sizes]) / np.maximum(spread[:sizes], 1e-300)))

    @staticmethod
    def pays(trial, now):
        """Whether the trial gains enough on both kinds of left-out parts, with certainty."""
        return (trial.time < (1 - SMALLEST_GAIN) * now[0] and trial.motion < (1 - SMALLEST_GAIN) * now[1]
                and trial.certainty > CERTAIN)

    def best(self, trials, now):
        """The trial that gains most on time left out among those that pay; None if none does."""
        paying = [trial for trial in trials if self.pays(trial, now)]
        return min(paying, key=lambda trial: trial.time) if paying else None

    @staticmethod
    def rivals(best, trials, now):
        """Other effects whose gain is within `LOOK_ALIKE` of the best one's: [(id, gain share)]."""
        gain = now[0] - best.time
        found = {}
        for trial in trials:
            name = trial.chosen.candidate.id
            if name != best.chosen.candidate.id and now[0] - trial.time > (1 - LOOK_ALIKE) * gain:
                found[name] = trial
        return found

    def check_backward(self, model, residual, columns, now):
        """Take out each cause in turn, refit the rest; drop those that no longer pay."""
        dropped = []
        for cause in model.chosen[:-1]:
            less, less_residual, _ = fit(self.loop, model.without(cause.candidate.id), self.folds.learn)
            less_columns = jacobian(self.loop, less, less_residual)
            time, motion = self.left_out(less_columns, less_residual)
            if now[0] > (1 - SMALLEST_GAIN) * time or now[1] > (1 - SMALLEST_GAIN) * motion:
                model, residual, columns, now = less, less_residual, less_columns, (time, motion)
                dropped.append(cause.candidate.id)
        return model, residual, columns, dropped


def replace_values(axis, model):
    """The axis with the model's own parameters, no causes: what mere re-identification gives."""
    return replace(model, axis=axis, chosen=()).extended
