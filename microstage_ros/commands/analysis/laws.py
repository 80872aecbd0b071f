"""``laws``: what each friction law can and cannot show, measured, beside what the paper says of it."""

import inspect
import sys

from rich.console import Console
from rich.table import Table

from microstage_ros.commands import answer
from microstage_ros.commands.markdown import grid, plain, without_blank_runs, without_roles
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.progress import progress
from microstage_ros.model.friction.properties.table import EXPERIMENTS, compare, measure
from microstage_ros.model.friction.registry import LAWS, law_named

HEADLINE = "What each friction law can and cannot show, measured"


def main(argv=None):
    """Measure all laws and print the table. Returns 0."""
    parser = Parser(
        prog="microstage laws",
        description="Runs every friction law of the library through the same experiments and prints what it shows, "
        "with the number that decides, and where the paper (section 3.3) says otherwise.",
    )
    parser.add_argument(
        "--markdown",
        action="store_true",
        help="print docs/evidence/friction_laws.md: the table, equations, sources, criteria",
    )
    arguments = parser.parse_args(argv)
    console = Console(width=None if sys.stdout.isatty() else 160)
    table = measure(_counted)
    answer.state(
        properties={
            row: {law: {"shown": f.shown, "value": f.value} for law, f in found.items()} for row, found in table.items()
        }
    )
    if arguments.markdown:
        sys.stdout.write(markdown(table))
    else:
        show(table, console)
    return 0


def _counted(rows):
    """The rows one by one, with progress."""
    rows = list(rows)
    with progress("measuring", len(rows)) as bar:
        for row in rows:
            yield row
            bar.advance()


def cell(finding):
    """``yes 41.4 %``, ``no 0.00 %``, or a dash where the experiment has no meaning; ``finding``: `Finding`, a share
    [1]."""
    if finding.shown is None:
        return "–"
    percent = 100.0 * finding.value
    number = f"{percent:.1f}" if abs(percent) >= 1.0 else f"{percent:.2f}".replace("-0.00", "0.00")
    return f"{'yes' if finding.shown else 'no'} {number} %"


def rows_of(table):
    """Cells of the table: the property, then one per law."""
    return [[row, *(cell(table[row][law.name]) for law in LAWS)] for row in table]


def statements_of(table):
    """Cells of the comparison with the paper, disagreements first."""
    word = {True: "yes", False: "no"}
    found = sorted(compare(table), key=lambda entry: entry[2])
    return [
        [law_named(said.law).title, said.row, word[said.shown], cell(finding), "agrees" if agrees else "DISAGREES"]
        for said, finding, agrees in found
    ]


GENERAL_UNITS = {"N m": "F", "N m/rad": "F/q", "N m/s": "F/s", "N m s/rad": "F s/q", "rad/s": "q/s", "1": "1"}
STATEMENT_COLUMNS = ("law", "property", "paper", "measured", "")


def show(table, console):
    """Print both tables on a terminal, or as plain text into a pipe."""
    for title, columns, rows in (
        (HEADLINE, ("property", *(law.title for law in LAWS)), rows_of(table)),
        ("Beside the paper's section 3.3", STATEMENT_COLUMNS, statements_of(table)),
    ):
        sheet = Table(title=title, title_justify="left")
        for column in columns:
            sheet.add_column(column)
        for row in rows:
            style = "bold red" if row[-1] == "DISAGREES" else None
            sheet.add_row(*row, style=style)
        console.print(sheet)
    console.print("Criteria, equations and sources: docs/evidence/friction_laws.md")


def markdown(table):
    """The page docs/evidence/friction_laws.md."""
    parts = [
        "# Friction laws\n",
        "Written by `./microstage laws --markdown`; change the sources, not this page.\n",
        plain(PROTOCOL) + "\n",
        f"## {HEADLINE}\n",
        plain(CONTACT) + "\n",
        *grid(("property", *(law.title for law in LAWS)), rows_of(table)),
        "\n## Beside the paper's section 3.3\n",
        *grid(STATEMENT_COLUMNS, statements_of(table)),
        "",
        inspect.cleandoc(REMARKS),
        "\n## Criteria\n",
        *(f"- **{row}**: {plain(inspect.getdoc(run)).partition(': ')[2]}" for row, run in EXPERIMENTS.items()),
        "\n## Equations and sources\n",
        "F is the law's force (N, or N m), q its displacement (m, or rad), w = dq/dt.\n",
    ]
    for law in LAWS:
        parts += [f"### {law.title} (`{law.name}`)\n", without_roles(inspect.cleandoc(law.file.__doc__ or "")), ""]
        parts += [f"- `{name}`: {spec.meaning} [{GENERAL_UNITS[spec.unit]}]." for name, spec in law.own.items()]
        parts += [""]
    return without_blank_runs("\n".join(parts))


PROTOCOL = """
    All laws stand behind one protocol (`microstage_ros/model/friction/registry.py`): velocity, linear in time over the
    step, goes in; force comes out; the step is split where the velocity changes sign and where a block reaches its
    limit. Every law takes its limits, Stribeck curve and viscous friction apart for each direction.
"""
CONTACT = """
    One contact for all, the paper's actuator and gearhead (Tables 1 and 2). Every number is relative; what it is,
    and from where on it counts as *yes*, stands under *Criteria*.
"""
REMARKS = """
    What the numbers say where they differ from the paper, or add to it:

    - **Rising static friction.** While a contact stands still the state of LuGre, and of every law built on it,
      stands still too: breakaway does not depend on the dwell. What these laws have is breakaway that falls with the
      rate of loading (*breakaway spread*), which experiments with a fixed rate after different dwells do not show.
    - **Memory.** The loops of Leuven and of Hsieh–Pan close within 1.5 %, not exactly: what remembers is F_h, and the
      rate equation or the creep moves it along the way. Only the Maxwell-slip family keeps the rules to rounding.
      The elasto-plastic law keeps them for loops inside its elastic zone and loses them beyond.
    - **Drift.** LuGre and Dahl walk away under an oscillation far below breakaway; the elasto-plastic law and the
      Maxwell-slip family hold.
    - **Energy.** Generalised Maxwell-slip as published (Eq. 7) is not passive: while the axis barely moves, a slipping
      block climbs back to its static limit and returns that energy on the reversal. The parameter `passive` of the
      law removes it (and nothing else); without it the equations are those of the paper.
"""


if __name__ == "__main__":
    sys.exit(main())
