"""``tune``: limit-cycle experiment, Ziegler-Nichols, fine tuning by simulation, margins."""

from rich.console import Console
from rich.table import Table

from microstage_ros import __version__
from microstage_ros.commands import answer
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.control.tuning import tuning
from microstage_ros.control.tuning.margins import MARGIN_HEADS, margin_rows
from microstage_ros.files import keep_earlier
from microstage_ros.model.axis_file import load_axis
from microstage_ros.quantities.errors import InputError

TYPES = ("pid", "pid_feedforward", "self_tuning", "self_tuning_feedforward")


def main(argv=None):
    """Run the command. Returns 0; raises InputError for bad input."""
    parser = Parser(prog="microstage tune", description="Tune a PID law for an axis by simulation.")
    parser.add_argument("--axis", required=True, metavar="FILE", help="axis file")
    parser.add_argument("--type", default="pid", choices=TYPES, help="controller (default pid)")
    parser.add_argument("--out", metavar="FILE", help="axis file to write, with the tuned gains in its controller section")
    parser.add_argument("--evaluations", type=int, default=60, metavar="N", help="candidates of the fine tuning (default 60)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of search and friction (default 0)")
    parser.add_force()
    arguments = parser.parse_args(argv)
    if arguments.evaluations < 0:
        raise InputError("--evaluations", arguments.evaluations, "0 or more")
    if arguments.out:
        keep_earlier("--out", [arguments.out], arguments.force)
    axis, console = load_axis(arguments.axis), Console()
    console.width = max(console.width, 110)  # the table of margins is wide
    cycle = tuning.limit_cycle(axis, seed=arguments.seed)
    console.print(f"limit cycle: ultimate gain {cycle.ultimate_gain:.4g} V/m, period {cycle.ultimate_period * 1e3:.4g} ms, "
                  f"amplitude {cycle.amplitude * 1e6:.3g} um under a relay of {cycle.relay:.3g} V")
    start = tuning.ziegler_nichols(cycle)
    console.print("Ziegler-Nichols: " + _told(start))
    with progress("fine tuning", arguments.evaluations) as bar:
        seeds = (arguments.seed, arguments.seed + 1)
        found = tuning.fine_tune(axis, arguments.type, start, seeds, arguments.evaluations, arguments.seed,
                                 bar.reach)
    console.print("fine tuned: " + _told(found.gains))
    table = Table(*MARGIN_HEADS)
    for row in margin_rows(found.margins):
        table.add_row(*row)
    console.print(table)
    answer.state(type=arguments.type, ultimate_gain_V_m=cycle.ultimate_gain, ultimate_period_s=cycle.ultimate_period, gains=found.gains,
                 margins=margin_rows(found.margins), axis=arguments.out)
    if arguments.out:
        section = {**axis.controller, "tuned_period": axis.value("period"), arguments.type: _rounded(found.gains)}
        tuned = axis.with_controller(section)
        tuned.save(arguments.out, {**tuned.provenance, "tuned_by": f"microstage tune {__version__}", "seed": arguments.seed})
    return 0


def _rounded(gains):
    """Gains to four digits, as plain floats."""
    return {name: float(f"{value:.4g}") for name, value in gains.items()}


def _told(gains):
    return ", ".join(f"{name} {value:.4g}" for name, value in gains.items())
