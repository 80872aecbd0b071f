"""Records that are given twice on the command line."""

import pathlib

from microstage_ros.diagnosis.fleet import is_address
from microstage_ros.quantities.errors import InputError

TWICE = "every record once: each counts as a repeat of its own, and repeats tell how far a result can be trusted"
DIFFERENT = "records to learn from, to judge on and of the healthy axis that are different ones"


def refuse_given_twice(**options):
    """Raise InputError for a record that is given twice.

    Twice for one option, it would count as two repeats; for two options, a cause would be judged on what taught it, or
    the thresholds would come from an axis that has it.

    Parameters
    ----------
    options : name of the option without its hyphens ("RECORD": the words without one) to its files.
    """
    place = {}
    for name, paths in options.items():
        option = name if name.isupper() else f"--{name}"
        for path in paths:
            file = path if is_address(path) else pathlib.Path(path).resolve()
            if file not in place:
                place[file] = option
            elif place[file] == option:
                raise InputError(f"{option} {path}", "a record that is given twice", TWICE)
            else:
                raise InputError(f"{option} {path}", f"a record that is given as {place[file]} too", DIFFERENT)
