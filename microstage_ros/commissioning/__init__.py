"""From a sketch of a machine to an axis file that its controller can be trusted with: ``microstage commission``."""
