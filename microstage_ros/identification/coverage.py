"""Do the 95 % intervals hold the truth? Trials on synthetic experiments, fast enough for a hundred of them.

    python -m microstage_ros.identification.coverage [--trials 100] [--repeats 50] [--seed 1] [--part actuator]

Each trial makes the repeats that the benches would give (first loadings, steady points, breakaways) from the
axis file's laws with the random friction of its process and the noise of the sensors, runs the estimators with
their intervals, and notes which hold the truth.
"""

import argparse

import numpy as np

from microstage_ros.identification.estimators.actuator import Features
from microstage_ros.identification.estimators.actuator_fit import identify_presliding, identify_sliding
from microstage_ros.identification.estimators.stribeck import NAMES, stribeck_curve
from microstage_ros.identification.estimators.variability import identify_variability
from microstage_ros.identification.estimators.virgin_curve import Blocks, loading_from_samples
from microstage_ros.identification.experiments import SPEEDS
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import share

WAY = 0.5  # travel of a steady run [rad]
PLACES = 5  # of slow reversals in one repeat
RESAMPLES = 80


class FrictionProcess:
    """The random factor 1 + q of the axis file: two Ornstein–Uhlenbeck processes, clipped."""

    def __init__(self, axis, generator):
        values = [
            axis.value(f"variability.{key}")
            for key in ("relative", "travel_share", "travel_length", "time_length", "clip")
        ]
        self.sigma, self.share, self.length, self.duration, self.clip = values
        self.generator = generator
        self.spread = self.sigma * np.sqrt([self.share, 1.0 - self.share])
        self.parts = self.spread * generator.standard_normal(2)

    def advance(self, travel, time):
        """Factor after a further ``travel`` [m] and ``time`` [s]."""
        fade = np.exp([-travel / self.length, -time / self.duration])
        self.parts = self.parts * fade + self.spread * np.sqrt(1.0 - fade**2) * self.generator.standard_normal(2)
        return 1.0 + float(np.clip(self.parts.sum(), -self.clip, self.clip))

    def mean(self, travel, time, cells=6):
        """Mean factor [1] over a further ``travel`` [m] and ``time`` [s], taken at ``cells`` [1] places."""
        return float(np.mean([self.advance(travel / cells, time / cells) for _ in range(cells)]))


def synthetic_features(axis, repeats, generator, ratio=2e-3 / (2.0 * np.pi)):
    """`Features` of ``repeats`` [1] repeats of the actuator's bench: steady points and slow loadings.

    ``ratio``: travel of the stage per angle of the output [m/rad].
    """
    features = Features()
    blocks = Blocks.of(axis, "actuator")
    truth = [axis.value(f"contacts.actuator.{name}") for name in NAMES]
    limit = [*truth[:4], 0.0]
    for repeat in range(repeats):
        process = FrictionProcess(axis, generator)
        for speed in SPEEDS:
            for sign in (1.0, -1.0):
                way = max(WAY, 0.5 * speed)
                level = process.mean(way * ratio, way / speed)
                friction = level * stribeck_curve(limit, speed) + truth[4] * speed + 2e-8 * generator.standard_normal()
                features.speed.append(sign * speed)
                features.friction.append(sign * friction)
                features.repeat.append(repeat)
        process = FrictionProcess(axis, generator)
        for _ in range(PLACES):
            process.advance(3e-4, 1.0)
            for sign in (1.0, -1.0):
                level = process.advance(8e-6, 8.0)
                features.loadings.append(synthetic_loading(blocks, level, 1.9e-6, 3e-7, generator))
                features.loading_repeat.append(repeat)
                features.speed.append(sign * 3e-3)
                features.friction.append(sign * (level * stribeck_curve(limit, 3e-3) + truth[4] * 3e-3))
                features.repeat.append(repeats + repeat)
    return features


def synthetic_loading(blocks, level, resolution, noise, generator, points=800):
    """One first loading, F = c curve(x / c), as a `Loading`.

    ``blocks``: `Blocks`; ``level`` c [1]; ``resolution``: size of a count [rad]; ``noise``: standard deviation of the
    white noise [N m]; ``points`` [1].
    """
    x = np.geomspace(4.0 * resolution, 1.1 * level * blocks.slip_displacement[-1], points)
    return loading_from_samples(
        x, level * blocks.curve(x / level) + noise * generator.standard_normal(points), resolution
    )


def trial(axis, repeats, seed):
    """One trial of the actuator: {parameter: (estimate / truth, interval holds the truth)}.

    ``repeats`` and ``seed`` [1].
    """
    generator = np.random.default_rng(seed)
    features = synthetic_features(axis, repeats, generator)
    found = {}
    result = identify_sliding(features, seed, resamples=RESAMPLES)
    result.merge(
        identify_presliding(features.loadings, features.loading_repeat, seed, count=6, resamples=RESAMPLES // 2)
    )
    for name in NAMES:
        e, truth = result.estimates[f"contacts.actuator.{name}"], axis.value(f"contacts.actuator.{name}")
        found[name] = (e.value / truth, e.low <= truth <= e.high)
    for name in ("stiffness", "weight"):
        e, truth = (
            result.estimates[f"contacts.actuator.{name}"],
            np.asarray(axis.value(f"contacts.actuator.{name}"), float),
        )
        truth = truth / truth.sum() if name == "weight" else truth
        if len(e.value) == len(truth):
            for j, value in enumerate(truth):
                found[f"{name} {j + 1}"] = (e.value[j] / value, e.low[j] <= value <= e.high[j])
    return found


def variability_trial(axis, seed, runs=3, cells=1200, step=1e-5, speeds=(5e-5, 5e-4, 2e-3)):
    """One trial of the process: {parameter: (estimate / truth, interval holds the truth)}.

    ``runs`` of ``cells`` [1] of a length ``step`` [m] each, at the ``speeds`` [m/s] one after the other; ``seed`` [1].
    The process is not clipped here: clipping at 2.5 σ takes 1 % from σ, which is no error of the estimator.
    """
    generator = np.random.default_rng(seed)
    rows = []
    for _ in range(runs):
        process = FrictionProcess(axis, generator)
        process.clip = np.inf
        time = 0.0
        for k in range(cells):
            pace = step / speeds[(k * len(speeds)) // cells]
            time += pace
            rows.append(
                (process.advance(step, pace) - 1.0 + 0.003 * generator.standard_normal(), (k + 1) * step, time, k == 0)
            )
    result = identify_variability(*np.array(rows).T)
    truths = {key: axis.value(key) for key in result.estimates}
    return {key: (e.value / truths[key], e.low <= truths[key] <= e.high) for key, e in result.estimates.items()}


def table(trials):
    """{parameter: (coverage, median deviation, robust standard deviation of the deviation)} of a list of trials."""
    rows = {}
    for key in trials[0]:
        seen = [t[key] for t in trials if key in t]
        ratio = np.array([value for value, _ in seen])
        rows[key] = (float(np.mean([held for _, held in seen])), float(np.median(ratio) - 1.0),
                     float(0.7413 * np.subtract(*np.quantile(ratio, [0.75, 0.25]))))
    return rows


def main(argv=None):
    """Run the trials and print coverage and errors."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=100, metavar="N")
    parser.add_argument("--repeats", type=int, default=50, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    parser.add_argument("--part", choices=("actuator", "variability"), help="only this part")
    arguments = parser.parse_args(argv)
    axis = load_axis(share() / "config" / "experiments" / "actuator_bench.yaml")
    parts = {
        "actuator": lambda s: trial(axis, arguments.repeats, s),
        "variability": lambda s: variability_trial(axis, s),
    }
    for make in [parts[arguments.part]] if arguments.part else parts.values():
        rows = table([make(arguments.seed + k) for k in range(arguments.trials)])
        for key, (held, bias, spread) in rows.items():
            print(
                f"{key:28s} covers {held:6.1%}   median deviation {bias:+7.2%}   standard deviation {spread:6.2%}",
                flush=True,
            )


if __name__ == "__main__":
    main()
