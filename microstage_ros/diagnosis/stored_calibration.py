"""A calibration of stated probabilities from the file in which its examination wrote it."""

import functools
import pathlib

import yaml

from microstage_ros.diagnosis.selection.calibration import Calibration


@functools.cache
def stored_calibration(path: pathlib.Path) -> Calibration:
    """`Calibration` of the file ``path``, which `selection.calibration.write_calibration` wrote."""
    tree = yaml.safe_load(path.read_text(encoding="utf-8"))
    return Calibration(tuple(tree["coefficients"]), tree["named"], tree["right"], tuple(tree["without_evidence"]))
