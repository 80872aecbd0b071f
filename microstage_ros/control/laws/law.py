"""What a control law says of itself in its own file; the registry, the records, the axis files and the help follow from
it."""

from collections.abc import Callable
from typing import Any, NamedTuple


class Part(NamedTuple):
    """A piece that laws are made of, such as the PID: what it is given, and what it remembers.

    Attributes
    ----------
    gains : tuple of `control.gains.Gain` that a user may set.
    parameters : numpy type of the numbers that do not change while the law runs; None without such.
    state : list of fields that it remembers from one period to the next; None without such.
    """

    gains: tuple = ()
    parameters: Any = None
    state: Any = None


class ControlLaw(NamedTuple):
    """A control law; a file lists its own as ``LAWS``.

    Attributes
    ----------
    name : word in axis files, run files and ROS parameters.
    parts : {name in the records: `Part`}. Every law has the part ``pid`` in its state, for what is published of it.
    step : compiled function (parameters, state, reference [m], encoder [m], current [A]) → command, within its limit.
    reset : compiled function (parameters, state, command) beyond the PID's own reset; None: nothing.
    start : compiled function (parameters, state, reference [m], encoder [m]) of the first period, beyond the PID's;
    None: nothing. rules : function (feed-forward model, period [s]) → gains from the axis's own numbers; None: the
    defaults. complete : function (record) that fills what follows from gains and model; None: nothing.
    loop : its linear form for margins: ``pid``, ``observer``, or "" where it has none.
    """

    name: str
    parts: dict
    step: Any
    reset: Any = None
    start: Any = None
    rules: Callable[[Any, float], dict] | None = None
    complete: Callable[[Any], None] | None = None
    loop: str = ""
