"""Long files of tests first: what begins last keeps one process busy while the others have nothing left to do.

What is imported for the tests stays until the end: it is not searched for garbage, neither while it is collected (two thirds
of the time that took) nor afterwards. What the tests make is searched less often than usual, which takes 6 % less time.
"""

import contextlib
import gc
import os
import time
from pathlib import Path

gc.disable()

BEGAN = time.time()
SHARED_MEMORY = Path("/dev/shm")

#: Files that take longest, by a full run on two cores; the rest follow in the order of their names.
LONGEST = (
    "documents/test_pages_run", "diagnosis/prerequisites/test_characteristic", "ros/safety/test_safety",
    "diagnosis/cases/test_diagnose_case", "diagnosis/cases/test_position_drives", "diagnosis/cases/test_default_law",
    "diagnosis/cases/test_unlisted_forms", "diagnosis/cases/test_every_verdict", "diagnosis/cases/test_beside_a_larger_one",
    "test_documentation", "diagnosis/cases/test_lost_motion", "diagnosis/cases/test_practice", "commissioning/test_law_choice",
    "commissioning/test_commission", "commands/test_diagnose", "control/test_tuning", "diagnosis/logs/test_many",
    "ros/test_drives_in_a_cell", "commands/test_mutation", "ros/transport/test_lockstep", "diagnosis/logs/test_file_kinds",
    "control/runs/test_coarse_fine", "ros/safety/test_driver_safety", "commissioning/test_programme",
    "diagnosis/preprocessing/test_motion_on_a_soft_drive", "ros/test_outside_backend",
    "ros/safety/test_resting_cell", "ros/test_health_monitor", "maintenance/test_maintenance",
    "diagnosis/prerequisites/test_law", "control/test_robustness", "control/test_closed_loop", "ros/test_experiment",
    "commissioning/test_frequency_response", "commands/test_laws", "control/observer/test_observer",
    "identification/test_motor", "diagnosis/logs/test_simulated", "diagnosis/cases/test_force_axis",
    "commissioning/test_other_drives", "identification/test_identify_command", "documents/test_notebooks",
    "monitoring/test_watch_command", "model/friction/test_law_properties", "ros/safety/test_security", "test_compiled",
)


def pytest_collection_modifyitems(items):
    """Sort by file; tests of one file stay together and in their order."""
    rank = {f"test/{name}.py": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.nodeid.partition("::")[0], len(rank)))


def pytest_collection_finish():
    """Garbage is what the tests leave behind."""
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)
    gc.enable()


def pytest_sessionfinish(session):
    """Tests kill processes, which leave their shared memory behind, hundreds of files in each run: what has come since
    the beginning and whose process is gone is removed."""
    within_a_test = {"PYTEST_XDIST_WORKER", "PYTEST_CURRENT_TEST"} & os.environ.keys()   # others go on
    if within_a_test or not SHARED_MEMORY.is_dir():
        return
    from microstage_ros.ros.transport.abandoned_locks import READER, process_numbers, process_of

    there = process_numbers()
    for path in SHARED_MEMORY.glob(f"{READER}*"):
        with contextlib.suppress(OSError):
            about, process = path.stat(), process_of(path.name)
            if about.st_uid == os.getuid() and about.st_mtime >= BEGAN and process is not None and process not in there:
                path.unlink()
