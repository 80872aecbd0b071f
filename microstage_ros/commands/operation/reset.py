"""``reset``: forgets a latched fault, so that the axis may go on."""

from microstage_ros.commands.operator import ask, operator_parser


def main(argv=None):
    """Run the command. Returns 0 if the axis did it, 1 otherwise."""
    parser = operator_parser("reset", "Forgets a latched fault, so that the axis may go on.")
    arguments = parser.parse_args(argv)
    return ask(arguments.namespace, lambda axis: axis.reset())
