"""The diagnosis of force drives examined on simulated axes, and how sure its names are.

    ./microstage shell python -m microstage_ros.diagnosis.resimulation.examination --cases 400 --seed 1

Each case has a seed of its own, from which the axis's numbers (within a factor of two of EMPS's), the motion, the noise
and what is hidden are drawn: one effect, two, or none. Half of the cases come with a record of the healthy axis, and in
half of them a further record is held out. With ``--calibrate FILE`` the stated probability is fitted to what was right
(`selection.calibration`, with χ² = z² of the cause's surest size and its share for the clarity); without it the stated
probabilities are compared with it.
"""

import argparse
import concurrent.futures
import dataclasses
import math
import multiprocessing
import sys
from typing import NamedTuple

import numpy as np

from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.diagnosis.resimulation.diagnose import diagnose_force_axis
from microstage_ros.diagnosis.selection.calibration import calibrate, write_calibration
from microstage_ros.metrology.rates import rate
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.records import Record

KINDS, SHARES = ("one", "two", "healthy"), (0.6, 0.25, 0.15)    # what is hidden, and in how many of the cases
OWN = ("stage.mass", "contacts.guideway.coulomb", "contacts.guideway.viscous")   # numbers of the axis that are drawn
FACTOR = 2.0                   # within which they are
GRAVITY = 9.80665              # m/s²
TOP_SPEED = (0.05, 0.15)       # m/s, range of the fastest stroke
RAMP = 0.08                    # s, of every change of speed
MOST_REPEATS = 4               # of a motion
SEEN = ("encoder_m", "reference_m", "voltage_V")
CLASSES = (0.0, 0.9, 0.97, 1.0)    # edges of the classes of stated probabilities


class Case(NamedTuple):
    """One case to be: with the campaign's seed, its number decides everything."""

    seed: int
    number: int


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What was hidden and what was said.

    ``stated``: (χ² [1], share [1], probability [1], was it hidden) of each named cause; ``baseline``: whether a healthy
    record was there; ``repeats``: how often the learnt record repeats its motion [1].
    """

    number: int
    hidden: tuple
    verdict: str
    named: tuple
    rivals: tuple
    stated: tuple
    baseline: bool
    repeats: int


def examine(case):
    """The `Outcome` of a `Case`."""
    generator = np.random.default_rng([case.seed, case.number])
    axis = drawn_axis(generator)
    effects = drawn_effects(axis, generator)
    hidden = axis.with_effects(effects) if effects else axis
    noise = {"encoder_m": float(generator.uniform(1e-8, 4e-8)), "voltage_V": float(generator.uniform(1e-3, 4e-3)),
             "current_A": 0.0, "interferometer_m": 0.0, "friction_relative": float(generator.uniform(0.005, 0.03))}
    with_baseline, with_holdout = generator.uniform(size=2) < 0.5

    def record(machine, name, repeats):
        run = Run(noise=noise, program=[{"reference": motion(generator, axis.value("period"), repeats)}])
        columns = simulate(machine, run, seed=int(generator.integers(2**31)))
        return Record(axis.value("period"), {key: columns[key] for key in SEEN}, name)

    repeats = [int(generator.integers(1, MOST_REPEATS + 1)) for _ in range(3)]
    records = [record(hidden, "learned", repeats[0])]
    holdout = [record(hidden, "held out", repeats[1])] if with_holdout else []
    baseline = [record(axis, "healthy", repeats[2])] if with_baseline else []
    answer = diagnose_force_axis(axis, records, holdout, baseline, seed=0)
    stated = tuple((float(one.evidence), one.share, one.probability, one.id in effects) for one in answer.causes)
    return Outcome(case.number, tuple(effects), answer.verdict, tuple(one.id for one in answer.causes),
                   tuple(one.ids for one in answer.rivals), stated, bool(baseline), repeats[0])


def drawn_axis(generator):
    """EMPS's `Axis` with numbers of its own, by a ``generator``."""
    axis = load_axis(config_file("emps.yaml"))
    return axis.with_values({key: axis.value(key) * FACTOR ** float(generator.uniform(-1.0, 1.0)) for key in OWN})


def motion(generator, period, repeats):
    """Reference [m] every ``period`` [s]: strokes of several speeds there and back with rests between, ``repeats`` [1]
    times over, or three such pairs of strokes, each with speeds of its own, where nothing repeats."""
    speeds = []
    for _ in range(3 if repeats == 1 else 1):
        top = float(np.exp(generator.uniform(*np.log(TOP_SPEED))))
        way = top * float(generator.uniform(0.4, 0.7))
        for part in (generator.dirichlet((3.0, 3.0)), -generator.dirichlet((3.0, 3.0))):
            for share, speed in zip(part, (0.4 * top, top)):
                speeds += [np.full(int(abs(share) * way / speed / period), math.copysign(speed, share))]
            speeds += [np.zeros(int(float(generator.uniform(0.05, 0.3)) / period))]
    course = np.tile(np.concatenate(speeds), repeats)
    ramp = np.ones(int(RAMP / period)) / int(RAMP / period)
    return np.cumsum(np.convolve(course, ramp)[:len(course)]) * period


def drawn_effects(axis, generator):
    """{id: parameters} of one effect, two or none that a force drive can have, clearly visible on this axis."""
    kind = generator.choice(KINDS, p=SHARES)
    sizes = _sizes(axis, generator)
    count = {"one": 1, "two": 2, "healthy": 0}[str(kind)]
    return {str(name): sizes[str(name)] for name in generator.choice(sorted(sizes), count, replace=False)}


def _sizes(axis, generator):
    coulomb, mass, gain, period, pitch = (axis.value(key) for key in (
        "contacts.guideway.coulomb", "stage.mass", "drive.gain", "period", "transmission.pitch"))

    def signed(low, high):
        return float(generator.uniform(low, high) * generator.choice((-1.0, 1.0)))

    phase = float(generator.uniform(-math.pi, math.pi))
    exponent = float(generator.choice((0.5, 1.5, 2.0)))
    return {
        "payload_change": {"mass_kg": signed(0.1, 0.3) * mass},
        "gravity_tilt": {"angle_rad": math.asin(signed(0.2, 0.6) * coulomb / mass / GRAVITY)},
        "amplifier_offset": {"offset_V": signed(0.2, 0.6) * coulomb / gain},
        "amplifier_gain": {"factor": 1.0 + signed(0.05, 0.2)},
        "viscous_change": {"contact": "guideway", "factor": math.exp(signed(0.3, 0.7))},
        "friction_level_change": {"contact": "guideway", "factor": math.exp(signed(0.1, 0.3))},
        "direction_asymmetry": {"contact": "guideway", "asymmetry": signed(0.05, 0.3),
                                "viscous_asymmetry": signed(0.1, 0.4)},
        "nonlinear_viscous": {"contact": "guideway", "exponent": exponent,
                              "coefficient": abs(signed(0.2, 0.6)) * coulomb / TOP_SPEED[0]**exponent},
        "position_dependent_friction": {"contact": "guideway", "amplitude": abs(signed(0.05, 0.2)), "period_m": pitch,
                                        "phase_rad": phase, "positions_m": [0.0], "factors": [1.0]},
        "torque_ripple": {"amplitude_Nm": [abs(signed(0.05, 0.15)) * coulomb * pitch / (2.0 * math.pi)],
                          "cycles_per_turn": [1.0], "phase_rad": [phase]},
        "cable_spring": {"stiffness_N_m": abs(signed(0.3, 1.0)) * coulomb / TOP_SPEED[0], "anchor_m": 0.02},
        "amplifier_deadband": {"half_width_V": abs(signed(0.1, 0.4)) * coulomb / gain},
        "actuator_lag": {"time_s": abs(signed(0.5, 3.0)) * period},
        "transport_delay": {"delay_s": abs(signed(0.5, 3.0)) * period},
        "sampling_jitter": {"late_s": abs(signed(0.5, 1.0)) * period},
    }


def report(outcomes):
    """The figures of ``outcomes``, `Outcome` each, as lines of text with 95 % intervals."""
    hidden = [one for one in outcomes if one.hidden]
    healthy = [bool(one.named or one.rivals) for one in outcomes if not one.hidden]
    wrong = [bool(set(one.named) - set(one.hidden)) for one in outcomes]
    stated = [cause for one in outcomes for cause in one.stated]
    lines = [
        f"first name right, or a rival right: {rate(sum(_first(one) for one in hidden), len(hidden))}",
        f"nothing seen of what is hidden: {rate(sum(one.verdict == 'agrees' for one in hidden), len(hidden))}",
        f"a wrong name anywhere: {rate(sum(wrong), len(wrong))}",
        f"healthy axes with a name or rivals: {rate(sum(healthy), len(healthy))}",
        f"names right: {rate(sum(cause[3] for cause in stated), len(stated))}",
    ]
    for low, high in zip(CLASSES, CLASSES[1:]):
        inside = [(p, right) for _, _, p, right in stated if low <= p < high or p == high == 1.0]
        if inside:
            lines.append(f"stated {low:g} to {high:g}, mean {np.mean([p for p, _ in inside]):.3f}: right "
                         f"{rate(sum(right for _, right in inside), len(inside))}")
    return lines


def _first(outcome):
    named = outcome.named[:1] or sum(outcome.rivals, ())
    return bool(set(named) & set(outcome.hidden))


def main(argv=None):
    """Examine, print the figures, and write the calibration where one is asked for. Returns 0."""
    parser = argparse.ArgumentParser(prog="examination", description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--calibrate", metavar="FILE")
    parser.add_argument("--verbose", action="store_true")
    arguments = parser.parse_args(argv)
    outcomes = []
    cases = [Case(arguments.seed, number) for number in range(arguments.cases)]
    fresh = multiprocessing.get_context("spawn")     # processes that inherit no threads
    with concurrent.futures.ProcessPoolExecutor(arguments.jobs, mp_context=fresh) as pool:
        for outcome in pool.map(examine, cases):
            outcomes.append(outcome)
            if arguments.verbose:
                print(outcome, flush=True)
    print("\n".join(report(outcomes)))
    if arguments.calibrate:
        words = " ".join(["./microstage shell python -m microstage_ros.diagnosis.resimulation.examination",
                          *(sys.argv[1:] if argv is None else argv)])
        named = [(evidence, share, right) for one in outcomes for evidence, share, _, right in one.stated]
        write_calibration(arguments.calibrate, calibrate(named), words)
    return 0


if __name__ == "__main__":
    sys.exit(main())
