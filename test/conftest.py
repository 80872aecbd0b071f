"""Long files of tests first: what begins last keeps one process busy while the others have nothing left to do.

What is imported for the tests stays until the end: it is not searched for garbage, neither while it is collected (two thirds
of the time that took) nor afterwards.
"""

import gc

gc.disable()

#: Files that take longest, by a full run on two cores; the rest follow in the order of their names.
LONGEST = (
    "documents/test_pages_run", "ros/safety/test_safety", "diagnosis/cases/test_position_drives",
    "diagnosis/cases/test_beside_a_larger_one", "test_every_law_everywhere",
    "commands/test_mutation", "hardware/test_mesa", "diagnosis/cases/test_lost_motion", "maintenance/test_maintenance",
    "diagnosis/cases/test_every_verdict", "ros/transport/test_lockstep", "diagnosis/cases/test_diagnose_case", "test_house",
    "diagnosis/cases/test_unlisted_forms", "control/test_tuning", "ros/test_drives_in_a_cell", "commands/test_diagnose",
    "diagnosis/logs/test_many", "ros/launching/test_parameters", "ros/test_outside_backend", "ros/safety/test_driver_safety",
    "ros/test_health_monitor", "commissioning/test_commission", "diagnosis/cases/test_practice", "solver/test_step",
    "ros/launching/test_fork_server", "test_documentation", "ros/test_experiment", "documents/test_notebooks",
    "diagnosis/logs/test_file_kinds", "identification/test_motor", "control/observer/test_observer",
    "commissioning/test_other_drives",
)


def pytest_collection_modifyitems(items):
    """Sort by file; tests of one file stay together and in their order."""
    rank = {f"test/{name}.py": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.nodeid.partition("::")[0], len(rank)))


def pytest_collection_finish():
    """Garbage is what the tests leave behind."""
    gc.freeze()
    gc.enable()
