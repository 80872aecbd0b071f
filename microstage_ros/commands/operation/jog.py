"""``jog``: a constant speed for a while, then hold."""

import re

from microstage_ros.commands import units
from microstage_ros.commands.operator import ask, operator_parser
from microstage_ros.quantities.errors import InputError

LONGEST_S = 10.0


def main(argv=None):
    """Run the command. Returns 0 if the axis moves, 1 otherwise.

    Raises InputError: a duration out of range, a speed above that of the axis.
    """
    parser = operator_parser(
        "jog", "Moves at a constant speed for a while, then holds; a newer jog or goal supersedes it."
    )
    parser.add_argument("--speed", type=units.speed, required=True, metavar="SPEED", help="such as 0.5mm/s")
    parser.add_argument(
        "--for", dest="duration", type=units.duration, default=1.0, metavar="TIME", help="at most 10s (default 1s)"
    )
    parser.add_argument("--back", action="store_true", help="towards smaller positions")
    arguments = parser.parse_args(argv)
    if not 0.0 < arguments.duration <= LONGEST_S:
        raise InputError("--for", arguments.duration, f"above 0, at most {LONGEST_S:g} s")

    def question(axis):
        response = axis.jog(-arguments.speed if arguments.back else arguments.speed, arguments.duration)
        too_fast = re.fullmatch(r"velocity: got .* to (.*)", response.message)  # of `MoveRequests`
        if too_fast and not response.accepted:
            raise InputError("--speed", f"{arguments.speed:g} m/s", f"at most {too_fast[1]}, the limit of the axis")
        return response.accepted, response.message

    return ask(arguments.namespace, question)
