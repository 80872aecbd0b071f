"""A record of a machine of two components, as two records: one of each.

With q the interferometer's position of the top and y that of the fine stage by its own sensor,

    coarse:  q_c = q - y                                                   encoder, command and current are its own
    fine:    encoder y,  command u_f + w,  reference r - q_c               so r_f - y = r - q, the error of its law

The coarse stage's acceleration a_c pushes the fine one with -m_f a_c, as the voltage w = -m_f a_c/(k_s d) would: a
known disturbance (column ``disturbance_V``). a_c is the second derivative of cubics through q_c.
"""

import numpy as np
from scipy.signal import savgol_filter

from microstage_ros.records import Record
from microstage_ros.records.columns import FINE_COLUMNS

TOP = ("interferometer_m", *FINE_COLUMNS, "stage_m", "stage_velocity_m_s")
"""What belongs to the top or to the fine stage."""
SMOOTH = 31
"""Rows of a cubic: 10 nm of noise at 10 kHz make 5 mm/s² of it, a millinewton on 0.2 kg."""


def component_records(record, fine):
    """{"coarse": `Record`, "fine": `Record`} of a record of both (`control.runs.coarse_fine`), with its metadata.

    Parameters
    ----------
    fine : `Axis` of the fine stage.

    Raises
    ------
    InputError : a record without the fine stage's columns, or without ``interferometer_m`` of the top.
    """
    y, command = (record[name] for name in FINE_COLUMNS)
    below = record["interferometer_m"] - y
    pushed = _push(below, record.period_s, fine)
    coarse = {name: values for name, values in record.columns.items() if name not in TOP}
    coarse["interferometer_m"] = below
    columns = {"t_s": record["t_s"], "encoder_m": y, "reference_m": record["reference_m"] - below,
               "voltage_V": command + pushed, "disturbance_V": pushed}
    return {name: Record(record.period_s, each, record.source, dict(record.metadata), record.remarks)
            for name, each in (("coarse", coarse), ("fine", columns))}


def _push(below, period, fine):
    """W [V] over the rows of the coarse stage's position ``below`` [m]."""
    if len(below) <= SMOOTH:
        return np.zeros(len(below))
    force_per_volt = fine.value("drive.stack_stiffness") * fine.value("drive.displacement_per_volt")
    acceleration = savgol_filter(below, SMOOTH, 3, deriv=2, delta=period)
    return -fine.value("stage.mass") * acceleration / force_per_volt
