"""Fitting the axis's own parameters and its causes together, to the force of a closed-loop re-simulation.

Gauss-Newton with step halving on residuals r(θ) = measured − simulated force; the derivatives are finite
differences of whole re-simulations, so they hold the closed loop. Standard errors are from the sandwich
(JᵀJ)⁻¹ (Σ_b g_b g_bᵀ) (JᵀJ)⁻¹ with g_b = Σ J r over block b: the residual is anything but white.
"""

from dataclasses import dataclass, replace

import numpy as np

from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.axis_file import Axis
from microstage_ros.model.effects.resimulated import Candidate
from microstage_ros.quantities.errors import InputError

OWN = (
    ("stage.mass", 0.005), ("contacts.guideway.viscous", 0.02), ("contacts.guideway.coulomb", 0.02),
    ("contacts.guideway.static", 0.02), ("contacts.actuator.viscous", 0.02), ("contacts.actuator.coulomb", 0.02),
    ("contacts.actuator.static", 0.02),
)
"""The axis's own parameters that are re-identified, with the relative step of their derivatives."""
OFFSET = "stage.offset_force"
BLOCK_S = 0.5                  # blocks of the sandwich and of the bootstrap [s]
ITERATIONS = 8
ENOUGH = 5e-4                  # relative fall of the sum of squares at which the fit ends


@dataclass(frozen=True)
class Chosen:
    """A candidate with the values of its sizes and shapes."""

    candidate: Candidate
    values: tuple

    @property
    def effect(self):
        """Its section in an axis file."""
        return self.candidate.effect(self.values)

    @property
    def relative(self):
        """Size over the number of the axis that it changes; of no meaning for other candidates."""
        return self.values[0] / self.candidate.of if self.candidate.of else float("inf")


@dataclass(frozen=True)
class Model:
    """An axis, its own parameters that are free, and the causes chosen so far."""

    axis: Axis
    keys: tuple
    own: tuple
    chosen: tuple = ()

    @classmethod
    def of(cls, axis):
        """The axis as given, every parameter of `OWN` that it has and the offset free; none where the command sets a
        position."""
        keys = (
            []
            if actuator_of(axis).holds_position
            else [key for key, _ in OWN if axis.has(key) and axis.value(key) > 0.0] + [OFFSET]
        )
        return cls(axis, tuple(keys), tuple(axis.value(key) for key in keys))

    @property
    def theta(self):
        """All free numbers, shape (parameters,): the axis's own, then each cause's."""
        return np.array([*self.own, *(value for c in self.chosen for value in c.values)], float)

    def at(self, theta):
        """The same model with other numbers ``theta``, shape (parameters,)."""
        own, rest, chosen = tuple(float(t) for t in theta[: len(self.keys)]), list(theta[len(self.keys):]), []
        for c in self.chosen:
            count = len(c.values)
            chosen.append(Chosen(c.candidate, tuple(float(t) for t in rest[:count])))
            rest = rest[count:]
        return replace(self, own=own, chosen=tuple(chosen))

    def with_cause(self, candidate, values):
        """The same model with one more cause, whose sizes are ``values``, shape (sizes,)."""
        return replace(self, chosen=(*self.chosen, Chosen(candidate, tuple(float(v) for v in values))))

    def without(self, name):
        """The same model without the cause of this id."""
        return replace(self, chosen=tuple(c for c in self.chosen if c.candidate.id != name))

    def place(self, name):
        """Where in `theta` the numbers of the cause of this id begin [1]. Raises KeyError: there is no such cause."""
        at = len(self.keys)
        for cause in self.chosen:
            if cause.candidate.id == name:
                return at
            at += len(cause.values)
        raise KeyError(name)

    def holding(self, keys):
        """The same model with these of the axis's own parameters held as the file gives them."""
        free = [(key, value) for key, value in zip(self.keys, self.own) if key not in keys]
        return replace(self, keys=tuple(key for key, _ in free), own=tuple(value for _, value in free))

    def freeing(self, keys):
        """The same model with these of the axis's own parameters free (again)."""
        return replace(self, keys=(*self.keys, *keys), own=(*self.own, *(self.axis.value(key) for key in keys)))

    @property
    def extended(self):
        """The `Axis` that simulates this model."""
        effects = {**self.axis.effects, **{c.candidate.id: c.effect for c in self.chosen}}
        return self.axis.with_values(dict(zip(self.keys, self.own))).with_effects(effects)

    def steps_and_bounds(self):
        """Steps of the derivatives and bounds of every free number, three arrays."""
        relative = dict(OWN)
        scale = max(
            self.axis.value(key) for key, _ in OWN if self.axis.has(key) and key.endswith(("coulomb", "static", "mass"))
        )
        steps, low, high = [], [], []
        for key, value in zip(self.keys, self.own):
            steps.append(0.02 * scale if key == OFFSET else relative[key] * value)
            low.append(-np.inf if key == OFFSET else 1e-3 * value)
            high.append(np.inf)
        for fitted in (f for c in self.chosen for f in c.candidate.fitted):
            steps.append(fitted.step)
            low.append(fitted.low)
            high.append(fitted.high)
        return np.array(steps), np.array(low), np.array(high)


def jacobian(loop, model, base, known=None):
    """d(residual)/dθ by forward differences, shape (rows, parameters); ``base`` is the residual at the model.

    ``known``: derivatives by the first parameters that may stand in for new ones, shape (rows, fewer).
    """
    theta = model.theta
    steps, _, high = model.steps_and_bounds()
    columns = np.empty((len(base), len(theta)))
    first = 0 if known is None else known.shape[1]
    if first:
        columns[:, :first] = known
    places = range(first, len(theta))
    moves = [0.3 * (-steps[k] if theta[k] + steps[k] > high[k] else steps[k]) for k in places]
    moved = [model.at(theta + move * (np.arange(len(theta)) == k)).extended for k, move in zip(places, moves)]
    for k, move, residual in zip(places, moves, loop.residuals(moved)):
        columns[:, k] = (residual - base) / move
    return columns


def fit(loop, model, rows, known=None, iterations=ITERATIONS):
    """Least squares over ``rows`` (boolean mask over all rows of the loop).

    ``iterations``: at most so many [1]. ``known``: see `jacobian`; these derivatives are not renewed (a chord method).
    Returns the model and its residual over all rows.
    """
    _, low, high = model.steps_and_bounds()
    residual = loop.residual(model.extended)
    for _ in range(iterations):
        better = _step(loop, model, jacobian(loop, model, residual, known), residual, rows, low, high)
        if better is None:
            break
        before, (model, residual) = float(np.sum(residual[rows] ** 2)), better
        if before - float(np.sum(residual[rows] ** 2)) < ENOUGH * before:
            break
    return model, residual


def _step(loop, model, columns, residual, rows, low, high):
    """One Gauss-Newton step, shortened until the sum of squares falls; None if it does not."""
    theta, before = model.theta, float(np.sum(residual[rows] ** 2))
    move = solve(columns[rows], -residual[rows])
    for _ in range(4):
        moved = model.at(np.clip(theta + move, low, high))
        try:
            extended = moved.extended
        except InputError:  # beyond what an effect can be
            move = 0.3 * move
            continue
        after = loop.residual(extended)
        if float(np.sum(after[rows] ** 2)) < before:
            return moved, after
        move = 0.3 * move
    return None


def solve(columns, target):
    """Least squares of ``target`` (rows,) by ``columns`` (rows, p) scaled to unit size; a column of zeros gets a
    zero."""
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    return np.linalg.lstsq(columns / scale, target, rcond=1e-9)[0] / scale


def standard_errors(columns, residual, block, drawn=None):
    """Standard errors of θ, shape (parameters,): those of the sandwich, or what noise makes of θ, if that is more.

    ``columns`` of shape (rows, p). ``block``: rows per block [1]. ``drawn``: residuals that noise alone makes, shape
    (draws, rows): θ is fitted to each of them. Few blocks hold less than the scatter of noise that outlasts them.
    """
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    scaled = columns / scale
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-9)
    scores = np.add.reduceat(scaled * residual[:, None], np.arange(0, len(residual), block), axis=0)
    covariance = inverse @ (scores.T @ scores) @ inverse
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if drawn is not None:
        by_noise = inverse @ (scaled.T @ drawn.T)
        errors = np.maximum(errors, np.sqrt(np.mean(by_noise**2, axis=1)))
    return errors / scale
