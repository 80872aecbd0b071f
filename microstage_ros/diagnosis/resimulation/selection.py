"""Which causes a force-driven axis has: forward selection, look-alikes, backward check.

A candidate is first screened with derivatives at the present model (a few re-simulations), the best ones
are fitted. A candidate is kept if the mean square of the force falls on time left out and on parts of the
motion left out (see `folds`) by more than a smallest gain, and if its size is far outside its own
uncertainty. In the end every cause must still pay when it alone is taken out and all else is fitted again;
that difference is also what the cause is credited with. Fewer causes that leave no more are preferred (`fewer`).

The axis's own numbers (mass, friction, offset) come first, with a larger smallest gain: they are named as a
change only if that alone explains much; else they are fitted along with the causes, as re-identification.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher

from microstage_ros.diagnosis.resimulation import fewer
from microstage_ros.diagnosis.resimulation.closed_loop import turning_effects
from microstage_ros.diagnosis.resimulation.fit import BLOCK_S, Model, fit, jacobian, solve, standard_errors
from microstage_ros.diagnosis.resimulation.folds import left_out_residual, mean_square
from microstage_ros.diagnosis.selection.stepwise import forward

SMALLEST_GAIN = 0.02           # of the mean square that is there: causes below it are not worth a name
SMALLEST_SHARE = 0.01          # of what stood out of the noise when the selection began: the same, seen from there
OWN_GAIN = 0.10                # smallest gain of a change of the axis's own numbers,
OWN_CHANGE = 0.05              # and smallest change: a file's numbers may be a little off
LARGEST_COUNT = 8              # causes
CERTAIN = 4.0                  # size over standard error; with about 15 candidates a healthy axis passes in < 0.1 %
# the same of a cause below `SMALLEST_SHARE`, which may be what a larger one misfits. Calibrated by:
# `resimulation.examination --kind two --seed 3113` (24 piezos, 20 steppers): of 13 such causes the two wrong ones had
# 14 and 15, two right ones 10 and 18
CERTAIN_IF_FAINT = 20.0
LOOK_ALIKE = 0.15              # rivals differ in gain by less than this share of it
REPLACED = 0.3                 # and gain less than this share of it on top of the chosen one
RULED_OUT = 1.0e-3             # chance that an effect which explains the records as well is ruled out as a rival
REFITTED = 3                   # candidates fitted at every step


@dataclass(frozen=True)
class Stage:
    """A fitted model with its residual, derivatives and mean squares on left-out time and motion."""

    model: Model
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

    ``given``, ``own``, ``final``: `Stage` of the axis as given, with its own numbers fitted, with all causes.
    ``without``: {id: `Stage` without this cause, all else fitted again}. ``rivals``: {id: [ids that the records
    cannot tell from it]}. ``shares``: {id: share of what is held back [1]}. ``errors``: standard errors of all numbers
    of ``final``, shape (parameters,), in the unit of each.
    """

    given: Stage
    own: Stage
    final: Stage
    without: dict
    rivals: dict
    shares: dict
    errors: np.ndarray


@dataclass(frozen=True)
class _Forward:
    """One pool of candidates of a `Selector` as a `stepwise.ResidualModel`; its state is the last `Stage`."""

    selector: "Selector"
    rivals: dict
    pool: list
    smallest: float

    def count(self, now):
        """Causes so far."""
        return len(now.model.chosen)

    def trials(self, now):
        """See `Selector.trials`."""
        return self.selector.trials(now, self.pool)

    def first_standing(self, trials, now):
        """The best trial that pays."""
        return next((trial for trial in trials if self.selector.pays(trial, now, self.smallest)), None)

    def extended(self, now, winner, trials):
        """The winner's stage, its look-alikes noted; what repeats with the turn is found anew where there are several
        records."""
        own, name = self.selector, winner.last.candidate.id
        self.rivals[name] = own.look_alikes(winner, trials, now)
        homes = len(own.loop.parts) > 1 and turning_effects(winner.model.extended)
        after = own.refit(winner.model) if homes else own.stage(winner.model, winner.residual)
        own.progress(f"{name}: {np.sqrt(winner.time):.3g} on time left out")
        return after


class Selector:
    """Forward and backward selection over one closed loop; ``given``: `Stage` of the axis as given, of `select`."""

    given: Stage

    def __init__(self, loop, folds, period, noise, progress=None):
        self.loop, self.folds, self.noise, self.progress = loop, folds, noise, progress or (lambda text: None)
        self.drawn = None if noise.drawn is None else noise.drawn[:, folds.learn]
        self.excess = 0.0      # mean square above the noise where a forward selection begins
        self.block = max(int(BLOCK_S / period), 1)

    def stage(self, model, residual, known=None):
        """Judge a fitted model on left-out time and motion (one of them where the motion has no repetition)."""
        columns = jacobian(self.loop, model, residual, known)
        time, motion = self.left_out(columns, residual)
        return Stage(model, residual, columns, time, motion)

    def left_out(self, columns, residual):
        """Mean squares on time and on motion left out, by ``columns`` (rows, p)."""
        learn = self.folds.learn
        time = mean_square(left_out_residual(columns, residual, learn, self.folds.time), learn)
        if not self.folds.motion:
            return time, time
        return time, mean_square(left_out_residual(columns, residual, learn, self.folds.motion), learn)

    def select(self, model, own_pool, pool, joint=()):
        """Run the selection, with the candidates of ``own_pool`` and ``pool``, `Candidate` each, and with those of
        ``joint`` only in the place of others (`fewer`); ``model`` has all own parameters free; returns `Selection`."""
        keys = model.keys
        nominal = model.holding(keys)
        given = self.stage(nominal, self.loop.residual(nominal.extended))
        self.excess = max(given.time - self.noise.floor**2, 0.0)
        self.given = given
        own = self.refit(model)
        if given.time <= self.noise.seen**2:
            return Selection(given, own, given, {}, {}, {}, self.errors(given))
        rivals = {}
        last = self.forward(given, rivals, own_pool, OWN_GAIN)
        named = {key for cause in last.model.chosen for key in cause.candidate.stands_for}
        last = self.refit(last.model.freeing([key for key in keys if key not in named]))
        self.excess = max(last.time - self.noise.floor**2, 0.0)
        last = self.refit(self.forward(last, rivals, pool, SMALLEST_GAIN).model)
        last, without = self.check_backward(self.without_own(last, rivals, pool))
        last, without = fewer.fewest(self, last, without, rivals, [*own_pool, *pool, *joint], SMALLEST_GAIN)
        for cause in last.model.chosen:
            name = cause.candidate.id
            if not self.noise.seen:
                rivals[name] = self.alike_still(cause.candidate, last, without, rivals, [*own_pool, *pool])
            rivals[name] = self.exchanged(cause.candidate, last, without, rivals, own_pool)
        return Selection(given, own, last, without, rivals, self.shares(last, without), self.errors(last))

    def without_own(self, last, rivals, pool):
        """The `Stage` in which the axis's own numbers are fitted along and named no more, with another cause of the
        ``pool`` in their place, if it leaves less than the ``last`` `Stage`; else that one. A film of grease is not a
        viscosity and a level that both differ.

        ``rivals`` {id: ids}: those of the new causes are noted. ``pool``: of `Candidate`.
        """
        own = [cause.candidate for cause in last.model.chosen if cause.candidate.stands_for]
        if not own:
            return last
        model = last.model
        for candidate in own:
            model = model.without(candidate.id).freeing(candidate.stands_for)
        found: dict = {}
        other = self.refit(self.forward(self.refit(model), found, pool, SMALLEST_GAIN).model)
        before, after = ({cause.candidate.id for cause in stage.model.chosen} for stage in (last, other))
        if after <= before or len(after) > len(before) or other.time >= last.time:
            return last
        rivals.update(found)
        return other

    def alike_still(self, candidate, last, without, rivals, forms):
        """Ids of the rivals of a cause of the ``last`` `Stage` that gain as much in its place beside the other causes,
        too, with all else fitted again. They were found beside those before it: what a delay leaves makes a gain and a
        hysteresis alike.

        ``candidate``: the cause's `Candidate`. ``without`` {id: `Stage`}, ``rivals`` {id: ids}: of `Selection`.
        ``forms``: `Candidate` of all rivals.
        """
        name, found = candidate.id, []
        base, taken = without[name], {cause.candidate.id for cause in last.model.chosen}
        enough = base.time - (1 - LOOK_ALIKE) * (base.time - last.time)
        for other in forms:
            if other.id in rivals.get(name, ()) and other.id not in found and other.id not in taken:
                begun = (self.initial_model(base, other, shape) for shape in other.starts())
                if min(self.refit(model).time for model in begun) <= min(enough, self.most_alike(last)):
                    found.append(other.id)
        return found

    def most_alike(self, best):
        """Mean square up to which another effect may explain as much as the ``best`` `Stage` does.

        Where that leaves nothing but noise, what equal variances allow: Fisher's F of the two, every block of
        `fit.BLOCK_S` counted as one degree of freedom.
        """
        blocks = max(int(np.sum(self.folds.learn)) // self.block, 1)
        return best.time * fisher.isf(RULED_OUT, blocks, blocks) if best.time <= self.noise.limit**2 else np.inf

    def exchanged(self, candidate, last, without, rivals, own_pool):
        """Ids of the rivals of a cause of the ``last`` `Stage`: those that it had, and such as stand for the same
        number of the axis and gain as much in its place, with all else fitted again.

        ``candidate``: the cause's `Candidate`. ``without`` {id: `Stage`} and ``rivals`` {id: ids}: of `Selection`.
        ``own_pool``: of `Candidate`.
        """
        found, worse = list(rivals.get(candidate.id, ())), without[candidate.id].time
        taken = {cause.candidate.id for cause in last.model.chosen}
        for other in own_pool:
            if other.id in taken or other.id in found or not set(other.stands_for) & set(candidate.stands_for):
                continue
            sizes = [0.2 * fitted.step for fitted in other.sizes]
            trial = self.refit(last.model.without(candidate.id).with_cause(other, tuple(sizes)))
            if worse - trial.time >= (1 - LOOK_ALIKE) * (worse - last.time):
                found.append(other.id)
        return found

    def refit(self, model):
        """Fit everything anew; what repeats with the turn is found anew in every record but the first."""
        model, residual = fit(self.loop, model, self.folds.learn)
        if len(self.loop.parts) > 1 and turning_effects(model.extended):
            self.loop.home(model.extended)
            model, residual = fit(self.loop, model, self.folds.learn)
        return self.stage(model, residual)

    def forward(self, now, rivals, pool, smallest):
        """Add causes from the pool as long as each pays at least ``smallest`` [1]; fills ``rivals``, returns the last
        `Stage`."""
        return forward(_Forward(self, rivals, pool, smallest), now, LARGEST_COUNT)[0]

    def trials(self, now, pool):
        """Stages with one candidate more, the best screened ones fitted; best first by time left out.

        A candidate of another form than the cause of the same name takes its place.
        """
        bases, screened = {None: now}, []
        for candidate in pool:
            taken = next((c for c in now.model.chosen if c.candidate.id == candidate.id), None)
            if taken is not None and (taken.candidate.form == candidate.form or candidate.stands_for):
                continue
            name = None if taken is None else candidate.id
            if taken is not None and name not in bases:
                freed = taken.candidate.stands_for
                bases[name] = self.refit(now.model.without(name).freeing(freed)) if freed else self.without(now, name)
            base = bases[name]
            if not self.holds(base, candidate):
                for shape in candidate.starts():
                    columns = np.hstack([base.columns, self.size_columns(base, candidate, shape)])
                    screened.append((self.left_out(columns, base.residual)[0], candidate, shape, base))
        screened.sort(key=lambda entry: entry[0])
        trials, seen = [], set()
        for _, candidate, shape, base in screened:
            if candidate.form not in seen and len(seen) < REFITTED:
                seen.add(candidate.form)
                begin = self.initial_model(base, candidate, shape)
                model, residual = fit(self.loop, begin, self.folds.learn, base.columns)
                trials.append(self.stage(model, residual, base.columns))
        return sorted(trials, key=lambda trial: trial.time)

    @staticmethod
    def holds(stage, candidate):
        """Whether a cause already stands for the own parameter that the candidate would change."""
        return any(set(cause.candidate.stands_for) & set(candidate.stands_for) for cause in stage.model.chosen)

    def size_columns(self, now, candidate, shape):
        """Derivatives of the residual by the candidate's sizes about zero, shape (rows, sizes)."""
        steps = np.array([fitted.step for fitted in candidate.sizes])
        moved = [now.model.with_cause(candidate, (*sizes, *shape)).extended for sizes in np.diag(steps)]
        return (np.column_stack(self.loop.residuals(moved)) - now.residual[:, None]) / steps

    def initial_model(self, base, candidate, shape):
        """The ``base`` `Stage`'s `Model` with a `Candidate` more of this ``shape``, (shapes,), where its fit begins: at
        the linear fit of its sizes, or near none of it where that leaves more. Far from its size a shape runs away."""
        near = base.model.with_cause(candidate, (*(0.2 * fitted.step for fitted in candidate.sizes), *shape))
        if not candidate.shapes:
            return near
        learn = self.folds.learn
        columns = np.hstack([base.columns, self.size_columns(base, candidate, shape)])
        before = np.append(base.model.theta, np.zeros(len(candidate.sizes)))
        moved = before + solve(columns[learn], -base.residual[learn])
        _, low, high = near.steps_and_bounds()
        fitted = near.at(np.clip(np.append(moved, shape), low, high))
        left = [mean_square(one, learn) for one in self.loop.residuals([near.extended, fitted.extended])]
        return fitted if left[1] < left[0] else near

    def pays(self, trial, now, smallest):
        """Whether the trial gains enough, ``smallest`` [1], on both kinds of left-out parts, with certainty."""
        own = trial.last.candidate.stands_for and abs(trial.last.relative) < OWN_CHANGE
        return not own and self.is_certain(trial, trial.last, now) and self.gains(trial, now, smallest)

    def is_certain(self, better, cause, worse):
        """Whether a `Chosen` ``cause`` of ``better`` is certain, the more so where ``worse`` leaves hardly more than
        that without it, `Stage` each."""
        faint = worse.time - better.time <= SMALLEST_SHARE * self.excess
        return self.certainty(better, cause) > (CERTAIN_IF_FAINT if faint else CERTAIN)

    def gains(self, better, worse, smallest):
        """Whether the mean square falls enough from ``worse`` to ``better``, `Stage` each, by a share ``smallest``
        [1], on time and on motion left out."""
        enough = SMALLEST_SHARE * self.excess if self.noise.seen else 0.0
        return (worse.time - better.time > max(smallest * worse.time, enough)
                and worse.motion - better.motion > smallest * worse.motion)

    def errors(self, stage):
        """Standard errors of all numbers of a `Stage`, shape (parameters,)."""
        learn = self.folds.learn
        return standard_errors(stage.columns[learn], stage.residual[learn], self.block, self.drawn)

    def certainty(self, stage, cause):
        """Largest size of a `Chosen` ``cause`` of the ``stage``, a `Stage`, over its standard error with its shape held
        [1]: whether there is such an effect, not how large it is by what power of the speed."""
        learn, first, sizes = self.folds.learn, stage.model.place(cause.candidate.id), len(cause.candidate.sizes)
        shapes = np.arange(first + sizes, first + len(cause.values))
        columns = np.delete(stage.columns[learn], shapes, axis=1)
        errors = standard_errors(columns, stage.residual[learn], self.block, self.drawn)
        return float(np.max(np.abs(cause.values[:sizes]) / np.maximum(errors[first: first + sizes], 1e-300)))

    def look_alikes(self, best, trials, now):
        """Ids of other effects, of ``trials``, that gain as much on ``now`` as the ``best`` `Stage` and nothing on top
        of it; the mean squares are in the square of the residual's unit."""
        gain, found, most = now.time - best.time, [], self.most_alike(best)
        for trial in trials:
            candidate = trial.last.candidate
            if (
                candidate.id == best.last.candidate.id
                or now.time - trial.time < (1 - LOOK_ALIKE) * gain
                or trial.time > most
            ):
                continue
            shape = trial.last.values[len(candidate.sizes):]
            both = np.hstack([best.columns, self.size_columns(best, candidate, shape)])
            if best.time - self.left_out(both, best.residual)[0] < REPLACED * gain:
                found.append(candidate.id)
        return found

    def check_backward(self, last):
        """Take out each cause in turn and fit the rest again; drop those without which nothing is lost, neither
        on what was left out nor on what was held back, and those that are no longer certain beside the others.

        Returns the last `Stage` and {id: `Stage` without it} of the causes that stay.
        """
        without = {}
        for cause in last.model.chosen:
            name, own = cause.candidate.id, cause.candidate.stands_for
            less = self.without(last, name)
            pays = self.gains(last, less, OWN_GAIN if own else SMALLEST_GAIN) and self.gains_held(last, less)
            if not pays or not self.is_certain(last, cause, less) or self.at_the_floor(less):
                self.progress(f"{name}: not needed")
                return self.check_backward(self.refit(less.model.freeing(own)))
            without[name] = less
        return last, without

    def gains_held(self, better, worse):
        """Whether ``better`` leaves less of what was held back than ``worse``, `Stage` each, by `SMALLEST_GAIN`, and
        less than the axis as given."""
        after, before, given = (mean_square(one.residual, self.folds.held) for one in (better, worse, self.given))
        return min(before, given) - after > SMALLEST_GAIN * before

    def at_the_floor(self, stage):
        """Whether a `Stage` leaves nothing to explain, neither on time left out nor on what was held back."""
        most = self.noise.seen**2
        return stage.time <= most and mean_square(stage.residual, self.folds.held) <= most

    def shares(self, last, without):
        """{id: share [1]} of the causes of the ``last`` `Stage` on what was held back; ``without``: {id: `Stage`}.

        The fall of the mean square from the axis as given to all causes, over what stood out of the noise, is
        dealt out in proportion to what each cause alone saves when all the others are there.
        """
        held = self.folds.held
        final, given = (mean_square(stage.residual, held) for stage in (last, self.given))
        saved = {name: max(mean_square(stage.residual, held) - final, 0.0) for name, stage in without.items()}
        removed = min(max(given - final, 0.0) / max(given - self.noise.floor**2, 1e-300), 1.0)
        total = max(sum(saved.values()), 1e-300)
        return {name: removed * one / total for name, one in saved.items()}

    def without(self, last, name):
        """`Stage` of the ``last`` one's model, a `Stage`, without one cause, the rest fitted again with the
        derivatives at hand."""
        first = last.model.place(name)
        count = next(len(cause.values) for cause in last.model.chosen if cause.candidate.id == name)
        columns = np.delete(last.columns, slice(first, first + count), axis=1)
        model, residual = fit(self.loop, last.model.without(name), self.folds.learn, columns)
        return self.stage(model, residual, columns)
