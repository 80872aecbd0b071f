"""What a candidate is: one way (form) in which an effect would show in one residual channel."""

import dataclasses
from collections.abc import Callable

import numpy as np


@dataclasses.dataclass(frozen=True)
class Frame:
    """What all records of one diagnosis share.

    ``low`` and ``high`` bound the positions that the records visit [m]; ``duration`` is the longest record [s].
    ``rattled_mass``: mass added to the stage [kg] that the drive train's stiffness stands for if it is as stated, where
    a rattle told stiffness over mass; 0 where none did.
    """

    drive: object
    low: float
    high: float
    duration: float
    rattled_mass: float = 0.0


@dataclasses.dataclass(frozen=True)
class Form:
    """One effect in one channel.

    Attributes
    ----------
    effect : id of `model.effects`, or ``"generic:…"`` for a shape without a name, which only competes.
    channel : name of the residual channel.
    variant : tells forms of one effect in one channel apart (a fixed non-linear parameter).
    columns : ``columns(channel, frame)`` → (rows, k): the residual is ``columns @ sizes``.
    sizes : ``sizes(beta, covariance, frame)`` → (parameters {name: (value, stderr, unit)}, effect {name: value}).
    accept : ``accept(beta)``: whether the fitted sizes make sense (a width is positive); None: always.
    prior : standard deviation that sizes are expected to have, or None.
    beyond : ``beyond(beta, frame)``: whether the sizes exceed what the axis's own instruments leave; None: always.
    about : ``about(beta)``: the same form where the columns depend on the sizes, exact at ``beta``; None: they do not.
    """

    effect: str
    channel: str
    variant: str
    columns: Callable
    sizes: Callable | None = None
    accept: Callable | None = None
    prior: float | None = None
    beyond: Callable | None = None
    about: Callable | None = None

    def possible(self, beta, frame):
        """Whether fitted sizes ``beta`` (k,) make sense on this axis: `accept` and `beyond`."""
        return (self.accept is None or self.accept(beta)) and (self.beyond is None or self.beyond(beta, frame))

    @property
    def key(self):
        """(effect, variant), unique in its channel."""
        return self.effect, self.variant

    @property
    def named(self):
        """Whether this is an effect of the catalogue."""
        return not self.effect.startswith("generic:")


def one(name, unit, value=lambda beta: beta, slope=lambda beta: 1.0, extra=None):
    """Sizes of a form with one column: value(β) with stderr |slope(β)| σ_β.

    ``value``: function of the coefficient β, in ``unit``; ``slope``: its derivative, in ``unit`` per unit of β.
    ``extra``: further parameters of the effect {name: number, SI}.
    """
    def sizes(beta, covariance, frame):
        size = float(value(beta[0]))
        stderr = float(abs(slope(beta[0])) * np.sqrt(covariance[0, 0]))
        return {name: (size, stderr, unit)}, {name: size, **(extra or {})}
    return sizes


def wave(beta, covariance):
    """Amplitude and phase of β₀ sin + β₁ cos, with standard errors: (a, σ_a, φ, σ_φ), φ in [rad].

    ``beta`` (2,) in the unit of a, ``covariance`` (2, 2) in its square. Derived: propagation to first order (GUM 5.2).
    """
    s, c = beta
    amplitude = float(np.hypot(s, c))
    along = np.array([s, c]) / max(amplitude, 1e-300)
    across = np.array([-c, s]) / max(amplitude, 1e-300)
    sigma = float(np.sqrt(along @ covariance @ along))
    return amplitude, sigma, float(np.arctan2(c, s)), float(np.sqrt(across @ covariance @ across)
                                                            / max(amplitude, 1e-300))
