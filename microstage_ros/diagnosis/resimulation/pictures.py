"""Where the force parts from the measurement: on which coordinate, how surely, and the curves that show it."""

import numpy as np

from microstage_ros.model.effects import REGISTRY
from microstage_ros.diagnosis.result import Finding, Picture

BINS = 24
CURVE_BINS = 60
SHOWS = tuple((effect.shows_against, name) for name, effect in REGISTRY.items() if effect.drives or effect.sensors)
SHIFTS = 60                    # circular shifts that set a coordinate's threshold
SHOWN = 600                    # points of a curve
FREQUENCY = "reference frequency"
# s in which the reference has one frequency; derived: a cycle of 2 Hz, below which a loop follows as it stands still
WINDOW_S = 0.5
SEEN_SPEED = 0.02              # share of the top speed below which a direction is not reported


def coordinates(parts, axis, rows):
    """What a residual may depend on: {name: (values of shape (rows,), axis label)}."""
    period = axis.value("period")
    position = np.concatenate([part.position for part in parts])
    width = max(int(0.01 / period), 3)
    speed = np.concatenate([_smooth(np.gradient(part.position, period), width) for part in parts])
    acceleration = np.concatenate(
        [_smooth(np.gradient(_smooth(np.gradient(part.position, period), width), period), width) for part in parts])
    turn = position / axis.value("transmission.pitch")
    found = {
        "velocity": (speed, "velocity [m/s]"),
        "position": (position, "position [m]"),
        "acceleration": (acceleration, "acceleration [m/s²]"),
        "direction": (np.sign(speed) * (np.abs(speed) > SEEN_SPEED * np.abs(speed).max()), "direction of motion"),
        "screw turn": (turn - np.floor(turn), "screw turn [turns]"),
        "time": (np.concatenate([part.time for part in parts]), "time [s]"),
    }
    frequency = np.concatenate([_frequency(part.reference, period) for part in parts])
    if np.ptp(frequency[rows]) > 0.0:
        found[FREQUENCY] = (frequency, "frequency of the reference [Hz]")
    return {name: (values[rows], label) for name, (values, label) in found.items()}


def _frequency(reference, period):
    """Frequency [Hz] of the reference about every row: of a sine, √(Σ a²/Σ v²)/2π over `WINDOW_S`; 0 where it rests."""
    width = max(int(WINDOW_S / period), 3)
    speed = np.gradient(reference, period)
    power = _smooth(speed**2, width)
    faint = 1e-9 * float(power.max())      # derived: rounding of the running sum
    ratio = np.maximum(_smooth(np.gradient(speed, period) ** 2, width), 0.0) / np.maximum(power, 1e-300)
    return np.where(power > faint, np.sqrt(ratio) / (2.0 * np.pi), 0.0)


def _smooth(values, width):
    return np.convolve(values, np.ones(width) / width, "same")


def findings(coordinates, before, after, seed, quantity="force"):
    """`Finding` for every coordinate: share of the residual's variance that its bins carry.

    The threshold is the largest share over circular shifts of the residual against the coordinate, by a tenth of the
    rows and more either way, so it holds for a residual that is correlated in time. Of the reference's frequency it is
    the variance of the residual's square, as a loop that follows late leaves more the faster it goes and no mean.
    ``before``, ``after``: the residuals, shape (rows,); ``seed``: of the shifts [1].
    """
    generator = np.random.default_rng(seed)
    found = []
    for name, (values, _) in coordinates.items():
        bins, first, last = _bins(values), before, after
        if name == FREQUENCY:
            first, last = before**2, after**2
        shifts = generator.integers(len(values) // 10, len(values) - len(values) // 10, SHIFTS)
        threshold = max(_share(bins, np.roll(first, shift)) for shift in shifts)
        left = _share(bins, last) * min(float(np.var(last) / np.var(first)), 1.0)
        found.append(Finding(quantity, name, _share(bins, first), threshold, left))
    return tuple(sorted(found, key=lambda finding: finding.threshold / max(finding.statistic, 1e-12)))


def _bins(values):
    edges = np.quantile(values, np.linspace(0.0, 1.0, BINS + 1)[1:-1])
    return np.searchsorted(np.unique(edges), values, side="right")


def _share(bins, residual):
    count = np.bincount(bins)
    mean = np.bincount(bins, residual) / np.maximum(count, 1)
    return float(np.sum(count * (mean - residual.mean()) ** 2) / max(np.sum((residual - residual.mean()) ** 2), 1e-300))


def pictures(coordinates, before, after, causes, period_rows, judged=("force", "N")):
    """Pictures of the residual before and after, the most telling first; ``judged``: its quantity and unit.

    ``before``, ``after``: shape (rows,); ``period_rows``: rows of a repetition [1].
    """
    quantity, unit = judged[0].capitalize(), judged[1]
    shown = [_over_time(coordinates["time"][0], before, after, period_rows, quantity, unit)]
    for name, cause in (("velocity", "direction_asymmetry"), ("velocity", "nonlinear_viscous"),
                        ("position", "position_dependent_friction"), ("position", "cable_spring"),
                        ("screw turn", "torque_ripple"), ("acceleration", "actuator_lag"), *SHOWS):
        if cause in causes and f"{quantity} over {name}" not in [picture.title for picture in shown]:
            shown.append(_binned(name, coordinates[name], before, after, cause, quantity, unit))
    if len(shown) == 1:
        shown += [
            _binned(name, coordinates[name], before, after, "", quantity, unit) for name in ("velocity", "position")
        ]
    return tuple(shown)


def _over_time(time, before, after, period_rows, quantity, unit):
    rows = min(period_rows or len(time), len(time))
    block = max(rows // SHOWN, 1)
    rows -= rows % block

    def thin(values):
        return values[:rows].reshape(-1, block).mean(axis=1)

    return Picture("time", f"{quantity} over time, measured minus simulated", "time [s]", f"measured − model [{unit}]",
                   {"axis file": (thin(time), thin(before)), "with the causes": (thin(time), thin(after))})


def _binned(name, coordinate, before, after, cause, quantity, unit):
    """Mean residual in even bins of a coordinate; bins that hold next to nothing are left out."""
    values, label = coordinate
    bins = np.minimum(((values - values.min()) / max(np.ptp(values), 1e-300) * CURVE_BINS).astype(int), CURVE_BINS - 1)
    count = np.bincount(bins, minlength=CURVE_BINS)
    kept = count >= max(len(values) // 5000, 5)
    x = (np.bincount(bins, values, minlength=CURVE_BINS)[kept]) / count[kept]
    curves = {text: (x, np.bincount(bins, residual, minlength=CURVE_BINS)[kept] / count[kept])
              for text, residual in (("axis file", before), ("with the causes", after))}
    return Picture(
        name.replace(" ", "_"), f"{quantity} over {name}", label, f"measured − model [{unit}], mean", curves, cause
    )
