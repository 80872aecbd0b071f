"""Whether the diagnosis's answers depend on constants that no comparison shows: the same cases with others in place.

A window, a range of a search or the length of a block has no value at which a decision turns (`margins`). So constants
of one group are all multiplied by a factor, the same cases diagnosed again, and the answers compared:

    ./microstage shell python -m microstage_ros.diagnosis.validation.variation --group lines --factors 0.5 2

An answer is the same with the same verdict, names and rivals; of every size it is told by how many of its standard
errors it moved, and in how many cases any figure of the answer is another: in none, the cases do not reach the
constants, and nothing is said of them.

"Half and double: the same answers" beside a constant is of this command with that group and its usual cases, one of
each effect of the group and a healthy axis: few, and no more is said. No size of lines, periods, swing and scatter
moved by more than 0.5 of its standard errors. With ``--alone`` every constant of a group is multiplied on its own: in a
group of several one alone may be what the cases reach.
"""

import argparse
import contextlib
import dataclasses
import importlib
import itertools
import pkgutil

import numpy as np

from microstage_ros import diagnosis
from microstage_ros.diagnosis.batch import diagnose_records
from microstage_ros.diagnosis.validation.campaign import examinations
from microstage_ros.diagnosis.validation.campaign import draw as drawn
from microstage_ros.diagnosis.validation.margins import modules_with
from microstage_ros.diagnosis.validation.ways import CASES
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file

#: Group to (module of the diagnosis, its constants that are multiplied together) and the effects of the cases.
GROUPS = {
    "lines": ("prerequisites.lines", ("LOWEST", "WINDOW", "REST_SPEED"), ("floor_vibration",)),
    "skirt": ("prerequisites.lines", ("SKIRT", "NEAR"), ("floor_vibration",)),
    "smooth": ("prerequisites.encoder", ("SMOOTH",), ("encoder_sde",)),
    "periods": ("prerequisites.periods", ("BESIDE", "SLOW", "MOST", "LEAST_VALUES"), ("encoder_sde", "torque_ripple")),
    "scatter": ("prerequisites.timing", ("BLOCK",), ("sampling_jitter",)),
    "steady": ("prerequisites.timing", ("STEADY", "LEAST_FLOOR", "LOST_AGAIN"), ("sampling_jitter",)),
    "sticking": ("residuals.mechanical", ("STUCK_TIME", "STUCK_TRAVEL"),
                 ("rising_static_friction", "presliding_creep", "friction_level_change")),
    "drawn": ("prerequisites.resonant", ("DRAWN",), ("payload_change", "drive_compliance")),
    "shares": ("selection.selection", ("HELD_SHARE",),
               ("cable_spring", "position_dependent_friction", "payload_change")),
    "left": ("selection.judge", ("LEFT_SHARE",), ("friction_level_change", "gravity_tilt", "encoder_sde")),
    "resonant": ("prerequisites.resonant", ("MASS_REACH", "STEP"), ("payload_change", "drive_compliance")),
    "settling": ("residuals.mechanical", ("SETTLING_TRAVEL",),
                 ("rising_static_friction", "presliding_creep", "friction_level_change")),
    "delay": ("prerequisites.amplifier", ("LEAST_TIME", "SHORT_OF_WHOLE", "DELAY_STEP"),
              ("transport_delay", "actuator_lag")),
    "stretch": ("prerequisites.periods", ("STRETCH",), ("encoder_sde", "torque_ripple", "screw_pitch_error")),
    "gap": ("prerequisites.lost_motion", ("BOUND", "LEAST_ERROR", "RATTLE_ERROR"), ("backlash",)),
    "drift": ("prerequisites.slow_drift", ("OF_ALL",), ("thermal_drift", "refractive_index")),
    "motion": ("preprocessing.motion", ("LOAD_WALK", "REACH"), ("frictional_lag", "amplifier_gain")),
    "fusion": ("preprocessing.preparation", ("FUSION", "STAGE_FUSION", "GAP_FUSION"),
               ("backlash", "frictional_lag", "drive_compliance")),
    "noise": ("preprocessing.preparation", ("TRAVEL_NOISE", "MOTOR_NOISE"), ("payload_change", "frictional_lag")),
    "white": ("residuals.mechanical", ("LEAST_STEP", "LOCAL", "NEAR", "MOST_SCATTER"),
              ("rising_static_friction", "friction_level_change", "torque_ripple")),
    "torque": ("residuals.mechanical", ("BLOCK",), ("frictional_lag", "nonlinear_viscous")),
    "rounding": ("residuals.position", ("RENEWAL", "LEAST_RENEWAL"), ("encoder_sde", "thermal_drift")),
    "forgetting": ("residuals.position", ("RENEWAL_TIME",), ("encoder_sde", "thermal_drift")),
    "size": ("residuals.resonance", ("LOCAL",), ("drive_compliance", "payload_change")),
    "systematic": ("residuals.systematic", ("SYSTEMATIC",),
                   ("presliding_creep", "amplifier_gain", "drive_compliance", "cable_spring")),
    "judge": ("selection.judge", ("RIVAL_SHARE", "SLACK", "READING_SHARE"),
              ("friction_level_change", "gravity_tilt", "encoder_sde", "sampling_jitter")),
    "trials": ("selection.selection", ("SIMPLER", "SIMPLER_SHARE", "ONE_RESONANCE"),
               ("friction_level_change", "payload_change", "nonlinear_viscous")),
    "splinters": ("selection.splinters", ("FAINT", "MINOR", "OWN_SHARE", "MINOR_BESIDE"),
                  ("nonlinear_viscous", "presliding_creep", "amplifier_gain")),
    "course": ("residuals.position", ("PIECE",), ("encoder_sde", "thermal_drift")),
    "reading": ("residuals.position", ("BLOCK",), ("encoder_sde", "thermal_drift")),
    "swing": ("residuals.resonance", ("BLOCK", "WINDOW"), ("drive_compliance", "payload_change")),
    "travel": ("residuals.transmission_deflection", ("BLOCK",), ("resistance_rise", "amplifier_offset")),
    "leftover": ("selection.leftover", ("PIECE", "CLASSES"), ()),
}


def changed(value, factor):
    """A constant's ``value`` [any unit] times ``factor`` [1]; of a range both ends move out.

    Whole numbers stay whole, and odd ones odd. Of a table every entry is multiplied.
    """
    if isinstance(value, dict):
        return {key: tuple(v * factor for v in one) if isinstance(one, tuple) else changed(one, factor)
                for key, one in value.items()}
    if isinstance(value, tuple):
        return tuple(v * (1.0 / factor if n == 0 and len(value) == 2 else factor) for n, v in enumerate(value))
    if isinstance(value, int):
        return 2 * round((value * factor - 1) / 2) + 1 if value % 2 else round(value * factor)
    return value * factor


@contextlib.contextmanager
def with_factor(place, names, factor):
    """Context in which these constants of a module are `changed` by a ``factor`` [1], wherever they were imported."""
    owner, before = importlib.import_module(f"microstage_ros.diagnosis.{place}"), []
    for name in names:
        value = getattr(owner, name)
        before += [(module, name, value) for module in modules_with(name, value)]
    for module, name, value in before:
        setattr(module, name, changed(value, factor))
    _forget()
    try:
        yield
    finally:
        for module, name, value in before:
            setattr(module, name, value)
        _forget()


def _forget():
    """Forget what the diagnosis's functions keep of earlier calls: constants are in it."""
    for found in pkgutil.walk_packages(diagnosis.__path__, "microstage_ros.diagnosis."):
        for one in vars(importlib.import_module(found.name)).values():
            if hasattr(one, "cache_clear"):
                one.cache_clear()


def answer_of(axis, records):
    """((verdict, names, rivals), {parameter: (value, standard error)}, all that was said) of records (learn, held out,
    baseline)."""
    learn, held, base = records
    answer = diagnose_records(axis, learn, held, base, seed=0)
    sizes = {f"{cause.id}.{name}": (number.value, number.stderr)
             for cause in answer.causes for name, number in cause.parameters.items()}
    said = answer.verdict, sorted(c.id for c in answer.causes), sorted(sorted(r.ids) for r in answer.rivals)
    return said, sizes, repr(dataclasses.replace(answer, pictures=()))


def moved(before, after):
    """Largest change [1] of a size that both answers have, in the standard errors of the one before.

    Parameters
    ----------
    before, after : {parameter: (value, standard error)}, each of shape (2,).
    """
    changes = [abs(after[name][0] - value) / stderr for name, (value, stderr) in before.items()
               if name in after and np.isfinite(stderr) and stderr > 0.0]
    return max(changes, default=0.0)


def main(argv=None):
    """Print, for every group and factor, in how many of the cases the answer is the same, and how far sizes moved."""
    parser = argparse.ArgumentParser(prog="variation", description=__doc__.split("\n")[0])
    parser.add_argument("--group", nargs="+", default=list(GROUPS), choices=list(GROUPS))
    parser.add_argument("--factors", nargs="+", type=float, default=[0.5, 2.0])
    parser.add_argument("--world", default="first", choices=list(CASES))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=1, help="of each effect, and as many healthy axes")
    parser.add_argument("--strength", type=float, default=1.0, help="of what is hidden, times the usual")
    parser.add_argument("--alone", nargs="*", metavar="NAME", help="every constant of a group, or these, on its own")
    given = parser.parse_args(argv)
    strange = set(given.alone or ()).difference(*(GROUPS[group][1] for group in given.group))
    if strange:
        known_ones = ", ".join(name for group in given.group for name in GROUPS[group][1])
        parser.error(f"--alone: got {' '.join(sorted(strange))}, expected some of {known_ones}")
    path = str(config_file("axis.yaml"))
    axis, known = load_axis(path), {}

    def case(kind, effect, number):
        if (kind, effect, number) not in known:
            one = examinations(number + 1, given.seed, path, kind, given.strength, effect, given.world)[number]
            what, friction = drawn(one)
            records = CASES[one.world](axis, what, given.seed * 100_003 + number, friction)
            known[kind, effect, number] = records, answer_of(axis, records)
        return known[kind, effect, number]

    for group in given.group:
        place, names, effects = GROUPS[group]
        wanted = [("single", effect) for effect in effects] if effects else [("outside", "")]
        cases = [(kind, effect, n) for kind, effect in [*wanted, ("healthy", "")] for n in range(given.cases)]
        before = {one: case(*one) for one in cases}
        alone = given.alone is not None
        sets = [(name,) for name in names if name in (given.alone or names)] if alone else [names]
        for names, factor in itertools.product(sets, given.factors):
            same, most, reached = 0, 0.0, 0
            with with_factor(place, names, factor):
                for one, (records, (said, sizes, everything)) in before.items():
                    said_now, sizes_now, everything_now = answer_of(axis, records)
                    same, most = same + (said_now == said), max(most, moved(sizes, sizes_now))
                    reached += everything_now != everything
                    if said_now != said:
                        print(f"    {one}: {said} becomes {said_now}", flush=True)
            print(f"{group:12} x {factor:g}: the same in {same} of {len(before)}, sizes by {most:.2f} standard errors, "
                  f"some figure another in {reached}   {place}: {', '.join(names)}", flush=True)


if __name__ == "__main__":
    main()
