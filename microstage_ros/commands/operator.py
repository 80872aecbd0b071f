"""What the operator's commands share: the namespace, one question to a running axis, one answer."""

import sys

from microstage_ros.commands import answer, units
from microstage_ros.commands.parser import Parser


def operator_parser(name, description):
    """A parser with ``--namespace``."""
    parser = Parser(prog=f"microstage {name}", description=description)
    parser.add_argument(
        "--namespace", type=units.namespace, default="/axis", metavar="NS", help="of the axis (default /axis)"
    )
    return parser


def say(sentence):
    """A line for the person who waits, on standard error."""
    print(sentence, file=sys.stderr, flush=True)


def name_live_axes(namespace):
    """Where nobody of this user owns ``namespace`` on this computer: say so, and which axes are live, before the second
    that loading ROS takes. It may be on another computer or another user's, so it is looked for all the same."""
    from microstage_ros.ros.launching.ownership import owned_namespaces

    found = owned_namespaces()
    if namespace not in found:
        here = f"live here: {', '.join(found)}" if found else "no axis is live here; ./microstage cell starts one"
        say(f"looking for {namespace}, which was not started here ({here}) …")


def ask(namespace, question, first=lambda: None):
    """Ask a running axis and say the answer. Returns 0 if it is yes, 1 if it is no or nobody answers.

    Parameters
    ----------
    question : called with an `ros.operator.Operator`; gives (success, message).
    first : called before anything of ROS is loaded.
    """
    first()
    name_live_axes(namespace)
    from microstage_ros.ros.client import NoAnswer
    from microstage_ros.ros.operator import Operator

    try:
        with Operator(namespace) as axis:
            success, message = question(axis)
            answer.state(success=bool(success), message=message, answered_s=axis.took)
    except NoAnswer as error:
        answer.state(success=False, message=str(error))
        print(error, file=sys.stderr)
        return 1
    print(message, file=sys.stdout if success else sys.stderr)
    return 0 if success else 1
