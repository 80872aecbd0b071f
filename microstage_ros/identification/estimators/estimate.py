"""What an identification says of each parameter: a value with its interval, or that it cannot be determined."""

from dataclasses import dataclass, field

import numpy as np

from microstage_ros.quantities.readable import interval, quantity

DETERMINED_HALF_WIDTH = 0.5
"""A parameter counts as determined when the half width of its 95 % interval is below this share of
its value: beyond it not even the first digit stands."""


@dataclass(frozen=True)
class Estimate:
    """One parameter as the records give it.

    Attributes
    ----------
    key : dotted key of the axis file, or a plain name for what no axis file holds.
    value : SI value, a float or a list of floats.
    unit : unit of the value.
    stderr : standard uncertainty, same shape as `value`.
    low, high : 95 % interval, same shape as `value`; an end that the records leave open is infinite.
    determined : False if these records do not tell the parameter; then `remark` says why and which
        experiment would. Of an offset that is determined as too small to matter it says so.
    method : where the interval comes from (bootstrap over repeats, profile likelihood, ...).
    """

    key: str
    value: object
    unit: str
    stderr: object = None
    low: object = None
    high: object = None
    determined: bool = True
    method: str = ""
    remark: str = ""


@dataclass
class Curve:
    """A measured curve with its model, band and residuals, ready to be drawn.

    `x` and `y` are the data (any number of points), `model_x`, `model_y` the fitted curve, `low` and
    `high` its 95 % band on `model_x`, `residual` the data minus the model at the points `x`.
    """

    title: str
    x_label: str
    y_label: str
    x: np.ndarray
    y: np.ndarray
    model_x: np.ndarray | None = None
    model_y: np.ndarray | None = None
    low: np.ndarray | None = None
    high: np.ndarray | None = None
    residual: np.ndarray | None = None


@dataclass
class Identification:
    """All estimates of one run with what a reader needs to judge them.

    `estimates` by key; `correlation` is (names, square matrix) of the scalar estimates that were
    fitted together, one entry per fit; `curves` for the page; `remarks` are plain sentences;
    `tables` are (title, header, rows) of further figures.
    """

    estimates: dict = field(default_factory=dict)
    correlations: list = field(default_factory=list)
    curves: list = field(default_factory=list)
    remarks: list = field(default_factory=list)
    tables: list = field(default_factory=list)

    def add(self, *estimates):
        """Add estimates; one that is determined is never replaced by one that is not."""
        for estimate in estimates:
            known = self.estimates.get(estimate.key)
            if known is None or estimate.determined or not known.determined:
                self.estimates[estimate.key] = estimate

    def merge(self, other):
        """Take over everything of another identification."""
        self.add(*other.estimates.values())
        for name in ("correlations", "curves", "remarks", "tables"):
            getattr(self, name).extend(getattr(other, name))

    def to_axis(self, axis):
        """The axis with every determined estimate it has a key for (source `identified`, stderr)."""
        found = {e.key: e for e in self.estimates.values() if e.determined and axis.has(e.key)}
        values = {key: e.value for key, e in found.items()}
        spread = {key: e.stderr for key, e in found.items() if e.stderr is not None}
        return axis.with_values(values, source="identified", stderr=spread)


SIGNED = ("offset", "constant torque")  # what may be below zero; all else is a size


def narrow(value, low, high, floor=0.0):
    """The rule by which a parameter counts as determined: half width of the 95 % interval against max(|value|, floor).

    Parameters
    ----------
    value, low, high : numbers, or arrays of one shape: of a list every number has to be determined.
    floor : size below which the value does not matter [unit of value].
    """
    half_width = 0.5 * (np.asarray(high, dtype=float) - np.asarray(low, dtype=float))
    return bool(
        np.all(np.isfinite(half_width) & (half_width <= DETERMINED_HALF_WIDTH * np.maximum(np.abs(value), floor)))
    )


def in_short(value, stderr, unit):
    """A number beside the estimates for a sentence: ``10.6 ± 0.4 µN m`` (95 %), or that it is not determined.

    ``value`` and its standard uncertainty ``stderr``: in ``unit``.
    """
    half = 1.96 * float(stderr)
    if narrow(value, value - half, value + half):
        return f"{quantity(float(value), unit, 3, half)} (95 %)"
    return f"not determined (95 %: {interval(value - half, value + half, unit)})"


def from_interval(key, value, stderr, unit, low=None, high=None, method="", experiment="", floor=0.0):
    """An `Estimate` that is determined if `narrow` says so.

    `value`, `stderr`, `low`, `high`, `floor`: in ``unit``.
    `low`, `high` default to value ± 1.96 stderr. `floor` is the size below which a value does not
    matter (an offset of nothing is still a result): the half width is held against max(|value|, floor).
    `experiment` completes the sentence "not determined by these records; ...".
    A size below zero is never determined.
    """
    low = value - 1.96 * stderr if low is None else low
    high = value + 1.96 * stderr if high is None else high
    offset = any(word in key for word in SIGNED)
    determined = narrow(value, low, high, floor) and bool(value > 0.0 or offset)
    remark = "" if determined else f"not determined by these records (95 %: {interval(low, high, unit)}); {experiment}"
    if determined and offset and low <= 0.0 <= high:
        remark = f"indistinguishable from 0 (95 %: {interval(low, high, unit)})"
    return Estimate(key, float(value), unit, float(stderr), float(low), float(high), determined, method, remark)
