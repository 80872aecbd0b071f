"""``stop``: zero volts now."""

from microstage_ros.commands.operator import ask, operator_parser


def main(argv=None):
    """Run the command. Returns 0 if the voltage is zero, 1 otherwise."""
    parser = operator_parser(
        "stop",
        "Takes the voltage away now, in any mode, and keeps it away until reset. A driver on this computer is"
        " informed by a signal before anything is looked for over ROS. This is no emergency stop: that is a switch in"
        " the drive's power (docs/safety.md).",
    )
    arguments = parser.parse_args(argv)

    def first():
        from microstage_ros.ros.launching.signalled_stop import signal_stop

        signal_stop(arguments.namespace)

    return ask(arguments.namespace, lambda axis: axis.stop(), first)
