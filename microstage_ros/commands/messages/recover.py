"""``recover``: a bag whose recorder was killed, or that was damaged, made whole again."""

from pathlib import Path

from microstage_ros.commands import answer
from microstage_ros.commands.parser import Parser
from microstage_ros.files import missing
from microstage_ros.records.bags.recovery import DAMAGED, recover


def main(argv=None):
    """Run the command. Returns 0; raises InputError where nothing can be read."""
    parser = Parser(
        prog="microstage recover",
        description=(
            "Makes a bag whole again that was cut off or damaged, so that every tool opens it. What cannot be read is"
            f" left out and reported; the file as it was found stays beside it (name ends in {DAMAGED})."
        ),
    )
    parser.add_argument("bag", metavar="BAG", help="an MCAP file or a rosbag2 folder")
    arguments = parser.parse_args(argv)
    if not Path(arguments.bag).exists():
        raise missing(arguments.bag, "an MCAP file or a rosbag2 folder")
    done = recover(arguments.bag)
    answer.state(
        files=[
            {
                "file": str(one.file),
                "whole": one.whole,
                "messages": one.messages,
                "chunks": one.chunks,
                "lost_chunks": one.lost_chunks,
                "lost_bytes": one.lost_bytes,
                "topics": one.topics,
            }
            for one in done
        ]
    )
    for one in done:
        if one.whole:
            print(f"{one.file}: whole, {one.messages} messages; nothing to do")
        else:
            print(
                f"{one.file}: {one.messages} messages in {one.chunks} chunks kept; lost: {one.lost_chunks} damaged"
                f" chunks, {one.lost_bytes} bytes after the last whole one"
            )
    return 0
