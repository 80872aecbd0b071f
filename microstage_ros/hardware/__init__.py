"""Machines behind one protocol: `make_hardware(name, setup)`.

A backend is named in one of three ways:

- a name of this project, a line in `BACKENDS`;
- the name of an entry point of the group `microstage_ros.hardware` of any installed distribution;
- ``package.module:Class``, importable from ``PYTHONPATH``.
"""

import importlib
import importlib.metadata

from microstage_ros.quantities.errors import InputError

BACKENDS = {
    "simulated": "microstage_ros.hardware.simulated:SimulatedAxis",
    "daq": "microstage_ros.hardware.daq:DaqCard",
    "mesa": "microstage_ros.hardware.mesa.card:MesaCard",
}
GROUP = "microstage_ros.hardware"
"""Entry points of other distributions that are backends."""


def make_hardware(name, setup):
    """The backend of that name, made with ``setup`` (`protocol.Setup`), not yet opened.

    Raises `InputError`: a name that is none of the three kinds, a class that cannot be imported, lacks a member of
    `protocol.Hardware`, or cannot be made.
    """
    if name in BACKENDS:
        return _imported(name, BACKENDS[name])(setup)
    from microstage_ros.hardware.outside import OutsideBackend

    found = _entry_points()
    if name in found:
        return OutsideBackend(name, _imported(name, found[name]), setup)
    if not all(part.isidentifier() for part in name.replace(":", ".", 1).split(".")) or name.count(":") != 1:
        known = ", ".join([*BACKENDS, *sorted(found)])
        raise InputError("backend", name, f"one of {known}, or package.module:Class importable from PYTHONPATH")
    return OutsideBackend(name, _imported(name, name), setup)


def _entry_points():
    """Name to ``module:Class`` of the backends that installed distributions offer."""
    return {point.name: point.value for point in importlib.metadata.entry_points(group=GROUP)}


def _imported(name, place):
    """The class at ``module:Class``."""
    module, _, attribute = place.partition(":")
    try:
        found = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    except AttributeError:
        raise InputError("backend", name, f"a class named {attribute} in module {module}") from None
    except Exception as error:  # noqa: BLE001 - a module from outside may fail to import in any way
        reason = " ".join(str(error).split()) or "no reason given"
        raise InputError(
            "backend", name, f"a module {module} that can be imported ({type(error).__name__}: {reason})"
        ) from error
    return found
