"""``bench``: the project's own benchmarks, each beside a peer measured in the same run."""

import importlib
import importlib.metadata
import json
import os
import pathlib
import platform
import sys

from microstage_ros import __version__
from microstage_ros.commands import answer
from microstage_ros.commands.parser import Parser
from microstage_ros.files import write_text
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

PARTS = {
    "step": "the compiled step of the axis, beside scipy, numpy and plain Python",
    "loop": "the step with a controller",
    "records": "bags and CSV, beside rosbags, mcap-ros2-support",
    "servo": "the loop over ROS topics between processes, beside rclpy's executors",
    "paced": "all nodes at 10 kHz and the wall clock, everything recorded, beside what the machine alone keeps",
}
LIBRARIES = ("numpy", "numba", "scipy", "mcap", "rosbags", "mcap-ros2-support")


def main(argv=None):
    """Run the chosen parts, print a line per figure, write JSON if asked. Returns 0.

    Raises InputError: a duration out of range, a JSON file in a folder that does not exist.
    """
    parser = Parser(prog="microstage bench", json="file", description="Benchmarks of this machine. Parts: " + "; ".join(
        f"{name}: {text}" for name, text in PARTS.items()) + ".")
    parser.add_argument("--part", action="append", choices=PARTS, help="only this part (may be given again)")
    parser.add_argument("--long", action="store_true", help="the long form of part step: 10^9 steps")
    parser.add_argument("--seconds", type=float, default=8.0, metavar="S", help="length of part paced (default 8)")
    arguments = parser.parse_args(argv)
    if not 1.0 <= arguments.seconds <= 86400.0:
        raise InputError("--seconds", arguments.seconds, "seconds from 1 to 86400")
    if isinstance(arguments.json, str) and not pathlib.Path(arguments.json).resolve().parent.is_dir():
        raise InputError("--json", arguments.json, "a file in an existing folder")
    found = {"format": 1, "version": __version__, "machine": machine(), "rows": []}
    print(f"{found['machine']['processor']}, {found['machine']['cores']} cores, Python {found['machine']['python']}")
    for part in arguments.part or [name for name in PARTS if name != "paced"]:
        for row in rows_of(part, arguments.long, arguments.seconds):
            found["rows"].append({"part": part, **row})
            print(line(part, row), flush=True)
    answer.state(**found)
    if isinstance(arguments.json, str):
        write_text(arguments.json, json.dumps(found, indent=1, default=float))
    return 0


def rows_of(part, long, seconds):
    """Rows of one part; each part is loaded only when it is asked for.

    Parameters
    ----------
    part : one of `PARTS`. long : whether the part step takes 10^9 steps. seconds : length of part paced [s].

    Returns
    -------
    Iterable of {name, value, unit, peer, peer_value, note}.
    """
    axis = load_axis(config_file("axis.yaml"))
    if part == "step":
        return importlib.import_module("microstage_ros.solver.benchmarks.step").bench(axis, long)
    if part == "loop":
        return importlib.import_module("microstage_ros.control.evaluation.benchmark").bench(axis)
    if part == "records":
        return (figure._asdict() for figure in importlib.import_module("microstage_ros.records.bench").bench())
    servo = importlib.import_module("microstage_ros.ros.benchmarks.servo")
    return servo.bench_paced(seconds) if part == "paced" else servo.bench()


def line(part, row):
    """One figure as text: name, value [its own unit], its peer and a note."""
    text = f"{part:8} {row['name']:58} {row['value']:14,.4g} {row['unit']}"
    if row.get("peer_value") is not None:
        text += f"   (peer {row.get('peer', '')} {row['peer_value']:,.4g})"
    return text + (f"   {row['note']}" if row.get("note") else "")


def machine():
    """What ran the benchmarks: processor, cores, load, versions."""
    name = platform.processor() or platform.machine()
    cpuinfo = pathlib.Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        name = next(
            (row.split(":")[1].strip() for row in cpuinfo.read_text().splitlines() if row.startswith("model name")),
            name,
        )
    versions: dict[str, str | None] = {}
    for library in LIBRARIES:
        try:
            versions[library] = importlib.metadata.version(library)
        except importlib.metadata.PackageNotFoundError:
            versions[library] = None
    return {
        "processor": name,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "python": sys.version.split()[0],
        "versions": versions,
    }
