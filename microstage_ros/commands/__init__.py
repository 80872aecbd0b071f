"""The command line. A command is a file in a folder here with ``main(argv) -> status`` and a line in `LISTED`.

What every command shares (options, units, progress, answers as JSON, results kept) is described in
`microstage_ros.commands.parser`.
"""

LISTED = {
    "operation": {
        "demo": "the main job on the simulated axis: ROS 2 nodes, the paper's moves, a bag, a report",
        "cell": "start the nodes of an axis and leave them running until interrupted",
        "move": "moves through the action, with feedback",
        "commission": "the first day with a machine: from a sketch to a proven axis file, or a refusal with its reason",
        "status": "how an axis is, who drives it, what is missing",
        "stop": "zero volts now, until reset",
        "hold": "ramp the reference to rest and hold it there",
        "reset": "forget a latched fault",
        "home": "go to the zero of the axis",
        "jog": "a constant speed for a while, then hold",
        "experiment": "a run file's program on the live cell, recorded for identify",
        "watch": "is the axis still the machine that it was: scores against its own healthy spread",
    },
    "messages": {
        "topic": "list topics, show their messages, measure their rates",
        "replay": "play a bag back onto its topics",
        "recover": "make a bag whole again that was cut off or damaged",
        "cut": "a part of a record, or all of it, as a record of its own: a bag as a table, too",
    },
    "analysis": {
        "simulate": "one run of the model, no ROS",
        "identify": "friction parameters from records, with their uncertainty",
        "diagnose": "from records to the cause: where model and measurement part, and why",
        "log": "what a log of another machine is, as a LOG.yaml for diagnose --log",
        "campaign": "the diagnosis examined: many axes with hidden causes, hits and false alarms",
        "tune": "gains by a limit cycle, Ziegler-Nichols and simulation, with margins",
        "compare": "the paper's controllers side by side: tracking, accuracy, settling",
        "robustness": "a law on machines that it was not given; what fails, and how to see it again",
        "laws": "what each friction law can and cannot show",
        "effects": "what may be wrong with an axis: ids, parameters and units for effects, what to do about each",
    },
    "project": {
        "test": "all the tests",
        "bench": "the project's own benchmarks",
        "figures": "the documentation's tables of figures, measured anew and stamped",
        "faults": (
            "the fault campaign: processes killed and stopped, hostile messages and files; what was noticed, how soon"
        ),
        "security": "keys, certificates and signed permissions for DDS security (SROS 2)",
        "mutation": "do the tests notice when the code is wrong: small faults put in one by one",
        "shell": "a shell, or one program, in the environment of the nodes",
        "completion": "a script that completes commands and options in bash, zsh, fish",
    },
}
"""Folder to its commands, each with one line for the help. setup.py and the shell completion read this too."""

COMMANDS = {name: text for listed in LISTED.values() for name, text in listed.items()}
"""Name to one line for the help."""

FOLDERS = {folder: tuple(listed) for folder, listed in LISTED.items()}
"""Folder to the commands that lie in it."""


def module_of(name):
    """The module that holds the command ``name``, one of `COMMANDS`."""
    folder = next(folder for folder, names in FOLDERS.items() if name in names)
    return f"microstage_ros.commands.{folder}.{name}"
