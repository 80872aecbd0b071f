"""The cells of the fault campaign and of healthy running: the simulated axis in one of three modes, under a name of
their own."""

from pathlib import Path

from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file

NAMESPACE = "/faults"
"""So that a cell that runs on the same computer is left alone."""

PERIODS = {"paced_1kHz": 1e-3, "paced_10kHz": 1e-4, "lockstep": 1e-4}
"""Mode to control period [s]."""


def cell_parameters(mode, folder, rate_limit=1.0, seed=1, **recorder):
    """Parameters of all nodes.

    Parameters
    ----------
    mode : of `PERIODS`. folder : for axis file and bag. rate_limit : times real time [1], lockstep only; 0: as fast as
        it goes. seed : of the simulated axis [1]. recorder : further parameters of the bag's recorder.
    """
    axis, lockstep = Path(folder) / "axis.yaml", mode == "lockstep"
    load_axis(config_file("axis.yaml")).with_values({"period": PERIODS[mode]}, source="estimate").save(axis)
    file = {"axis_file": str(axis)}
    return {
        "axis_driver": {
            "mode": "lockstep" if lockstep else "paced",
            "rate_limit": rate_limit if lockstep else 0.0,
            "seed": seed,
            **file,
        },
        "str_controller": file,
        "gms_observer": file,
        "bag_recorder": {
            "directory": str(Path(folder) / "bag"),
            "log_time": "stamp" if lockstep else "arrival",
            **recorder,
        },
    }
