"""Claims over seeds: how many of several trajectories an outcome is asked of, no further looked at than it takes."""


def at_least(wanted, outcomes):
    """Whether at least ``wanted`` of the outcomes hold. They are made one after the other, and none after the last that is needed."""
    held = 0
    for outcome in outcomes:
        held += bool(outcome)
        if held >= wanted:
            return True
    return False
