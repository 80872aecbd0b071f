"""What commissioning finds: checks, and the reason to end it."""

from dataclasses import asdict, dataclass

CHECKS = (
    "polarity",
    "current_polarity",
    "current_missing",
    "encoder_dead",
    "encoder_scale",
    "stuck",
    "end_stop",
    "runaway",
    "delay",
    "resonance",
)
"""Ids of the checks, in the order of the page."""


@dataclass(frozen=True)
class Check:
    """One check: ``id`` of `CHECKS`, whether it passed, the value it was judged by with its unit, one sentence."""

    id: str
    passed: bool
    value: float
    unit: str
    says: str

    def as_dict(self):
        """As it stands in report.json."""
        return asdict(self)


class Refused(Exception):
    """The machine is not fit to go on; ``check`` says what a person has to look at."""

    def __init__(self, check):
        super().__init__(check.says)
        self.check = check


def refused(name, value, unit, says):
    """`Refused` with a failed check, whose ``value`` is in ``unit``."""
    return Refused(Check(name, False, float(value), unit, says))


class Stopped(Exception):
    """Ended from outside the machine's behaviour: the hardware's own error, an interruption, the time limit."""
