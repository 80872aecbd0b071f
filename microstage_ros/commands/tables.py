"""Tables of measured figures in Markdown files: the code that they are about, and putting one in its place.

How a table stands in a page, and when it is stale: `microstage_ros.report.stamped`.
"""

import functools
import textwrap
from pathlib import Path

from microstage_ros.files import write_text
from microstage_ros.places import SOURCE
from microstage_ros.quantities.errors import InputError
from microstage_ros.report.stamped import read_tables, stamp_now, write_table

CONTROL = ("control", "model", "solver")
#: What decides the answer to a screw axis's records, and what makes these: not its pages, nor logs of other machines
DIAGNOSIS = (
    *(f"diagnosis/{part}" for part in (
        "batch.py", "beyond_the_known.py", "case.py", "result.py", "catalogue", "preprocessing", "prerequisites",
        "residuals", "selection")),
    *(f"diagnosis/validation/{part}.py" for part in (
        "campaign", "fault_injection", "second_world", "simulated_records", "ways")),
    "model", "solver")
FORCE_BALANCE = (*(f"diagnosis/resimulation/{name}.py" for name in (
    "candidates", "closed_loop", "diagnose", "fewer", "fit", "folds", "noise", "pictures", "rests",
    "selection")),
    "solver", "control/laws")
FIRST_DAY = ("commissioning", "identification", "control", "model", "solver")
CODE = {("figures", "emps"): FORCE_BALANCE, ("figures", "first-day"): FIRST_DAY, "figures": DIAGNOSIS,
        "compare": CONTROL, "robustness": CONTROL}
"""(owner, title), or owner, of a table to the files and folders of microstage_ros that its figures are about."""


def code_of(owner, title):
    """Files and folders of microstage_ros that a table is about."""
    return CODE.get((owner, title)) or CODE[owner]


def command_of(owner, title):
    """The command that measures a table anew."""
    return f"./microstage figures {title if owner == 'figures' else owner}"


def body(header, rows, remark):
    """Markdown of a table: heads, rows of text, and a remark below it."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([*lines, "", *([*textwrap.wrap(remark, 118), ""] if remark else [])])


@functools.cache
def stamp_of_code(code):
    """`Stamp` with the code as it is when this is first asked: before the measurement, not after it; ``code``: names,
    shape (n,), of files and folders of microstage_ros."""
    return stamp_now(SOURCE, code)


def check_documents(documents):
    """See that the files of ``--update`` are there, and which code their tables will be measured with. Raises
    `InputError`: one is not."""
    for document in documents:
        if not Path(document).is_file():
            raise InputError("--update", document, "a file that exists")
    for code in {code_of(table.owner, table.title) for document in documents for table in read_tables(document)}:
        stamp_of_code(code)


def update_tables(documents, tables, owner):
    """Replace those tables of Markdown files that stand there under their titles, and stamp them.

    Parameters
    ----------
    documents : paths. tables : of (title, header, rows, remark). owner : the command that made them.

    Raises
    ------
    InputError : a table of a file has no end mark.
    """
    for document in documents:
        there = {(table.owner, table.title) for table in read_tables(document)}
        for title, *table in tables:
            if (owner, title) in there:
                write_table(document, owner, title, body(*table), stamp_of_code(code_of(owner, title)))


def save_markdown(path, tables):
    """Write tables (title, header, rows, remark) to a Markdown file, each below its title."""
    write_text(path, "\n".join(f"### {title}\n\n{body(*table)}" for title, *table in tables))
