"""A number with its unit, where it comes from, and how well it is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec, as_number

SOURCES = ("paper", "datasheet", "estimate", "identified", "published", "derived")
KEYS = ("value", "unit", "source", "stderr", "tolerance")


@dataclass(frozen=True)
class Quantity:
    """A number (or a list of numbers) with unit, source and, where known, how far it may be off.

    Attributes
    ----------
    value : float or list of floats, SI.
    unit : SI unit.
    source : one of `SOURCES`.
    stderr : standard uncertainty in the same unit, None where nobody measured it.
    tolerance : relative, as a datasheet gives it: 0.3 means within a factor of 1.3 either way; None: not given.
    """

    value: Any
    unit: str
    source: str
    stderr: Any = None
    tolerance: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """The leaf as it stands in a file."""
        leaf: dict[str, Any] = {"value": self.value, "unit": self.unit, "source": self.source}
        for name in ("stderr", "tolerance"):
            if getattr(self, name) is not None:
                leaf[name] = getattr(self, name)
        return leaf


def quantity_from(leaf: Mapping[str, Any], spec: Spec, place: str) -> Quantity:
    """`Quantity` of a file's leaf ``{value, unit, source, stderr?, tolerance?}``, checked against its spec.

    Raises
    ------
    InputError : an unknown key, another unit than the spec's, an unknown source, a value out of range.
    """
    unknown = set(leaf) - set(KEYS)
    if unknown:
        raise InputError(place, sorted(unknown, key=str)[0], "only " + ", ".join(KEYS))
    if leaf.get("unit") != spec.unit:
        raise InputError(f"{place}: unit", leaf.get("unit"), repr(spec.unit))
    if leaf.get("source") not in SOURCES:
        raise InputError(f"{place}: source", leaf.get("source"), "one of " + ", ".join(SOURCES))
    value = spec.check(leaf.get("value"), place)
    for name, unit in (("stderr", spec.unit), ("tolerance", "1")):
        spread = leaf.get(name)
        for size in spread if isinstance(spread, (list, tuple)) else [spread]:
            if size is not None and not (as_number(size) or 0.0) >= 0.0:
                raise InputError(f"{place}: {name}", size, f"a number >= 0 in {unit}")
    return Quantity(value, spec.unit, leaf["source"], leaf.get("stderr"), leaf.get("tolerance"))
