"""The laws by name and number, and the one compiled door to all of them.

A new law is one file (``TITLE``, ``Parameters``, ``state_size``, ``stretch``, ``stored_energy``), one
line in ``LAWS`` and its line in :func:`stretch_law`. Motion is prescribed: velocity in, force out.

>>> law = law_named("dahl")
>>> packed = law.pack({"stiffness": 1e6, "static": 0.9})
>>> state = law.initial_state(packed)
>>> force = advance_law(law.number, packed, state, 0.0, 1e-3, 1e-4, 1.0)
"""

import dataclasses
import inspect
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
from microstage_ros.model.friction.curve import SlidingCurve, viscous_force
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.errors import InputError

CURVE_KEYS = tuple(field.name for field in dataclasses.fields(SlidingCurve))
NEGATIVE = "_negative"  # suffix of a curve parameter that holds for motion in the negative direction only


@dataclasses.dataclass(frozen=True)
class Law:
    """A friction law of the library: its name in files, its number in compiled code, its file."""

    name: str
    number: int
    file: types.ModuleType

    @property
    def title(self):
        """Short name for tables."""
        return self.file.TITLE

    def keys(self):
        """Names of the parameters that :meth:`pack` takes."""
        return (*self.file.Parameters.__dataclass_fields__, *CURVE_KEYS, *(key + NEGATIVE for key in CURVE_KEYS))

    def pack(self, values):
        """Flat float64 array of a parameter mapping, shape (10 + own,).

        ``values`` holds the keys of :class:`SlidingCurve` (``static`` is required; with the suffix
        ``_negative`` for motion in the negative direction, where that differs) and those of the law's
        own ``Parameters``. Raises InputError naming an unknown, missing or bad one.
        """
        for key in values:
            if key not in self.keys():
                raise InputError(f"{self.name}.{key}", values[key], f"one of {', '.join(self.keys())}")
        if "static" not in values:
            raise InputError(f"{self.name}.static", None, "the limit at the start of sliding, > 0")
        positive = {key: values[key] for key in CURVE_KEYS if key in values}
        negative = {key: values.get(key + NEGATIVE, positive.get(key)) for key in CURVE_KEYS}
        negative = {key: value for key, value in negative.items() if value is not None}
        own = {key: values[key] for key in self.file.Parameters.__dataclass_fields__ if key in values}
        try:
            entries = SlidingCurve(**positive).pack() + SlidingCurve(**negative).pack()
            return numpy.array(entries + list(self.file.Parameters(**own).pack()))
        except TypeError as error:
            needed = inspect.signature(self.file.Parameters)
            raise InputError(self.name, sorted(own), f"the parameters {needed}") from error
        except InputError as error:
            raise InputError(f"{self.name}.{error.place}", error.value, error.expected) from None

    def initial_state(self, packed):
        """State of a contact that has never been loaded: zeros, shape (state size,)."""
        return numpy.zeros(self.state_size(packed))

    def state_size(self, packed):
        """Entries of the state that goes with a packed law."""
        return int(self.file.state_size(packed))

    def stored_energy(self, packed, state):
        """Elastic energy that the state holds [F q]."""
        return self.file.stored_energy(packed, state)


LAWS = tuple(
    Law(file.__name__.rpartition(".")[2], number, file)
    for number, file in enumerate(
        (
            coulomb_viscous_stribeck,
            dahl,
            lugre,
            elasto_plastic,
            leuven,
            hsieh_pan,
            maxwell_slip,
            generalised_maxwell_slip,
        )
    )
)
NAMES = tuple(law.name for law in LAWS)


def law_named(name):
    """The law of that name; InputError lists the names there are."""
    for law in LAWS:
        if law.name == name:
            return law
    raise InputError("law", name, f"one of {', '.join(NAMES)}")


@compiled
def stretch_law(law, parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    """Carry ``state`` over a stretch of motion in one direction; force without its viscous part [F].

    ``law`` is a number of ``LAWS``; ``direction`` −1, 0 (at rest) or 1; the speeds are >= 0 [q/s] and
    linear in time over ``duration`` [s].
    """
    if law == 0:
        return coulomb_viscous_stribeck.stretch(
            parameters, state, direction, speed_start, speed_end, duration, limit_factor
        )
    if law == 1:
        return dahl.stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor)
    if law == 2:
        return lugre.stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor)
    if law == 3:
        return elasto_plastic.stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor)
    if law == 4:
        return leuven.stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor)
    if law == 5:
        return hsieh_pan.stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor)
    if law == 6:
        return maxwell_slip.stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor)
    return generalised_maxwell_slip.stretch(
        parameters, state, direction, speed_start, speed_end, duration, limit_factor
    )


@compiled
def advance_law(law, parameters, state, velocity_start, velocity_end, duration, limit_factor):
    """Carry ``state`` over a step with velocity linear in time; friction at its end [F].

    Parameters
    ----------
    law : number of the law, see ``LAWS``.
    parameters, state : arrays from :meth:`Law.pack` and :meth:`Law.initial_state`; state is changed.
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
    law : :class:`Law`.
    packed : from :meth:`Law.pack`.
    velocity : (n,) [q/s], one sample every ``duration`` [s].
    limit_factor : scalar or (n,) [1].
    state : changed; None begins with a contact that has never been loaded.

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
