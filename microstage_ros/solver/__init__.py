"""The compiled control period: event-free and event step, ensembles, from an axis file to records."""
