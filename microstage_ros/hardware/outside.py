"""A backend that is not of this project: its class is checked, and what it gives and raises is brought into form."""

import math
import numbers
from functools import partial

from microstage_ros.hardware.protocol import INSTRUMENTS, SAFETY, HardwareError, Reading
from microstage_ros.quantities.errors import InputError

CALLS = ("open", "read", "write", "close")


class OutsideBackend:
    """A backend from outside, behind the members of `protocol.Hardware`.

    Only the five members are used, and `truth` of a simulated one that has it. A reading may be a `Reading`, a sequence
    of encoder [m], current [A], motor angle [rad] of which the last may be left out, or the encoder's number alone;
    ``None`` stands for a sensor that is not there. Any exception becomes a `HardwareError` with its text.

    Parameters
    ----------
    name : as the user gave it, for messages. kind : the class. setup : `protocol.Setup`.

    Raises
    ------
    InputError : not a class that can be made with one setup, or a member is missing.
    """

    def __init__(self, name, kind, setup):
        if not callable(kind):
            raise InputError("backend", name, "a class that is made with one Setup(axis, seed, options)")
        try:
            self._inner = kind(setup)
        except (InputError, HardwareError):
            raise
        except Exception as error:  # noqa: BLE001 - code from outside
            raise InputError("backend", name, f"a class that can be made with one Setup(axis, seed, options) "
                             f"({_words(error)})") from error
        missing = [call for call in CALLS if not callable(getattr(self._inner, call, None))]
        missing += ["simulated"] * (not isinstance(getattr(self._inner, "simulated", None), (bool, int)))
        if missing:
            raise InputError("backend", name, f"a class with the members simulated (True or False), open(), read(), "
                             f"write(voltage), close(); missing: {', '.join(missing)}")
        self.simulated = bool(self._inner.simulated)
        self.has_truth = self.simulated and hasattr(type(self._inner), "truth")

    def open(self):
        """Take hold of the device. Raises `HardwareError`."""
        self._call("open")

    def read(self):
        """`Reading` of this control period. Raises `HardwareError`."""
        try:
            found = self._inner.read()
        except HardwareError:
            raise
        except Exception as error:  # noqa: BLE001 - code from outside: whatever it raises, the voltage must go to zero
            raise HardwareError(f"read(): {_words(error)}") from error
        if type(found) is Reading and type(found[0]) is float and type(found[1]) is float and type(found[2]) is float:
            return found  # nothing to bring into form, as in most periods
        try:
            return as_reading(found)
        except (TypeError, ValueError):
            raise HardwareError(
                f"read() gave {found!r}, expected Reading(encoder, current, motor_angle) in m, A, rad"
            ) from None

    def write(self, voltage):
        """Hold ``voltage`` [V] from now on. Raises `HardwareError`."""
        try:
            self._inner.write(voltage)
        except HardwareError:
            raise
        except Exception as error:  # noqa: BLE001 - code from outside: whatever it raises, the voltage must go to zero
            raise HardwareError(f"write(): {_words(error)}") from error

    def close(self):
        """Voltage to zero, let go. Raises `HardwareError`."""
        self._call("close")

    @property
    def truth(self):
        """`Truth` of a simulated backend that offers it."""
        return self._inner.truth

    def __getattr__(self, name):
        """Optional members of `protocol` that the backend offers (never arrays: its own read and write are called)."""
        if name.startswith("_") or name in ("arrays", "own_arrays", "last_reading"):
            raise AttributeError(name)
        member = getattr(self._inner, name)
        if name not in (*SAFETY, *INSTRUMENTS) or not callable(member):
            return member
        return partial(self._checked, name) if name in FORMS else partial(self._call, name)

    def _checked(self, name):
        """What a member gives, brought into its form. Raises `HardwareError`."""
        found = self._call(name)
        form, words = FORMS[name]
        try:
            return form(found)
        except (TypeError, ValueError):
            raise HardwareError(f"{name}() gave {found!r}, expected {words}") from None

    def _call(self, name, *arguments):
        try:
            return getattr(self._inner, name)(*arguments)
        except HardwareError:
            raise
        except Exception as error:  # noqa: BLE001 - code from outside: whatever it raises, the voltage must go to zero
            raise HardwareError(f"{name}(): {_words(error)}") from error


def _two_switches(found):
    low, high = found
    return bool(low), bool(high)


FORMS = {"e_stop": (bool, "True while it is pressed"),
         "limit_switches": (_two_switches, "(lower, upper), True for the one that is actuated")}
"""Members whose answer is looked at in every period: the form it is brought into, and what was expected, in words."""


def as_reading(found):
    """`Reading` of what a backend gave. Raises TypeError or ValueError for anything else.

    ``found``: the position [m], an object with the fields of a `Reading`, or its numbers in order; None is NaN.
    """
    if isinstance(found, numbers.Real):
        return Reading(float(found))
    if hasattr(found, "encoder"):
        found = [getattr(found, name, None) for name in Reading._fields]
    values = [math.nan if value is None else float(value) for value in found]
    return Reading(*values[:len(Reading._fields)])


def _words(error):
    return f"{type(error).__name__}: {' '.join(str(error).split()) or 'no reason given'}"
