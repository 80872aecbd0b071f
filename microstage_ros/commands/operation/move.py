"""``move``: one move through the action, with feedback."""

import sys

from microstage_ros.commands.parser import Parser


def main(argv=None):
    """Run the command. Returns 0 if the target was reached, 2 if the move was refused, 1 otherwise."""
    parser = Parser(prog="microstage move", description="One move of a running axis (microstage cell).")
    parser.add_argument("--to", required=True, type=float, metavar="METRES", help="target along the axis from its home")
    parser.add_argument("--namespace", default="/axis", metavar="NS", help="of the axis (default /axis)")
    parser.add_argument("--tolerance", type=float, default=5e-8, metavar="METRES", help="half width that counts as reached")
    parser.add_argument("--timeout", type=float, default=10.0, metavar="SECONDS", help="from start to settled (default 10)")
    arguments = parser.parse_args(argv)
    return _move(arguments)


def _move(arguments):
    import rclpy
    from microstage_msgs.action import MoveTo

    from microstage_ros.ros.client import AxisClient, NoAnswer

    words = {1: "moving", 2: "settling", 3: "stopping"}

    def tell(feedback):
        line = f"{feedback.position * 1e6:+12.3f} µm  {feedback.error * 1e9:+14.1f} nm to go  {words[feedback.phase]}"
        print(f"\r{line}" if sys.stderr.isatty() else line, end="" if sys.stderr.isatty() else "\n", file=sys.stderr,
              flush=True)

    rclpy.init()
    try:
        with AxisClient(arguments.namespace) as axis:
            result = axis.move(arguments.to, tell, tolerance=arguments.tolerance, timeout=arguments.timeout)
    except NoAnswer as error:
        print(error, file=sys.stderr)
        return 1
    finally:
        rclpy.try_shutdown()
    if sys.stderr.isatty():
        print(file=sys.stderr)
    if result.code == MoveTo.Result.CODE_REFUSED:
        print(result.message, file=sys.stderr)
        return 2
    print(f"{result.message}: error {result.final_error * 1e9:+.1f} nm by the encoder, "
          f"{result.interferometer_error * 1e9:+.1f} nm by the interferometer, settled after "
          f"{result.settling_time * 1e3:.0f} ms")
    return 0 if result.reached else 1
