"""``home``: goes to the zero of the axis at the axis' own speed; answers when it begins."""

from microstage_ros.commands.operator import ask, operator_parser


def main(argv=None):
    """Run the command. Returns 0 if the axis did it, 1 otherwise."""
    parser = operator_parser("home", "Goes to the zero of the axis at the axis' own speed; answers when it begins.")
    arguments = parser.parse_args(argv)
    return ask(arguments.namespace, lambda axis: axis.home())
