"""Long files of tests first: what begins last keeps one process busy while the others have nothing left to do.

What is imported for the tests stays until the end: it is not searched for garbage, neither while it is collected (two thirds
of the time that took) nor afterwards.
"""

import gc

gc.disable()

#: Files that take longest, by a full run on two cores; the rest follow in the order of their names.
LONGEST = (
    "documents/test_pages_run", "maintenance/test_maintenance", "diagnosis/cases/test_beside_a_larger_one",
    "ros/safety/test_safety", "diagnosis/prerequisites/test_characteristic", "diagnosis/cases/test_position_drives",
    "diagnosis/cases/test_every_verdict", "diagnosis/cases/test_diagnose_case", "diagnosis/cases/test_lost_motion",
    "test_every_law_everywhere", "commands/test_mutation", "hardware/test_mesa", "solver/test_step",
    "diagnosis/cases/test_practice", "diagnosis/cases/test_unlisted_forms", "ros/transport/test_lockstep",
    "commissioning/test_commission", "ros/test_drives_in_a_cell", "commissioning/test_law_choice", "ros/safety/test_driver_safety",
    "commands/test_diagnose", "test_documentation", "ros/test_health_monitor", "diagnosis/logs/test_file_kinds",
    "commissioning/test_programme", "control/test_tuning", "diagnosis/prerequisites/test_law", "test_house", "ros/test_experiment",
    "diagnosis/logs/test_many", "diagnosis/preprocessing/test_motion_on_a_soft_drive", "control/runs/test_coarse_fine",
    "ros/test_outside_backend", "ros/launching/test_fork_server", "commissioning/test_frequency_response",
    "control/observer/test_observer", "ros/safety/test_resting_cell", "identification/test_motor", "control/test_closed_loop",
    "diagnosis/logs/test_simulated", "documents/test_notebooks", "commands/test_laws", "diagnosis/cases/test_force_axis",
    "ros/launching/test_parameters", "commissioning/test_other_drives",
)


def pytest_collection_modifyitems(items):
    """Sort by file; tests of one file stay together and in their order."""
    rank = {f"test/{name}.py": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.nodeid.partition("::")[0], len(rank)))


def pytest_collection_finish():
    """Garbage is what the tests leave behind."""
    gc.freeze()
    gc.enable()
