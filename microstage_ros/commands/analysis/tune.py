"""``tune``: limit-cycle experiment, Ziegler-Nichols, fine tuning by simulation, margins."""

import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from microstage_ros import __version__
from microstage_ros.commands import answer, units
from microstage_ros.commands.axis import read_axis
from microstage_ros.commands.drives import check_drive
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.control.tuning import tuning
from microstage_ros.control.tuning.margins import MARGIN_HEADS, margin_rows
from microstage_ros.files import complete_folder, keep_earlier
from microstage_ros.quantities.errors import InputError

OBSERVER = "self_tuning_observer"
TYPES = ("pid", "pid_feedforward", "self_tuning", "self_tuning_feedforward", OBSERVER)


def main(argv=None):
    """Run the command. Returns 0; raises InputError for bad input."""
    parser = Parser(
        prog="microstage tune",
        description=(
            "Tune a PID law for an axis: by simulation, or with --response on a measured frequency response (margins"
            " with bands, a notch where the response asks for one), or with --running on the cell that runs. Prints"
            f" the gains as other controllers write them. {OBSERVER} is designed from the axis file's numbers by rule,"
            " and checked on its model: there is nothing to search."
        ),
    )
    parser.add_argument("--axis", required=True, metavar="FILE", help="axis file")
    parser.add_argument("--type", default="pid", choices=TYPES, help="controller (default pid)")
    parser.add_argument(
        "--out", metavar="FILE", help="axis file to write, with the tuned gains in its controller section"
    )
    parser.add_argument(
        "--evaluations", type=int, default=60, metavar="N", help="candidates of the fine tuning (default 60)"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of search and friction (default 0)")
    parser.add_argument(
        "--response",
        metavar="FILE",
        help="measured response of the plant [m/V] (frequency_response.csv of commission): shape on it",
    )
    parser.add_argument(
        "--running",
        action="store_true",
        help=(
            "on the cell that runs, lockstep or paced: half a minute of motion, identification, tuning of what was"
            " found"
        ),
    )
    parser.add_argument(
        "--namespace", type=units.namespace, default="/axis", metavar="NS", help="of the running cell (default /axis)"
    )
    parser.add_argument("--record", metavar="DIR", help="folder of the bag that --running makes")
    parser.add_force()
    arguments = parser.parse_args(argv)
    if arguments.evaluations < 0:
        raise InputError("--evaluations", arguments.evaluations, "0 or more")
    if arguments.out:
        if Path(arguments.out).suffix not in (".yaml", ".yml"):
            raise InputError("--out", arguments.out, "a file name ending in .yaml")
        keep_earlier("--out", [arguments.out], arguments.force)
    if arguments.type == OBSERVER and arguments.response:
        raise InputError(
            "--type", arguments.type, f"one of {', '.join(TYPES[:-1])}: a response tells nothing of the current"
        )
    if arguments.running != bool(arguments.record) or (arguments.running and arguments.response):
        raise InputError(
            "--running, --record", arguments.record, "both together, for a cell that runs, and not with --response"
        )
    axis, console = read_axis(arguments.axis), Console()
    check_drive("tune", axis)
    if arguments.running:
        axis = _identified_running(arguments, axis)
        if axis is None:
            return 1
    console.width = max(console.width, 110)  # the table of margins is wide
    if arguments.type == OBSERVER:
        return _by_rule(arguments, axis, console)
    if arguments.response:
        return _shape(arguments, axis)
    cycle = tuning.limit_cycle(axis, seed=arguments.seed)
    console.print(
        f"limit cycle: ultimate gain {cycle.ultimate_gain:.4g} V/m, period {cycle.ultimate_period * 1e3:.4g} ms, "
        f"amplitude {cycle.amplitude * 1e6:.3g} um under a relay of {cycle.relay:.3g} V"
    )
    start = tuning.ziegler_nichols(cycle)
    console.print("Ziegler-Nichols: " + _in_words(start))
    with progress("fine tuning", arguments.evaluations) as bar:
        seeds = (arguments.seed, arguments.seed + 1)
        found = tuning.fine_tune(axis, arguments.type, start, seeds, arguments.evaluations, arguments.seed, bar.reach)
    console.print("fine tuned: " + _in_words(found.gains))
    table = Table(*MARGIN_HEADS)
    for row in margin_rows(found.margins):
        table.add_row(*row)
    console.print(table)
    _export(found.gains, axis)
    answer.state(
        type=arguments.type,
        ultimate_gain_V_m=cycle.ultimate_gain,
        ultimate_period_s=cycle.ultimate_period,
        gains=found.gains,
        margins=margin_rows(found.margins),
        axis=arguments.out,
    )
    if arguments.out:
        _save(arguments, axis, found.gains)
    return 0


def _by_rule(arguments, axis, console):
    """The observer law's gains by rule, the doubts with which it holds the model, its margins with the learned drive
    frozen."""
    from microstage_ros.control.laws.controller import Controller, controller_parameters, designed_gains
    from microstage_ros.control.tuning.margins import controller_margins

    record = controller_parameters(OBSERVER, axis.with_controller({"tuned_period": axis.value("period")}), {})
    gains = designed_gains(OBSERVER, record["feedforward"], axis.value("period"))
    doubts = {name: float(record["observer"][name]) for name in ("encoder_doubt", "voltage_doubt")}
    remark = Controller(OBSERVER, record).start_remark
    console.print(
        "by rule: " + _in_words({name: gains[name] for name in ("proportional", "integral_time", "derivative_time")})
    )
    console.print(
        "least doubts that hold the file's model: " + ", ".join(f"{name} {value:g}" for name, value in doubts.items())
    )
    if remark:
        console.print(remark)
    margins = controller_margins(axis, record)
    table = Table(*MARGIN_HEADS)
    for row in margin_rows(margins):
        table.add_row(*row)
    console.print(table)
    answer.state(type=OBSERVER, gains=gains, **doubts, margins=margin_rows(margins), remark=remark, axis=arguments.out)
    if arguments.out:
        section = {key: value for key, value in axis.controller.items() if key != OBSERVER}
        _save(arguments, axis.with_controller({**section, "type": OBSERVER}), gains)
    return 0


def _identified_running(arguments, axis):
    """The axis as a record on the running cell tells it; None, said, where the cell does not answer."""
    from microstage_ros.commands.operation.experiment import recorded_beside
    from microstage_ros.commissioning.design.programme import run_about
    from microstage_ros.control.runs.run_file import Run
    from microstage_ros.identification.intake import take_in
    from microstage_ros.identification.pipeline import identify
    from microstage_ros.records import read_record
    from microstage_ros.ros.launching.cell_processes import CellFailure

    period, out = axis.value("period"), Path(arguments.record)
    keep_earlier("--record", [out / "bag"], arguments.force)

    def made(place):
        program, centre = run_about(place, axis)
        return Run(program=program, start_m=centre).tables(period)["reference"]

    try:
        with complete_folder(out) as folder:
            recorded_beside(arguments.namespace, "", out, folder, period, made)
    except CellFailure as failure:
        answer.state(error={"place": "tune --running", "says": str(failure)})
        print(failure, file=sys.stderr)
        return None
    record, warnings = take_in(read_record(out / "bag"), axis)
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)
    answer.state(warnings=[*answer.facts().get("warnings", []), *warnings])
    found = identify(iter([record]), axis, arguments.seed)
    print(
        f"{out / 'bag'}: the record; "
        + ", ".join(
            f"{e.key} {e.value:.4g} {e.unit}"
            for e in found.estimates.values()
            if e.determined and not isinstance(e.value, list)
        )
    )
    return found.to_axis(axis)


def _save(arguments, axis, gains, **more):
    section = {**axis.controller, "tuned_period": axis.value("period"), arguments.type: _rounded(gains)}
    tuned = axis.with_controller(section)
    tuned.save(
        arguments.out,
        {**tuned.provenance, "tuned_by": f"microstage tune {__version__}", "seed": arguments.seed, **more},
    )


def _shape(arguments, axis):
    """Gains on a measured response."""
    from microstage_ros.commissioning.design import loop_shaping
    from microstage_ros.control.laws.controller import controller_parameters

    response = loop_shaping.read_response(arguments.response)
    parameters = controller_parameters(arguments.type, axis, {})["pid"]
    gains = {name: float(parameters[name]) for name in parameters.dtype.names}
    period = axis.value("period")
    before = loop_shaping.measured_margins(loop_shaping.loop_on(response, gains, period))
    found = loop_shaping.shape(response, gains, period)
    print(
        f"response: {arguments.response}, {response.condition}, {len(response.kept().frequency)} coherent lines of"
        f" {len(response.frequency)}"
    )
    print(f"gains of the axis file: {_in_words(gains)}\n  {_margins(before)}")
    print(f"shaped, {found.bandwidth:.2f} of that bandwidth: {_in_words(found.gains)}\n  {_margins(found.margins)}")
    if not loop_shaping.enough(found.margins, response):
        print(
            f"  not enough: {loop_shaping.LEAST_PHASE:g}°, {loop_shaping.LEAST_GAIN:g} dB, sensitivity"
            f" {loop_shaping.MOST_SENSITIVITY:g} are not reached on this response"
        )
    peak, notched = loop_shaping.resonance_in(response), loop_shaping.with_notch(response, gains, period)
    if peak:
        shaper = loop_shaping.zero_vibration(*peak)
        print(
            f"resonance at {peak[0]:.4g} Hz, damping {peak[1]:.2g}; shaper of the reference (zero vibration): "
            + ", ".join(f"{share:.3f} at {time * 1e3:.3g} ms" for time, share in shaper)
        )
    if notched:
        n = notched.notch
        print(
            f"a notch at {n.frequency:.4g} Hz (zeta {n.zeta_zero:.2g} over {n.zeta_pole:.2g}) would allow"
            f" {notched.bandwidth:.2f} of the bandwidth: {_in_words(notched.gains)}\n  {_margins(notched.margins)}"
        )
    _export(found.gains, axis)
    answer.state(
        type=arguments.type,
        gains=found.gains,
        phase_deg=found.margins.phase_deg,
        phase_stderr_deg=found.margins.phase_error_deg,
        gain_dB=found.margins.gain_dB,
        gain_stderr_dB=found.margins.gain_error_dB,
        sensitivity=found.margins.sensitivity,
        crossover_Hz=found.margins.crossover_Hz,
        notch_Hz=notched.notch.frequency if notched else None,
        axis=arguments.out,
    )
    if arguments.out:
        _save(arguments, axis, found.gains, response=str(arguments.response))
    return 0


def _margins(m):
    return (
        f"phase margin {m.phase_deg:.1f}° ± {2 * m.phase_error_deg:.1f}°, gain margin {m.gain_dB:.1f} dB ±"
        f" {2 * m.gain_error_dB:.1f} dB, crossover {m.crossover_Hz:.1f} Hz, largest sensitivity {m.sensitivity:.2f}"
    )


def _export(gains, axis):
    """The gains as other controllers write them."""
    from microstage_ros.commissioning.design.loop_shaping import exported

    print("as other controllers write them:")
    for name, lines, convention in exported(gains, axis):
        print(f"  {name} ({convention})")
        for line in lines:
            print(f"    {line}")


def _rounded(gains):
    """Gains to four digits, as plain floats."""
    return {name: float(f"{value:.4g}") for name, value in gains.items()}


def _in_words(gains):
    return ", ".join(f"{name} {value:.4g}" for name, value in gains.items())
