"""``hold``: ramps the reference to rest and holds it there; a move under way ends."""

from microstage_ros.commands.operator import ask, operator_parser


def main(argv=None):
    """Run the command. Returns 0 if the axis did it, 1 otherwise."""
    parser = operator_parser("hold", "Ramps the reference to rest and holds it there; a move under way ends.")
    arguments = parser.parse_args(argv)
    return ask(arguments.namespace, lambda axis: axis.hold())
