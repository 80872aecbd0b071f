"""The figures of docs/diagnosis.md and docs/evidence/emps.md as stamped tables (`microstage_ros.report.stamped`)."""

import dataclasses
import os

from microstage_ros.diagnosis.validation import campaign, ways
from microstage_ros.metrology.rates import rate
from microstage_ros.places import SOURCE, config_file
from microstage_ros.quantities.errors import InputError

ANYWHERE = "a wrong name anywhere in the answer"
SIZES = "sizes inside their 95 % interval"
WAYS = ("causes named, and 90 % of the way in their own channel", ways.OVER_TWIN, ways.WITHIN_ERROR,
        ways.WITHOUT, ways.DECIDED)


@dataclasses.dataclass(frozen=True)
class Part:
    """Cases of one kind, and what is reported of them.

    Attributes
    ----------
    heading : in the table. kind, strength : as `campaign.examinations` has them. cases : how many are examined.
    figures : of `campaign.scores`.
    """

    heading: str
    kind: str
    cases: int
    strength: float
    figures: tuple


PARTS = (
    Part("single effects", "single", 150, 1.0,
         ("single: right name first", "single: undetermined", "single: a wrong name first", ANYWHERE, SIZES, *WAYS)),
    Part("single effects at half the size", "single", 135, 0.5,
         ("single: right name first", "single: undetermined", "single: a wrong name first", ANYWHERE)),
    Part("pairs", "two", 100, 1.0, ("two: both named", "two: at least one named", ANYWHERE, SIZES, *WAYS)),
    Part("healthy axes", "healthy", 1000, 1.0,
         ("healthy: something named", "healthy: unexplained", "healthy: false alarms")),
    Part("outside the catalogue", "outside", 42, 1.0,
         ("outside: a wrong name", "outside: seen, and not explained away")),
)
SEEDS = {"first": 81, "second": 181}
EMPS = SOURCE.parent / "shared" / "data" / "emps"


def campaign_table(world, earlier=None):
    """The Markdown table of a world, "first" or "second".

    Parameters
    ----------
    earlier : {(kind, strength): outcomes} of campaigns that were run with the code of today; only their parts are in
        the table. None: all cases of `PARTS` are examined now, which takes hours.
    """
    lines, all_outcomes = ["| cases | figure | | 95 % interval |", "|---|---|---|---|"], []
    for number, part in enumerate(PARTS):
        outcomes = _examined(world, number) if earlier is None else earlier.get((part.kind, part.strength), [])
        counts, medians = campaign.scores(outcomes) if outcomes else ({}, {})
        all_outcomes += outcomes
        for figure in part.figures if outcomes else ():
            result = rate(*counts[figure])
            if result.cases:
                lines.append(f"| {part.heading} | {figure.split(': ')[-1]} | {result.hits} of {result.cases} | "
                             f"{100 * result.low:.1f} … {100 * result.high:.1f} % |")
        if outcomes and ways.WITHOUT in part.figures and counts[ways.WITHOUT][1]:
            whole, of = medians[ways.EXPECTED], counts[ways.WITHOUT][1]
            lines.append(f"| {part.heading} | {ways.EXPECTED} | {whole:.0f} of {of} | |")
    lines += ["", "| stated probability | mean stated | right | 95 % interval |", "|---|---|---|---|"]
    for low, high, mean, right, named in campaign.reliability(all_outcomes):
        result = rate(right, named)
        lines.append(f"| {low:g} … {high:g} | {mean:.3f} | {right} of {named} | {result.low:.3f} … {result.high:.3f} |")
    return "\n".join(lines)


def _examined(world, number):
    """Outcomes of one of `PARTS`, examined now."""
    part = PARTS[number]
    axis = str(config_file("axis.yaml"))
    examined = campaign.examinations(part.cases, SEEDS[world] + number, axis, part.kind, part.strength, world=world)
    return list(campaign.run(examined, os.cpu_count() or 1))


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
