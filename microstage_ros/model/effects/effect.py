"""What an effect is: an id, its parameters, and how it enters the plant record."""

import math

from microstage_ros.model.sensors import position_sensor_of
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import Spec, check_all

INF = math.inf
CONTACTS = ("actuator", "guideway")
#: What an effect may need: a test of the record it acts on (a plant, or a contact of it), and the words for it.
MOTOR = (
    lambda plant: plant["winding"],
    "a drive whose winding the command drives, such as a voltage-driven motor (drive.type)",
)
DRIVE_TRAIN = (lambda plant: not plant["rigid"], "a transmission that is not rigid (transmission.type)")
FRICTION = (lambda contact: contact["blocks"] or contact["law"], "a contact with friction")
BLOCKS = (
    lambda contact: contact["blocks"] and not contact["stick_damping"],
    "a contact with pre-sliding blocks (of the Maxwell-slip family)",
)
STRIBECK = (lambda contact: contact["blocks"] and contact["drops"], "a contact of blocks with a Stribeck curve")


def Parameter(unit, meaning, default=None, minimum=-INF, maximum=INF):  # noqa: N802  (reads as the table that it makes)
    """`Spec` of one parameter of an effect: a number, or a list of numbers.

    ``default``, ``minimum``, ``maximum``: in ``unit``; ``default`` None means required.
    """
    return Spec(unit, minimum, maximum, meaning, default, or_list=True)


class Effect:
    """Base of all effects: one class holds all that is known of one effect.

    Attributes
    ----------
    id : the word for it in files, reports and tests.
    label : what a technician calls it. remedy : what one does about it.
    parameters : {name: `Parameter`} of its section in an axis file or a run file.
    on_contact : it takes a ``contact`` (actuator, the default, or guideway) as well.
    needs : what the machine, or that contact, must have for the effect to show at all; None: nothing.
    separated_by : what has to vary in a record that tells it from its rivals: ``frequency``, ``dwell``, ``speed``,
        ``rest`` or ``stroke`` (`diagnosis.report.experiment`); None: no such record is known.
    shows_against : coordinate of the picture that shows it: ``position``, ``velocity``, ``time``, ``signal period``
        or ``motor turns``.
    forms : how it shows in the residual channels, each a `signature.Form`, where `diagnosis.catalogue` has none for it.
    within : nameless shapes (``generic:…``) that hold it: what they explain beyond it is not this effect.
    contained_in : wider effects that contain it and so always fit as well: no rivals of it.
    drives, sensors : types of drives and of position sensors that it is of; empty: any.
    force : compiled ``force(parameters, x, v, t)`` → N on the stage, or None. ``parameters`` are the values in the
    order of
        `parameters` (at most `plant_record.EXTRA`), x [m], v [m/s], t [s]: a force of its own on the stage needs no
        other line in the solver.
    """

    id = ""
    label = ""
    remedy = ""
    separated_by: str | None = None
    shows_against = "position"
    forms: tuple = ()
    within: tuple = ()
    contained_in: tuple = ()
    force = None
    drives: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
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
        """InputError if the plant record lacks what the effect with parameters ``p`` (as for `apply`, SI) acts on."""
        if cls.needs is None:
            return
        has, words = cls.needs
        if not has(plant[p["contact"]] if cls.on_contact else plant):
            place = f"effects: {cls.id}"
            raise InputError(
                f"{place}.contact" if cls.on_contact else place, p["contact"] if cls.on_contact else p, words
            )

    @classmethod
    def resimulated(cls, axis, parts):
        """Forms as `resimulated.Candidate` where records are judged by re-simulation; ``parts``: what was measured."""
        return ()

    @classmethod
    def acts_on(cls, axis):
        """Whether the axis has a drive and a position sensor of the kinds that the effect is of."""
        return ((not cls.drives or axis.choices["drive.type"] in cls.drives)
                and (not cls.sensors or position_sensor_of(axis).name in cls.sensors))

    @classmethod
    def draw(cls, generator, strength):
        """Parameters of a random size, scaled by ``strength`` [1]: clearly visible at 1.

        May be a function ``after(columns, generator)`` that changes a record's columns instead, where the effect takes
        a course that no parameters hold. ``generator``: `numpy.random.Generator`.
        """
        raise NotImplementedError

    @classmethod
    def apply(cls, plant, p):
        """Write the effect into the plant record; with a `force` there is nothing else to do.

        ``p``: the checked parameters {name: number or list, in the unit of its `Parameter`}.
        """
        if cls.force is None:
            raise NotImplementedError


def same_length(checked, names, place):
    """InputError unless the named parameters are lists (or scalars) of one length."""
    lengths = {name: len(as_list(checked[name])) for name in names}
    if len(set(lengths.values())) > 1:
        raise InputError(
            f"{place}.{names[-1]}", lengths[names[-1]], f"as many numbers as {names[0]} has ({lengths[names[0]]})"
        )


def as_list(value):
    """A ``value`` [any unit] as a list of one; a list or tuple as a list."""
    return list(value) if isinstance(value, (list, tuple)) else [value]


def write_terms(record, names, count_name, columns, most, place):
    """Write equally long lists into the fixed arrays of a record; InputError if there are too many terms.

    ``columns``: for each of ``names`` a number or its list of shape (n,); n is at most ``most`` [1].
    """
    columns = [as_list(column) for column in columns]
    count = len(columns[0])
    if count > most:
        raise InputError(place, count, f"at most {most} terms")
    for name, column in zip(names, columns):
        record[name][:count] = column
    record[count_name] = count
