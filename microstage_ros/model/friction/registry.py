"""The laws by name and number, and the one compiled door to all of them.

A new law is one file and its name in ``FILES``. The file holds ``TITLE``, ``PARAMETERS`` (specs at the screw angle),
``CURVE`` (which of the sliding curve's parameters it has), ``FAMILY``, ``pack``, ``state_size``, ``stretch`` and
``stored_energy``; where they apply, ``SAYS`` (what the paper says that it shows) and ``EXAMPLE`` (own parameters on the
paper's contact, where the paper gives none). Axis files, simulation, feed-forward, observer, diagnosis and the table of
laws know the law from there.
``FAMILY`` is ``blocks`` (Maxwell-slip blocks: the solver's own), ``rigid`` (a static map: the solver holds the body at
rest by a stiff bristle) or ``own`` (the solver carries the law's own step). Motion is prescribed: velocity in, force
out.

>>> law = law_named("dahl")
>>> packed = law.pack({"stiffness": 1e6, "static": 0.9})
>>> state = law.initial_state(packed)
>>> force = advance_law(law.number, packed, state, 0.0, 1e-3, 1e-4, 1.0)
"""

import dataclasses
import types

import numpy

from microstage_ros.model.friction import (
    coulomb_viscous_stribeck,
    dahl,
    elasto_plastic,
    generalised_maxwell_slip,
    hsieh_pan,
    leuven,
    lugre,
    maxwell_slip,
)
from microstage_ros.model.friction.curve import SLIDING, pack_curve, viscous_force
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import check_all

FILES = (coulomb_viscous_stribeck, dahl, lugre, elasto_plastic, leuven, hsieh_pan, maxwell_slip,
         generalised_maxwell_slip)
CURVE_KEYS = tuple(SLIDING)
NEGATIVE = "_negative"  # suffix of a curve parameter that holds for motion in the negative direction only


@dataclasses.dataclass(frozen=True)
class FrictionLaw:
    """A friction law of the library: its name in files, its number in compiled code, its file."""

    name: str
    number: int
    file: types.ModuleType

    @property
    def title(self):
        """Short name for tables."""
        return self.file.TITLE

    @property
    def family(self):
        """How the solver carries it: ``blocks``, ``rigid`` or ``own``."""
        return self.file.FAMILY

    @property
    def section(self):
        """{name: `Spec`} of the law's part of an axis file, at the screw angle."""
        return {**self.file.PARAMETERS, **{name: SLIDING[name] for name in self.file.CURVE}}

    @property
    def own(self):
        """{name: `Spec`} of what `pack` takes beside the sliding curve."""
        return {**self.file.PARAMETERS, **getattr(self.file, "LIBRARY_ONLY", {})}

    def keys(self):
        """Names of the parameters that :meth:`pack` takes."""
        return (*self.own, *CURVE_KEYS, *(key + NEGATIVE for key in CURVE_KEYS))

    def pack(self, values):
        """Flat float64 array of a parameter mapping, shape (10 + own,).

        Parameters
        ----------
        values : {name: number or list, in the unit of its spec}: the keys of `curve.SLIDING` (``static`` is required;
            with the suffix ``_negative`` for motion in the negative direction, where that differs) and the law's own.
            Another force F and coordinate q than N m and rad are as good, if they are the same throughout.

        Raises
        ------
        InputError : a parameter that is unknown, missing or bad.
        """
        for key in values:
            if key not in self.keys():
                raise InputError(f"{self.name}.{key}", values[key], f"one of {', '.join(self.keys())}")
        positive = {key: values[key] for key in CURVE_KEYS if key in values}
        negative = {key: values.get(key + NEGATIVE, positive.get(key)) for key in CURVE_KEYS}
        own = {key: float(value) if isinstance(value, (bool, numpy.bool_)) else value
               for key, value in values.items() if key in self.own}
        try:
            entries = pack_curve(positive) + pack_curve(negative)
        except InputError as error:
            raise InputError(f"{self.name}.{error.place}", error.value, error.expected) from None
        checked = check_all(self.own, own, self.name)
        try:
            return numpy.array(entries + list(self.file.pack(checked)))
        except InputError as error:
            raise InputError(f"{self.name}.{error.place}", error.value, error.expected) from None

    def initial_state(self, packed):
        """State of a contact that has never been loaded: zeros, (state size,); ``packed``: from `pack`, (10 + own,)."""
        return numpy.zeros(self.state_size(packed))

    def state_size(self, packed):
        """Entries of the state that goes with a ``packed`` law (10 + own,)."""
        return int(self.file.state_size(packed))

    def stored_energy(self, packed, state):
        """Elastic energy that the ``state`` (state size,) holds [F q].

        ``packed``, in a law's file ``parameters``: as `pack` gives it, (10 + own,).
        """
        return self.file.stored_energy(packed, state)


LAWS = tuple(FrictionLaw(file.__name__.rpartition(".")[2], number, file) for number, file in enumerate(FILES))
NAMES = tuple(law.name for law in LAWS)
#: {name: {parameter: `Spec`}} of every law that an axis file may choose; ``none`` is a contact without friction.
SECTIONS: dict = {"none": {}}
for _law in LAWS:
    SECTIONS.update(getattr(_law.file, "BESIDE", {}))
    SECTIONS[_law.name] = _law.section


def law_named(name):
    """The law of that name; InputError lists the names there are."""
    for law in LAWS:
        if law.name == name:
            return law
    raise InputError("law", name, f"one of {', '.join(NAMES)}")


def _door(number, own, others):
    """Compiled choice between one law's step and those of the laws behind it."""
    @compiled(cache=False, forceinline=True)     # what calls it is cached, and holds it
    def stretch(law, parameters, state, direction, speed_start, speed_end, duration, limit_factor):
        if law == number:
            return own(parameters, state, direction, speed_start, speed_end, duration, limit_factor)
        return others(law, parameters, state, direction, speed_start, speed_end, duration, limit_factor)

    return stretch


@compiled
def _no_such_law(law, parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    return numpy.nan


stretch_law = _no_such_law
for _law in reversed(LAWS):
    stretch_law = _door(_law.number, _law.file.stretch, stretch_law)
"""``stretch_law(law, parameters, state, direction, speed_start, speed_end, duration, limit_factor)`` → force [F].

Carries ``state`` over a stretch of motion in one direction; the force is without its viscous part. ``law`` is a number
of ``LAWS``; ``direction`` −1, 0 (at rest) or 1; the speeds are >= 0 [q/s] and linear in time over ``duration`` [s].
"""


@compiled
def advance_law(law, parameters, state, velocity_start, velocity_end, duration, limit_factor):
    """Carry ``state`` over a step with velocity linear in time; friction at its end [F].

    Parameters
    ----------
    law : number of the law, see ``LAWS``.
    parameters, state : arrays from :meth:`FrictionLaw.pack` and :meth:`FrictionLaw.initial_state`; state is changed.
    velocity_start, velocity_end : [q/s]; the step is split where the velocity changes sign.
    duration : [s], >= 0.
    limit_factor : multiplies the friction limits over this step [1], > 0.
    """
    at_end = velocity_end
    if velocity_start * velocity_end < 0.0:
        to_zero = duration * velocity_start / (velocity_start - velocity_end)
        sign = 1.0 if velocity_start > 0.0 else -1.0
        stretch_law(law, parameters, state, sign, abs(velocity_start), 0.0, to_zero, limit_factor)
        velocity_start, duration = 0.0, duration - to_zero
    direction = float(numpy.sign(velocity_start + velocity_end))
    force = stretch_law(
        law, parameters, state, direction, abs(velocity_start), abs(velocity_end), duration, limit_factor
    )
    return force + viscous_force(parameters, at_end)


@compiled
def run_steps(law, parameters, state, velocity, duration, limit_factor, force):
    """:func:`advance_law` over all samples of ``velocity`` (n,), into ``force`` (n,).

    ``force[0]`` answers ``velocity[0]`` with the state as given; step i − 1 → i takes ``limit_factor[i]``.
    """
    force[0] = advance_law(law, parameters, state, velocity[0], velocity[0], 0.0, limit_factor[0])
    for i in range(1, velocity.size):
        force[i] = advance_law(law, parameters, state, velocity[i - 1], velocity[i], duration, limit_factor[i])


def run_law(law, packed, velocity, duration, limit_factor=1.0, state=None):
    """Friction along a prescribed velocity, linear between its samples.

    Parameters
    ----------
    law : :class:`FrictionLaw`.
    packed : from :meth:`FrictionLaw.pack`, (10 + own,).
    velocity : (n,) [q/s], one sample every ``duration`` [s].
    limit_factor : scalar or (n,) [1].
    state : (state size,), changed; None begins with a contact that has never been loaded.

    Returns
    -------
    force (n,) [F].

    Raises
    ------
    InputError : for a velocity that is not finite.
    """
    velocity = numpy.ascontiguousarray(velocity, float)
    if velocity.ndim != 1 or velocity.size == 0 or not numpy.isfinite(velocity).all():
        raise InputError("velocity", velocity.shape, "a one-dimensional array of finite numbers, at least one")
    factor = numpy.ascontiguousarray(numpy.broadcast_to(numpy.asarray(limit_factor, float), velocity.shape))
    force = numpy.empty_like(velocity)
    state = law.initial_state(packed) if state is None else state
    run_steps(law.number, packed, state, velocity, float(duration), factor, force)
    return force
