"""What a command answers to a program: with ``--json`` one JSON object on standard output, whatever happens.

A command announces its facts (SI, plain data) once it has them; the text that it prints for people goes to standard
error as soon as ``--json`` is given, so that standard output holds the object alone:

    answer.state(moves=[{"target_m": 1e-5, "reached": True}])

gives ``{"command": "move", "status": 0, "version": "0.1.0", "moves": [...]}``; bad input gives ``"status": 2`` and
``"error": {"place": ..., "value": ..., "expected": ..., "says": ...}`` beside the one line on standard error.
"""

import json
import math
import sys

from microstage_ros import __version__

_facts: dict = {}
_stdout = None


def begin():
    """Forget the facts of an earlier command."""
    global _stdout
    _facts.clear()
    _stdout = None


def want():
    """``--json`` was given: from now on standard output is for the object alone."""
    global _stdout
    if _stdout is None:
        _stdout, sys.stdout = sys.stdout, sys.stderr


def wanted():
    """True once ``--json`` was given."""
    return _stdout is not None


def state(**facts):
    """Announce facts of the answer: plain data or numpy numbers, SI units in the names."""
    _facts.update(facts)


def facts():
    """What was announced so far, as JSON has it."""
    return plain(_facts)


def finish(command, status):
    """Print the object, if it is wanted, and give standard output back; ``status``: exit status of ``command`` [1]."""
    global _stdout
    if _stdout is None:
        return
    out, _stdout = _stdout, None
    sys.stdout = out
    print(
        json.dumps(plain({"command": command, "status": status, "version": __version__, **_facts}), ensure_ascii=False),
        file=out,
        flush=True,
    )


def plain(value):
    """Data that JSON can hold: numpy numbers as Python's, numbers that are not finite as null, the rest as text.

    ``value``: of any kind [any unit]; arrays become lists of lists.
    """
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if value is None or isinstance(value, (bool, int, str)):
        return value
    value = value.tolist() if hasattr(value, "tolist") else value  # numpy's numbers and arrays
    if isinstance(value, list):
        return plain(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, (bool, int)) else str(value)
