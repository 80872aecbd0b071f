"""The command line. A command is a file in a folder here with ``main(argv) -> status`` and a line in `COMMANDS`."""

COMMANDS = {
    "demo": "the main job on the simulated axis: ROS 2 nodes, the paper's moves, a bag, a report",
    "test": "all the tests",
    "cell": "start the nodes of an axis and leave them running until interrupted",
    "move": "one move through the action, with feedback",
    "simulate": "one run of the model, no ROS",
    "experiment": "a run file's program on the live cell, recorded for identify",
    "identify": "friction parameters from records, with their uncertainty",
    "diagnose": "from records to the cause: where model and measurement part, and why",
    "campaign": "the diagnosis examined: many axes with hidden causes, hits and false alarms",
    "tune": "gains by a limit cycle, Ziegler-Nichols and simulation, with margins",
    "compare": "the paper's controllers side by side: tracking, accuracy, settling",
    "laws": "what each friction law can and cannot show",
    "replay": "play a bag back onto its topics",
    "bench": "the project's own benchmarks",
    "mutation": "do the tests notice when the code is wrong: small faults put in one by one",
}
"""Name to one line for the help."""

FOLDERS = {
    "operation": ("demo", "cell", "move", "experiment", "replay"),
    "analysis": ("simulate", "identify", "diagnose", "campaign", "tune", "compare", "laws"),
    "project": ("test", "bench", "mutation"),
}
"""Folder to the commands that lie in it."""


def module_of(name):
    """The module that holds the command ``name``, one of `COMMANDS`."""
    folder = next(folder for folder, names in FOLDERS.items() if name in names)
    return f"microstage_ros.commands.{folder}.{name}"
