"""The answer of a commissioning: report.json, axis.yaml, frequency_response.csv and the page."""

import math

import numpy as np

from microstage_ros import __version__
from microstage_ros.commissioning.design.period import PHASE, beside_usual
from microstage_ros.commissioning.findings import CHECKS
from microstage_ros.commissioning.estimation.frequency_response import write_responses
from microstage_ros.commissioning.store import write_json
from microstage_ros.quantities.command import VOLTAGE
from microstage_ros.quantities.readable import interval, people, quantity, unit_sign
from microstage_ros.report.page import Page
from microstage_ros.report.plots import COLOURS, legend_above, new_figure

TONE = {"ready": "good", "refused": "bad", "stopped": "caution"}


def report_tree(outcome, machine):
    """The contents of report.json; ``outcome``: `Outcome`."""
    checks = sorted(outcome.checks.values(), key=lambda c: CHECKS.index(c.id))
    margins = outcome.margins
    tree = {
        "format": 1,
        "verdict": outcome.verdict,
        "says": outcome.says,
        "checks": [c.as_dict() for c in checks],
        "parameters": {
            key: {
                "value": e.value,
                "stderr": e.stderr,
                "unit": e.unit,
                "determined": e.determined,
                **({"low": e.low, "high": e.high} if e.determined else {"why": e.remark}),
            }
            for key, e in outcome.estimates.items()
        },
        "margins": {
            "phase_deg": margins.phase_deg if margins else math.nan,
            "gain_dB": margins.gain_dB if margins else math.nan,
            "measured": margins is not None,
        },
        "moves": outcome.moves,
        "iso230": {f"{name}_m": value for name, value in outcome.iso.items()},
        "slow_sine_m": outcome.sine,
        "used": {"time_s": machine.time, **machine.used, **_most(machine)},
        "instruments": machine.instruments,
        "controller": outcome.law,
        "remarks": outcome.remarks,
        "version": __version__,
        "axis": "axis.yaml" if outcome.axis is not None else None,
    }
    if margins:
        rest = outcome.rest_margins
        tree["margins"] |= {
            "phase_stderr_deg": margins.phase_error_deg,
            "gain_stderr_dB": margins.gain_error_dB,
            "crossover_Hz": margins.crossover_Hz,
            "sensitivity": margins.sensitivity,
            "highest_Hz": margins.highest_Hz,
            "modelled": list(margins.modelled),
            "rest": {"phase_deg": rest.phase_deg, "gain_dB": rest.gain_dB, "crossover_Hz": rest.crossover_Hz}
            if rest
            else None,
        }
    return plain(tree)


def _most(machine):
    """Greatest command: voltage_max_V, and of a drive that is commanded with something else quantity and unit, too."""
    command = machine.command
    if command is VOLTAGE:
        return {"voltage_max_V": machine.most_command}
    return {"voltage_max_V": math.nan, "command_max": machine.most_command, "command_quantity": command.quantity,
            "command_unit": command.unit}


def plain(value):
    """Plain JSON of a ``value`` of any shape: numbers that are not finite become null."""
    if isinstance(value, dict):
        return {key: plain(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (np.bool_, bool)):
        return bool(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def write_answer(outcome, machine, folder, provenance):
    """Write every file of the answer into ``folder`` (`pathlib.Path`); ``outcome``: `Outcome`."""
    axis, responses = folder / "axis.yaml", folder / "frequency_response.csv"
    if outcome.axis is not None:
        outcome.axis.save(axis, {"version": __version__, "command": "commission", **provenance})
    else:
        axis.unlink(missing_ok=True)  # an earlier run's, which got further
    if outcome.responses:
        write_responses(outcome.responses, responses)
    else:
        responses.unlink(missing_ok=True)
    page(outcome, machine, provenance).save(folder / "report.html")
    write_json(folder / "report.json", report_tree(outcome, machine))


def page(outcome, machine, provenance):
    """The page a person reads of an ``outcome``, `Outcome`."""
    made = Page(
        "Commissioning",
        machine.axis.name,
        configuration=provenance.get("sketch"),
        seed=provenance.get("seed"),
        about={"Backend": provenance.get("backend", "")},
    )
    what = {"ready": "Ready.", "refused": "Refused.", "stopped": "Stopped before the end."}[outcome.verdict]
    said = f"{what} {outcome.says.rstrip('.')}."
    made.verdict(said, TONE[outcome.verdict], safe_words(machine))
    if outcome.moves:
        made.key_figures(
            [
                (
                    f"4s at {row['target_m'] * 1e6:g} µm",
                    quantity(row["four_s_m"], "m", 2),
                    f"95 %: {_between(row['four_s_interval_m'])}; bias {quantity(row['bias_m'], 'm', 2)}; by the"
                    " encoder",
                )
                for row in outcome.moves
            ]
        )
    made.section("Checks")
    rows = [
        (c.id, f"{'passed' if c.passed else 'FAILED'}: {unit_sign(c.says)}")
        for c in sorted(outcome.checks.values(), key=lambda c: CHECKS.index(c.id))
    ]
    made.table(
        ("check", "what it says"),
        rows,
        marked=[k for k, row in enumerate(rows) if row[1].startswith("FAILED")],
    )
    if outcome.estimates:
        _parameters(made, outcome)
    if outcome.responses:
        made.section("Frequency response")
        made.figure(
            _bode(outcome.responses),
            "Measured responses; bands of two standard deviations; lines below a coherence of 0.5 are not drawn; the"
            " margins weigh every line of the loop by its doubt.",
            "Magnitude and phase against frequency",
        )
        if outcome.margins:
            made.text(_margins_in_words(outcome.margins))
    if outcome.along is not None:
        made.section("Along the travel")
        command = machine.command
        made.figure(_along(outcome.along, command),
                    f"Mean {command.quantity} at constant speed by direction, each in a scale of its own.",
                    f"{command.quantity.capitalize()} against position")
    if outcome.moves:
        made.section("Moves")
        made.table(
            (
                "target [µm]",
                "n",
                "bias [nm]",
                "4s [nm]",
                "95 % interval [nm]",
                "settling after the reference, median [ms]",
                "reversal B [nm]",
                "both sides R [nm]",
            ),
            [
                (
                    f"{row['target_m'] * 1e6:g}",
                    row["n"],
                    _signed(row["bias_m"]),
                    f"{row['four_s_m'] * 1e9:.2f}",
                    "{:.2f} to {:.2f}".format(*(1e9 * v for v in row["four_s_interval_m"])),
                    settling_words(row["settling_s"]),
                    _signed(row["reversal_m"]),
                    f"{row['bidirectional_m'] * 1e9:.2f}",
                )
                for row in outcome.moves
            ],
            "Bias, 4s and settling of the approaches in the positive direction, reversal and both sides with five more"
            " from above (ISO 230-2); errors by the encoder, mean over the last 0.1 s at rest. Settling: from the end"
            " of the reference until the encoder stays within two counts, 50 nm at least; 0: it never left them;"
            " –: half of the moves did not settle.",
        )
        made.text(
            "ISO 230-2 over these targets: "
            + ", ".join(f"{name.replace('_', ' ')} {value * 1e9:.1f} nm" for name, value in outcome.iso.items())
            + ". By the encoder of the loop: what lies between encoder and tool needs an interferometer."
        )
        made.text(f"Slow sine of ±10 µm at 0.1 Hz: largest error {outcome.sine * 1e9:.0f} nm.")
    if outcome.axis is not None:
        _period(made, outcome)
    made.section("What was used")
    used = machine.used
    made.text(
        f"{machine.time:.0f} s of machine time; {_read(used)}; at most {machine.most_command:.3g}"
        f" {machine.command.unit}."
    )
    if machine.instruments:
        made.text(
            "By the machine's own instruments: "
            + "; ".join(_instrument(name, value) for name, value in machine.instruments.items())
            + "."
        )
    if outcome.remarks:
        made.list(outcome.remarks)
    made.note("Signed: ______________________   Date: ______________")
    return made


def _read(used):
    """What the encoder read, in words."""
    low, high = used["travel_min_m"], used["travel_max_m"]
    if not math.isfinite(low):
        return "the encoder gave no number"
    return f"encoder from {low * 1e3:.4g} to {high * 1e3:.4g} mm"


def settling_words(seconds):
    """A settling time, ``seconds`` [s], in ms; a dash where it is none."""
    return f"{seconds * 1e3:.0f}" if math.isfinite(seconds) else "–"


def safe_words(machine):
    """Whether the last write of zero to a ``machine``, `Machine`, was taken, in words."""
    if machine.zeroed:
        return f"The machine is at zero {machine.command.quantity}."
    return (f"Zero {machine.command.quantity} is NOT confirmed: the hardware did not take it. Switch the drive's power "
            "off before anybody touches the machine.")


def _signed(value):
    """A length [m] in nm with its sign, which a zero has not."""
    text = f"{value * 1e9:+.2f}"
    return text if text.strip("+-0.") else "0.00"


def _between(ends):
    low, high = ends
    return interval(low, high, "m", 2)


def _instrument(name, value):
    if name == "interval_s":
        return f"{value[0] * 1e6:.4g} to {value[1] * 1e6:.4g} µs between readings"
    if name == "temperature_K":
        return f"{min(value) - 273.15:.2f} to {max(value) - 273.15:.2f} °C"
    return f"index mark at {value * 1e3:.6g} mm"


def _period(made, outcome):
    """What the control period allows on the identified axis, beside what was measured."""
    axis = outcome.axis
    rows, own = beside_usual(axis), axis.value("period")
    made.section("What the period allows")
    made.table(
        ("period", "crossover", "stiffness", "pushed aside"),
        [
            (quantity(r.period, "s", 3), quantity(r.crossover, "Hz", 2), quantity(r.stiffness, "N/m", 2),
             quantity(r.aside, "m", 2))
            for r in rows
        ],
        f"Largest crossover of a loop that keeps {PHASE:g}° of phase, the stiffness that it has then, and the way that"
        " friction pushes the stage aside when it turns round at once, by the identified mass and friction.",
        marked=[k for k, r in enumerate(rows) if r.period == own],
    )
    margins, here = outcome.margins, next(r for r in rows if r.period == own)
    if margins and margins.crossover_Hz > 0.0:
        made.text(
            f"This loop crosses at {margins.crossover_Hz:.3g} Hz (measured in motion), the period of"
            f" {quantity(own, 's', 3)} allows {here.crossover:.3g} Hz; the drive train and the doubt in the identified"
            " numbers take their part of that."
        )
    swing = outcome.estimates.get("resonance of the drive train")
    if swing is not None and swing.determined and swing.value > here.crossover:
        made.text(
            f"The drive train swings at {swing.value:.3g} Hz, above that: no loop on the encoder alone damps it at this"
            " period."
        )


def _margins_in_words(m):
    """A sentence or two on `MeasuredMargins`."""
    def of(what, value, error, unit):
        if not math.isfinite(value):
            return "none, no crossing"
        return quantity(value, unit, 3, 2 * error) + (" (95 %, modelled)" if what in m.modelled else " (95 %)")

    said = (
        f"Loop in motion, measured up to {m.highest_Hz:.0f} Hz: phase margin "
        f"{of('phase', m.phase_deg, m.phase_error_deg, '°')}, gain margin "
        f"{of('gain', m.gain_dB, m.gain_error_dB, 'dB')}, crossover {m.crossover_Hz:.0f} Hz, largest sensitivity"
        f" {m.sensitivity:.2g} there."
    )
    if m.modelled:
        said += (" Modelled: above that no line is coherent, and the least margin is that of the identified axis, its"
                 " band by draws from the uncertainty of its numbers.")
    return said


def _parameters(made, outcome):
    made.section("Parameters")
    determined = [e for e in outcome.estimates.values() if e.determined]
    made.table(
        ("parameter", "value ± standard uncertainty"),
        [(e.key, people(e.value, e.unit, e.stderr, "\n")) for e in determined],
        "Determined by the records",
    )
    open_ones = [(e.key, e.remark) for e in outcome.estimates.values() if not e.determined]
    if open_ones:
        made.table(("parameter", "why not, and what would tell it"), open_ones, "Not determined")


def _bode(found):
    figure, (top, bottom) = new_figure(2, 1, height=2.4, sharex=True)
    for k, (response, colour) in enumerate(zip(found, ("blue", "orange", "green", "pink", "grey"))):
        r = response.kept()
        if not len(r.frequency):
            continue
        size = np.abs(r.value) * (1e6 if r.what == "plant" else 1.0)
        # the plant in sliding is measured twice: before any loop is closed, and with the law that is chosen
        again = any((before.what, before.condition) == (r.what, r.condition) for before in found[:k])
        label = f"{r.what}, {r.condition}" + ", in closed loop" * again + (" [µm/V]" if r.what == "plant" else "")
        mark = "o" if len(r.frequency) == 1 else ""  # a line through one point shows nothing
        top.loglog(r.frequency, size, mark + "-", markersize=3, color=COLOURS[colour], label=label)
        top.fill_between(
            r.frequency,
            size * (1 - 2 * np.minimum(r.relative, 0.45)),
            size * (1 + 2 * r.relative),
            color=COLOURS[colour],
            alpha=0.25,
        )
        phase = np.degrees(np.unwrap(np.angle(r.value)))
        bottom.semilogx(r.frequency, phase, mark + "-", markersize=3, color=COLOURS[colour])
        band = 2 * np.degrees(r.relative)
        bottom.fill_between(r.frequency, phase - band, phase + band, color=COLOURS[colour], alpha=0.25)
    top.set_ylabel("magnitude\n[µm/V], of the loop [1]")
    legend_above(top)
    bottom.set_ylabel("phase [°]")
    bottom.set_xlabel("frequency [Hz]")
    return figure


def _along(rows, command):
    figure, plots = new_figure(2, 1, height=1.5, sharex=True)
    for axes, column, colour, way in zip(plots, (1, 2), ("blue", "orange"), ("forwards", "backwards")):
        axes.plot(rows[:, 0] * 1e3, rows[:, column], color=COLOURS[colour])
        axes.set_title(way)
        axes.set_ylabel(f"{command.quantity} [{command.unit}]")
    plots[-1].set_xlabel("position [mm]")
    return figure
