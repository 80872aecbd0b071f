"""Which effects explain what changed: their columns, the choice, sizes with intervals, their course over time, the
verdict."""
