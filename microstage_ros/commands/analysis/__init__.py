"""Commands on records and models: simulate, identify, diagnose, tune, compare."""
