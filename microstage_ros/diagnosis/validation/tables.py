"""The figures of docs/diagnosis.md and docs/emps.md as stamped tables (`microstage_ros.report.stamped`)."""

import math
import os

from microstage_ros.diagnosis.validation import campaign
from microstage_ros.metrology.rates import rate
from microstage_ros.places import SOURCE, config_file
from microstage_ros.quantities.errors import InputError

#: (heading, kind, cases, strength, figures of `campaign.scores` that are reported)
PARTS = (
    (
        "mixed",
        "mixed",
        300,
        1.0,
        (
            "single: right name first",
            "single: undetermined",
            "single: a wrong name first",
            "outside: a wrong name",
            "a wrong name anywhere in the answer",
            "sizes inside their 95 % interval",
            "named, and 90 % of the way to the noise",
        ),
    ),
    ("single effects at half the size", "single", 135, 0.5, ("single: right name first", "single: a wrong name first")),
    ("pairs", "two", 100, 1.0, ("two: both named", "two: at least one named", "a wrong name anywhere in the answer")),
    (
        "healthy axes",
        "healthy",
        1000,
        1.0,
        ("healthy: something named", "healthy: unexplained", "healthy: false alarms"),
    ),
)
SEEDS = {"first": 81, "second": 181}
EMPS = SOURCE.parent / "shared" / "data" / "emps"


def campaign_table():
    """Figures of the campaign in the first world."""
    return _table("first")


def second_world_table():
    """Figures of the campaign in the second world."""
    return _table("second")


def _table(world, parts=PARTS, scale=float(os.environ.get("MICROSTAGE_FIGURES_SCALE", "1"))):
    """The Markdown table of one world; ``scale`` multiplies the numbers of cases (environment:
    MICROSTAGE_FIGURES_SCALE)."""
    lines, all_outcomes = ["| cases | figure | | 95 % interval |", "|---|---|---|---|"], []
    for number, (heading, kind, cases, strength, figures) in enumerate(parts):
        count = max(math.ceil(cases * scale), 1)
        examined = campaign.examinations(
            count, SEEDS[world] + number, str(config_file("axis.yaml")), kind, strength, world=world
        )
        outcomes = list(campaign.run(examined, os.cpu_count() or 1))
        counts, _ = campaign.scores(outcomes)
        all_outcomes += outcomes
        for figure in figures:
            result = rate(*counts[figure])
            if result.cases:
                lines.append(f"| {heading} | {figure.split(': ')[-1]} | {result.hits} of {result.cases} | "
                             f"{100 * result.low:.1f} … {100 * result.high:.1f} % |")
    lines += ["", "| stated probability | mean stated | right | 95 % interval |", "|---|---|---|---|"]
    for low, high, mean, right, named in campaign.reliability(all_outcomes):
        result = rate(right, named)
        lines.append(f"| {low:g} … {high:g} | {mean:.3f} | {right} of {named} | {result.low:.3f} … {result.high:.3f} |")
    return "\n".join(lines)


def emps_record(name):
    """A record of the EMPS benchmark as `Record`; ``name`` without suffix. Raises `InputError` where the file is not
    there."""
    import scipy.io

    from microstage_ros.records import Record

    path = EMPS / f"{name}.mat"
    if not path.exists():
        raise InputError(path, "no such file", "the data of the EMPS benchmark (nonlinearbenchmark.org)")
    data = scipy.io.loadmat(path)
    columns = {"encoder_m": data["qm"].ravel(), "reference_m": data["qg"].ravel(), "voltage_V": data["vir"].ravel()}
    if "pulses_N" in data:     # volts, whatever the name says: the controller's output and they add up to vir
        columns["disturbance_V"] = data["pulses_N"].ravel().astype(float)
    return Record(1e-3, columns, f"{name}.mat")


def emps_table():
    """What the causes are worth on both records of the benchmark."""
    from microstage_ros.diagnosis.resimulation.diagnose import diagnose_force_axis
    from microstage_ros.model.axis_file import load_axis

    axis = load_axis(config_file("emps.yaml"))
    first, second = emps_record("DATA_EMPS"), emps_record("DATA_EMPS_PULSES")
    lines = [
        "| learned on | judged on | verdict | force before | after (95 %) | noise | named |",
        "|---|---|---|---|---|---|---|",
    ]
    for learn, held in (([first], []), ([second], []), ([first], [second]), ([second], [first])):
        answer = diagnose_force_axis(axis, learn, held, jobs=os.cpu_count() or 1)
        gain, named = answer.gain, ", ".join(f"`{c.id}` {c.share:.0%}" for c in answer.causes)
        named += "".join(f"; open: {' or '.join(f'`{i}`' for i in rivals.ids)}" for rivals in answer.rivals)
        where = held[0].source if held else "time held back"
        lines.append(f"| {learn[0].source} | {where} | {answer.verdict} | {gain.before:.2f} N | {gain.after:.2f} N "
                     f"({gain.ci95[0]:.2f} … {gain.ci95[1]:.2f}) | {gain.floor:.2f} N | {named} |")
    return "\n".join(lines)
