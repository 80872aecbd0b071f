"""The same tests on other trajectories: states whose last bits differ, and other seeds (`./microstage test --last-bits --seeds K`).

Processors and C libraries differ in the last bit of a sine or of a sum, and a trajectory through lost motion or stiction forgets
within a second how it began. No claim may hang on one. A pytest plugin: `MICROSTAGE_LAST_BITS=1` multiplies every number of a
simulated machine's first state by 1 + 10⁻¹⁵ n, n between ½ and 3/2 with a
random sign (and moves what is zero by as much of its usual size);
`MICROSTAGE_SEEDS=K` draws every noise of the simulated machines from other seeds, the same ones for the same K.
"""

import functools
import os

import numpy as np

import microstage_ros.solver.plant as plants

RELATIVE = 1.0e-15
USUAL = {"x": 1.0e-3, "theta": 1.0, "v": 1.0e-3, "omega": 1.0, "current": 0.1}     # m, rad, m/s, rad/s, A: of a number that is zero
FLAGS = ("stuck", "direction", "guard")     # yes or no, a sign, and -1 for "not known": compared exactly, so that they have no last bits
STEP = 1_000_003      # between the seeds of two sets; prime, so that no two tests' seeds meet


def perturbed(state, generator):
    """The state with its last bits drawn anew, in place: position and angle, speeds, current, forces and deflections of friction."""
    for name, usual in USUAL.items():
        size = max(abs(float(state[name])), usual)
        state[name] += RELATIVE * size * _bits(generator)
    for contact in ("actuator", "guideway"):
        for name in state[contact].dtype.names:
            value = state[contact][name]
            if name not in FLAGS and np.issubdtype(np.asarray(value).dtype, np.floating):
                state[contact][name] = value * (1.0 + RELATIVE * _bits(generator, np.shape(value)))
    return state


def _bits(generator, shape=()):
    return generator.choice([-1.0, 1.0], shape) * generator.uniform(0.5, 1.5, shape)


def wrapped(new_state, last_bits, shift):
    """`new_state` on other trajectories."""

    @functools.wraps(new_state)
    def other(plant, seed=0, *arguments, **options):
        state = new_state(plant, int(seed) + STEP * shift, *arguments, **options)
        return perturbed(state, np.random.default_rng([int(seed), shift, 15])) if last_bits else state

    return other


def _wrap():
    """Wrap `new_state` where it is defined. At the import of this plugin: conftest.py is imported before pytest_configure is called."""
    last_bits, shift = os.environ.get("MICROSTAGE_LAST_BITS") == "1", int(os.environ.get("MICROSTAGE_SEEDS", "0"))
    if (last_bits or shift) and not hasattr(plants.new_state, "__wrapped__"):
        plants.new_state = wrapped(plants.new_state, last_bits, shift)


_wrap()


def pytest_report_header(config):
    """One line above the tests."""
    return f"states: last bits {'drawn anew' if os.environ.get('MICROSTAGE_LAST_BITS') == '1' else 'as they are'}, set of seeds {os.environ.get('MICROSTAGE_SEEDS', '0')}"
