"""``shell``: a shell, or one command, in the environment of the nodes: ROS 2, the messages, this package."""

import os
import shutil
import sys

from microstage_ros.commands.__main__ import which_ros
from microstage_ros.commands.parser import nearest

USAGE = """usage: microstage shell [COMMAND [ARGUMENT...]]

Without a command a shell in which python finds rclpy, microstage_msgs and microstage_ros (leave it with exit);
with one, that command alone. Examples: microstage shell python my_moves.py   microstage shell python -c "import rclpy"
The program ros2 is there only where a ROS 2 installation is sourced; microstage topic list needs none.
"""


def main(argv=None):
    """Become the shell or the command. Returns 0 for --help, 2 if there is no such program."""
    words = list(sys.argv[2:] if argv is None else argv)
    if words[:1] in (["-h"], ["--help"]):
        print(USAGE)
        return 0
    if words and words[0].startswith("-") and words[0] != "--":
        print(
            f"microstage shell: there is no option {words[0]} (microstage shell --help lists the options)",
            file=sys.stderr,
        )
        sys.exit(2)
    words = words[1:] if words[:1] == ["--"] else words
    if words and not shutil.which(words[0]):
        known = [name for name in ("python", "python3", "pip", "ros2", "bash") if shutil.which(name)]
        print(
            f"microstage shell: there is no program {words[0]!r} on the path{nearest(words[0], known)}", file=sys.stderr
        )
        return 2
    if words:
        os.execvp(words[0], words)
    shell = os.environ.get("SHELL") or "/bin/sh"
    print(f"{which_ros()} Leave this shell with exit.", file=sys.stderr)
    os.environ["PS1"] = "(microstage) " + os.environ.get("PS1", "$ ")
    os.execvp(shell, [shell])
