"""Over which windows the motor's motion is known best: its speed against the simulated one, which no record shows.

A longer window averages more of the reading's noise, a shorter one more of what the back-EMF's travel is off by. So the
windows of `preprocessing.preparation` are multiplied by some factors, the same simulated records prepared again, and
the motor's and the stage's speed compared with the true ones:

    ./microstage shell python -m microstage_ros.diagnosis.validation.windows

``FUSION`` and ``STAGE_FUSION`` are asked of healthy records and of a soft drive train that is known, ``NO_CURRENT`` of
healthy ones without their current, ``GAP_FUSION`` of records behind a gap whose width is known.
"""

import argparse
import contextlib
import dataclasses
import itertools

import numpy as np

from microstage_ros.diagnosis.preprocessing import preparation
from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.diagnosis.validation import second_world, simulated_records
from microstage_ros.diagnosis.validation.simulated_records import Hidden
from microstage_ros.diagnosis.validation.variation import changed
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.records import Record

WORLDS = {"first": simulated_records, "second": second_world}
TRUE = ("motor_speed_rad_s", "stage_velocity_m_s")
GAP = 0.01      # rad of lost motion at the screw, where a window asks for a gap
SOFT = 0.1      # of the drive train's stiffness and damping, where it asks for a soft drive
#: What records are made with, as entries of ``effects``.
MADE_WITH = {"healthy": {}, "no current": {}, "gap": {"backlash": {"width_rad": GAP}},
             "soft drive": {"drive_compliance": {"stiffness_factor": SOFT, "damping_factor": SOFT}}}
#: Window to the records that it is asked of.
WINDOWS = {"FUSION": ("healthy", "soft drive"), "STAGE_FUSION": ("healthy", "soft drive"),
           "NO_CURRENT": ("no current",), "GAP_FUSION": ("gap",)}
ENDS = 2000     # rows at either end that are left out; derived: twice the longest window


@contextlib.contextmanager
def showing(module):
    """Context in which the records of a world's ``module`` hold the true speeds, `TRUE`, too."""
    before = module.SEEN
    module.SEEN = (*before, *TRUE)
    try:
        yield
    finally:
        module.SEEN = before


@contextlib.contextmanager
def window(name, factor):
    """Context in which a window of `preparation` is multiplied by a ``factor`` [1]."""
    before = getattr(preparation, name)
    setattr(preparation, name, changed(before, factor))
    preparation.speed_share.cache_clear()
    try:
        yield getattr(preparation, name)
    finally:
        setattr(preparation, name, before)
        preparation.speed_share.cache_clear()


def errors(record, drive, gap):
    """(rms error of the motor's speed, of the stage's) [m/s] of a record behind a ``gap`` [m]."""
    made = preparation.prepare(record, drive, gap=gap)
    inner = slice(ENDS, len(record) - ENDS)
    pairs = (made.speed, drive.lever * record[TRUE[0]]), (made.stage_speed, record[TRUE[1]])
    return tuple(float(np.sqrt(np.mean((found - true)[inner] ** 2))) for found, true in pairs)


def without_current(record):
    """The same record, whose current nobody measured."""
    columns = {name: record[name] for name in record.columns if name != "current_A"}
    return Record(record.period_s, columns, record.source, record.metadata)


def examples(module, axis, kind, seeds):
    """(a `Record` of a world's ``module`` for each of ``seeds`` [1], the `Drive` of the `Axis` as it is there) of a
    ``kind`` of `MADE_WITH`."""
    drive = drive_of(axis)
    with showing(module):
        hidden = Hidden(kind, effects=MADE_WITH[kind])
        records = [module.make_case(axis, hidden, seed)[0][0] for seed in seeds]
    if kind == "no current":
        records = [without_current(record) for record in records]
    if kind == "soft drive":
        drive = dataclasses.replace(drive, stiffness=SOFT * drive.stiffness, damping=SOFT * drive.damping)
    return records, drive


def main(argv=None):
    """Print the errors of both speeds for every window, world and factor, rms over the records."""
    parser = argparse.ArgumentParser(prog="windows", description=__doc__.split("\n")[0])
    parser.add_argument("--window", nargs="+", default=list(WINDOWS), choices=list(WINDOWS))
    parser.add_argument("--factors", nargs="+", type=float, default=[0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 4.0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--records", type=int, default=6, help="of each world")
    given = parser.parse_args(argv)
    axis = load_axis(str(config_file("axis.yaml")))
    for name in given.window:
        for kind, (world, module) in itertools.product(WINDOWS[name], WORLDS.items()):
            records, drive = examples(module, axis, kind, range(given.seed, given.seed + given.records))
            gap = GAP * drive.radius if kind == "gap" else 0.0
            for factor in given.factors:
                with window(name, factor) as periods:
                    found = [errors(record, drive, gap) for record in records]
                motor, stage = np.sqrt(np.mean(np.square(found), axis=0)) * 1e6
                print(f"{name:11} {kind:10} {world:7} {periods:5d} periods   motor {motor:8.3f} um/s   "
                      f"stage {stage:8.3f} um/s", flush=True)


if __name__ == "__main__":
    main()
