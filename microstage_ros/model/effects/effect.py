"""What an effect is: an id, its parameters, and how it enters the plant record."""

import math

from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec, check_all

INF = math.inf
CONTACTS = ("actuator", "guideway")
#: What an effect may need: a test of the record it acts on (a plant, or a contact of it), and the words for it.
MOTOR = (lambda plant: not plant["force_drive"], "a voltage-driven motor (drive.type)")
DRIVE_TRAIN = (lambda plant: not plant["rigid"], "a transmission that is not rigid (transmission.type)")
FRICTION = (lambda contact: contact["blocks"] or contact["law"], "a contact with friction")
BLOCKS = (lambda contact: contact["blocks"] and not contact["stick_damping"], "a contact with pre-sliding blocks (of the Maxwell-slip family)")
STRIBECK = (lambda contact: contact["blocks"] and contact["drops"], "a contact of blocks with a Stribeck curve")


def Parameter(unit, meaning, default=None, minimum=-INF, maximum=INF):  # noqa: N802  (reads as the table that it makes)
    """`Spec` of one parameter of an effect: a number, or a list of numbers; ``default`` None means required."""
    return Spec(unit, minimum, maximum, meaning, default, or_list=True)


class Effect:
    """Base of all effects. Subclasses set ``id``, ``parameters`` and ``apply``.

    ``on_contact`` effects take a ``contact`` (actuator, the default, or guideway) as well. ``needs``: what the machine,
    or that contact, must have for the effect to show at all (None: nothing).
    """

    id = ""
    parameters: dict = {}
    on_contact = False
    needs: tuple | None = None

    @classmethod
    def check(cls, given, place):
        """Parameters with defaults filled in; InputError names the bad one."""
        checked = check_all(cls.parameters, given, place, ["contact"] if cls.on_contact else [])
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
