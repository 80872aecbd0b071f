"""What a number in a file may be: unit, closed range, meaning, default; and the one check of it.

Axis files, effects, gains, run files and node parameters all describe their numbers by a `Spec`. The check, the text of
its refusal and the tables of the documentation are made from it, here and nowhere else.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from microstage_ros.quantities.errors import InputError

INF = math.inf
LEAST, MOST = 1e-15, 1e15
"""Smallest and largest positive number [SI] of what has no range of its own: no quantity of a machine is beyond, and
products and quotients of several stay far from where floats end."""


@dataclass(frozen=True)
class Spec:
    """One number (or list of numbers) of a file.

    Attributes
    ----------
    unit : SI unit, ``"1"`` for a ratio.
    minimum, maximum : closed range.
    meaning : one line for people.
    default : value where none is given; None: it has to be given.
    is_list : a list of numbers is expected.
    or_list : a number or a list of numbers is expected.
    """

    unit: str
    minimum: float
    maximum: float
    meaning: str
    default: object = None
    is_list: bool = False
    or_list: bool = False

    @property
    def expected(self) -> str:
        """What a refusal says would be right."""
        if self.maximum == INF and self.minimum in (LEAST, 0.0, -INF):
            size = {LEAST: "a finite number > 0", 0.0: "a finite number >= 0", -INF: "a finite number"}[self.minimum]
            return f"{size} in {self.unit} ({self.meaning})"
        return f"{self.minimum:g} … {self.maximum:g} {self.unit} ({self.meaning})"

    def check(self, value: Any, place: str) -> Any:
        """The value as float, or as list of floats.

        Words that are numbers count: YAML 1.1 reads 4e5, without a point, as a word.

        Raises
        ------
        InputError : it is no number, not finite or out of range; the place, the value and the range are reported.
        """
        if self.is_list or (self.or_list and isinstance(value, (list, tuple))):
            if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Iterable):
                raise InputError(place, value, f"a list of numbers in {self.unit}")
            return [self._one(entry, place, value) for entry in value]
        return self._one(value, place, value)

    def _one(self, value: Any, place: str, whole: Any) -> float:
        number = as_number(value)
        if number is None:
            raise InputError(place, whole, f"{'a list of numbers' if self.is_list else 'a number'}, {self.expected}")
        if self.minimum == LEAST and 0.0 < number < LEAST:
            raise InputError(place, value, f"{self.expected}, and at least {LEAST:g}")
        if not self.minimum <= number <= self.maximum or not math.isfinite(number):
            raise InputError(place, value, self.expected)
        if self.maximum == INF and abs(number) > MOST:
            raise InputError(place, value, f"{self.expected}, and at most {MOST:g}")
        return number

    def scaled(self, unit: str) -> Spec:
        """The same number in another unit of the same size (a torque at the screw, a force at the stage)."""
        return Spec(unit, self.minimum, self.maximum, self.meaning, self.default, self.is_list, self.or_list)


def positive(unit: str, meaning: str, **more: Any) -> Spec:
    """Spec of a number > 0."""
    return Spec(unit, LEAST, INF, meaning, **more)


def not_negative(unit: str, meaning: str, **more: Any) -> Spec:
    """Spec of a number >= 0."""
    return Spec(unit, 0.0, INF, meaning, **more)


def any_number(unit: str, meaning: str, **more: Any) -> Spec:
    """Spec of any finite number."""
    return Spec(unit, -INF, INF, meaning, **more)


def as_number(value: Any) -> float | None:
    """The value as float [its own unit]; None for what is no real number (a truth value, a word, None, a list).

    A whole number that no float holds is infinite, as 1e400 is.
    """
    if isinstance(value, bool) or not isinstance(value, (numbers.Real, str)):
        return None
    try:
        return float(value)
    except ValueError:
        return None
    except OverflowError:
        return -math.inf if not isinstance(value, str) and value < 0 else math.inf


def check_all(specs: Mapping[str, Spec], given: Any, place: str, also: Iterable[str] = ()) -> dict[str, Any]:
    """Check a section ``{name: value}`` against its specs and fill in defaults.

    Parameters
    ----------
    specs : {name: `Spec`}.
    given : the section as it was read.
    place : of the section, for the refusal.
    also : names that are allowed beside those of ``specs``; they are not checked and not returned.

    Returns
    -------
    {name: value} of all specs.

    Raises
    ------
    InputError : no mapping, an unknown name, a missing value, a bad value.
    """
    if not isinstance(given, Mapping):
        raise InputError(place, given, "a mapping of parameters")
    allowed = [*specs, *also]
    for name in given:
        if name not in allowed:
            raise InputError(f"{place}.{name}", "unknown parameter", "one of " + ", ".join(allowed))
    checked = {}
    for name, spec in specs.items():
        value = given.get(name, spec.default)
        if value is None:
            raise InputError(f"{place}.{name}", None, f"a value in {spec.unit} ({spec.meaning})")
        checked[name] = spec.check(value, f"{place}.{name}")
    return checked
