"""What an effect is: an id, its parameters, and how it enters the plant record."""

import math
from dataclasses import dataclass

from microstage_ros.quantities.errors import InputError

INF = math.inf
CONTACTS = ("actuator", "guideway")
#: What an effect may need: a test of the record it acts on (a plant, or a contact of it), and the words for it.
MOTOR = (lambda plant: not plant["force_drive"], "a voltage-driven motor (drive.type)")
DRIVE_TRAIN = (lambda plant: not plant["rigid"], "a transmission that is not rigid (transmission.type)")
FRICTION = (lambda contact: contact["blocks"] or contact["law"], "a contact with friction")
BLOCKS = (lambda contact: contact["blocks"] and not contact["stick_damping"], "a contact with pre-sliding blocks (of the Maxwell-slip family)")
STRIBECK = (lambda contact: contact["blocks"] and contact["drops"], "a contact of blocks with a Stribeck curve")


@dataclass(frozen=True)
class Parameter:
    """One parameter: unit, meaning, closed range; ``default`` None means required. Scalar or list."""

    unit: str
    meaning: str
    default: object = None
    minimum: float = -INF
    maximum: float = INF

    def check(self, value, place):
        """The value as float (or list of floats), or InputError."""
        values = value if isinstance(value, (list, tuple)) else [value]
        for v in values:
            good = isinstance(v, (int, float)) and not isinstance(v, bool) and math.isfinite(v)
            if not (good and self.minimum <= v <= self.maximum):
                raise InputError(place, v, f"{self.minimum:g} … {self.maximum:g} {self.unit} ({self.meaning})")
        return [float(v) for v in values] if isinstance(value, (list, tuple)) else float(value)


class Effect:
    """Base of all effects. Subclasses set ``id``, ``parameters`` and ``apply``.

    ``on_contact`` effects take a ``contact`` (actuator, the default, or guideway) as well. ``needs``: what the machine,
    or that contact, must have for the effect to show at all (None: nothing).
    """

    id = ""
    parameters = {}
    on_contact = False
    needs = None

    @classmethod
    def check(cls, given, place):
        """Parameters with defaults filled in; InputError names the bad one."""
        if not isinstance(given, dict):
            raise InputError(place, given, "a mapping of parameters")
        allowed = [*cls.parameters, *(["contact"] if cls.on_contact else [])]
        for name in given:
            if name not in allowed:
                raise InputError(f"{place}.{name}", "unknown parameter", "one of " + ", ".join(allowed))
        checked = {}
        for name, spec in cls.parameters.items():
            value = given.get(name, spec.default)
            if value is None:
                raise InputError(f"{place}.{name}", None, f"a value in {spec.unit} ({spec.meaning})")
            checked[name] = spec.check(value, f"{place}.{name}")
        if cls.on_contact:
            checked["contact"] = given.get("contact", "actuator")
            if checked["contact"] not in CONTACTS:
                raise InputError(f"{place}.contact", checked["contact"], "one of " + ", ".join(CONTACTS))
        cls.check_together(checked, place)
        return checked

    @classmethod
    def check_together(cls, checked, place):
        """Conditions between parameters; most effects have none."""

    @classmethod
    def check_machine(cls, plant, p):
        """InputError if the plant record lacks what the effect acts on."""
        if cls.needs is None:
            return
        has, words = cls.needs
        if not has(plant[p["contact"]] if cls.on_contact else plant):
            place = f"effects: {cls.id}"
            raise InputError(f"{place}.contact" if cls.on_contact else place, p["contact"] if cls.on_contact else p, words)

    @classmethod
    def apply(cls, plant, p):
        """Write the checked parameters ``p`` into the plant record."""
        raise NotImplementedError


def same_length(checked, names, place):
    """InputError unless the named parameters are lists (or scalars) of one length."""
    lengths = {name: len(as_list(checked[name])) for name in names}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{place}.{names[-1]}", lengths[names[-1]], f"as many numbers as {names[0]} has ({lengths[names[0]]})")


def as_list(value):
    """A scalar as a list of one."""
    return list(value) if isinstance(value, (list, tuple)) else [value]


def write_terms(record, names, count_name, columns, most, place):
    """Write equally long lists into the fixed arrays of a record; InputError if there are too many."""
    columns = [as_list(column) for column in columns]
    count = len(columns[0])
    if count > most:
        raise InputError(place, count, f"at most {most} terms")
    for name, column in zip(names, columns):
        record[name][:count] = column
    record[count_name] = count
