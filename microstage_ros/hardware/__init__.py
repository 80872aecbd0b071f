"""Machines behind one protocol: `make_hardware(name, setup)`; a new one is a file here and a line in `BACKENDS`."""

import importlib

from microstage_ros.quantities.errors import InputError

BACKENDS = {
    "simulated": "microstage_ros.hardware.simulated:SimulatedAxis",
    "daq": "microstage_ros.hardware.daq:DaqCard",
}


def make_hardware(name, setup):
    """The backend of that name, not yet opened. Raises `InputError` for a name that is not in `BACKENDS`."""
    if name not in BACKENDS:
        raise InputError("backend", name, "one of " + ", ".join(BACKENDS))
    module, _, kind = BACKENDS[name].partition(":")
    return getattr(importlib.import_module(module), kind)(setup)
