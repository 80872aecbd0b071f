"""How a command reads its options and gives its answer; the pieces that every command shares.

A command is one file with ``main(argv) -> status``:

    def main(argv=None):
        parser = Parser(prog="microstage approach", description="Moves close to a place.")
        parser.add_argument("--to", type=units.target, metavar="PLACE")     # 10um, -1e-6, +50nm: `commands.units`
        parser.add_argument("--out", required=True, metavar="DIR")
        parser.add_force()                                                    # --force
        arguments = parser.parse_args(argv)                                   # --json is there by itself
        keep_earlier("--out", [f"{arguments.out}/report.json"], arguments.force)
        with progress("approaching", total=10) as bar:                        # terminal only: `commands.progress`
            ...; bar.advance()
        with complete_folder(arguments.out) as folder:                        # `microstage_ros.files`: all or nothing
            (folder / "report.json").write_text(...)
        answer.state(reached=True, error_m=3e-9)                              # for --json: `commands.answer`
        print("reached, 3 nm off")                                            # for people
        return 0

- ``files.unreadable`` and ``files.missing`` give "file not found" with the nearest name; ``files.complete_file`` and
  ``files.write_text`` write beside and rename.
- Bad input raises `quantities.errors.InputError`: one line, status 2. Ctrl-C ends with status 1 and leaves no file
  half-written. A mistyped command, option or choice is answered with the nearest right one.
- ``commands/__init__.py`` lists the commands; help, shell completion and ``ros2 run`` are made from that list.
"""

import argparse
import difflib
import math
import re
import sys

from microstage_ros.commands import answer
from microstage_ros.commands.units import LENGTHS, SPEEDS, TIMES, VOLTAGES
from microstage_ros.files import keep_earlier
from microstage_ros.quantities.errors import InputError

PLACES = ("BAG", "DIR", "FILE", "JSON", "LOG.yaml", "NOW", "RECORD", "SKETCH")
"""How the help calls values that name a file or folder."""

_UNITS = sorted({*LENGTHS, *SPEEDS, *TIMES, *VOLTAGES}, key=len, reverse=True)
NEGATIVE = re.compile(rf"-(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*({'|'.join(map(re.escape, _UNITS))})?")
"""A negative number, perhaps with a unit: a value, not an option."""


class Described(Exception):
    """Raised in place of parsing while only the options of a command are asked for; holds its parser."""

    def __init__(self, parser):
        super().__init__(parser.prog)
        self.parser = parser


_describing = False


class Parser(argparse.ArgumentParser):
    """An `argparse.ArgumentParser` for people.

    A usage error is one line with the nearest right word, and status 2, and so is a seed below 0 or a number that is
    not finite; negative numbers with exponents and units
    (``--to -1e-6``, ``--to -50nm``) are values; every command has ``--json``.

    Parameters
    ----------
    json : "flag": ``--json`` prints the answer as JSON; "file": ``--json [FILE]``, the command writes FILE itself where
        one is given; None: the command has no such option.
    options : of `argparse.ArgumentParser`.
    """

    def __init__(self, json="flag", **options):
        super().__init__(conflict_handler="resolve", **options)  # a command may have a --json of its own
        self._given = []
        if json == "flag":
            self.add_argument(
                "--json", action="store_true", help="print the answer as one JSON object (text goes to standard error)"
            )
        elif json == "file":
            self.add_argument(
                "--json",
                nargs="?",
                const=True,
                metavar="FILE",
                help="write the answer as JSON to FILE; without FILE print it (text goes to standard error)",
            )
            self.add_force()

    def add_force(self):
        """Add ``--force``: replace earlier results."""
        self.add_argument("--force", action="store_true", help="replace the results of an earlier run")

    def parse_known_args(self, args=None, namespace=None):
        """As in argparse; negative numbers are values. Raises `Described` while options are only asked for."""
        if _describing:
            raise Described(self)
        self._given = list(sys.argv[1:] if args is None else args)
        protected = [f" {word}" if NEGATIVE.fullmatch(word) else word for word in self._given]
        found, unknown = super().parse_known_args(protected, namespace)
        if getattr(found, "json", None) is True:
            answer.want()
        self._refuse_values(found)
        if isinstance(getattr(found, "json", None), str) and not getattr(found, "resume", False):
            keep_earlier("--json", [found.json], getattr(found, "force", True))
        return found, unknown

    def _refuse_values(self, found):
        """Raise InputError for a seed below 0, a number that is not finite, and a place without a name (an unset
        variable of a shell script), unless it is the default."""
        for action in self._actions:
            value, option = getattr(found, action.dest, None), (action.option_strings or [action.dest])[0]
            if option == "--seed" and isinstance(value, int) and value < 0:
                raise InputError(option, value, "a whole number from 0")
            several = value if isinstance(value, list) else [value]
            if action.metavar in PLACES and value != action.default and "" in several:
                raise InputError(option, "", "the name of a file or folder")
            if action.type is float and value is not action.default:
                for one in several:
                    if isinstance(one, float) and not math.isfinite(one):
                        raise InputError(option, one, "a finite number")

    def error(self, message):
        """Print one line: what is wrong, the nearest right word, where help is; exit status 2."""
        message = self._unknown_option() or _nearest_choice(" ".join(message.split()))
        if "--json" in self._given:
            answer.want()
            answer.state(error={"place": self.prog, "says": message})
        print(f"{self.prog}: {message} ({self.prog} --help lists the options)", file=sys.stderr)
        sys.exit(2)

    def known_options(self):
        """{option: its choices; [] where it takes any value, None where it takes none}."""
        return {option: None if action.nargs == 0 else [str(choice) for choice in action.choices or ()]
                for action in self._actions for option in action.option_strings}

    def _unknown_option(self):
        """What to say of an option that there is not, or None."""
        known = list(self.known_options())
        for word in self._given:
            name = word.partition("=")[0]
            if word == "--":
                return None
            if name.startswith("--") and not any(option.startswith(name) for option in known):
                return f"there is no option {name}{nearest(name, known)}"
        return None


def nearest(word, known):
    """``; did you mean X?`` for the nearest of the known words, or an empty string."""
    found = difflib.get_close_matches(word, known, 1, 0.6)
    return f"; did you mean {found[0]}?" if found else ""


def _nearest_choice(message):
    """An argparse message about a choice or a stray word, with the nearest right one added."""
    choice = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
    if choice:
        return message + nearest(choice[1], [word.strip(" '\"") for word in choice[2].split(",")])
    return message.replace("unrecognized arguments:", "unexpected words:")


def parser_of(main, words=()):
    """The `Parser` of a command's ``main`` for these words, without running the command; None where it has none."""
    global _describing
    _describing = True
    try:
        main(list(words))
    except Described as found:
        return found.parser
    finally:
        _describing = False
    return None
