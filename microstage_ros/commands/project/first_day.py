"""What the page on the first day shows: its commissioning, run as printed, with the pictures that it makes."""

import contextlib
import io
import os
import re
import tempfile
from pathlib import Path

from microstage_ros.files import write_text
from microstage_ros.places import SOURCE, config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.report.drawing_file import standalone

SKETCH = re.compile(r"```yaml\n# sketch\.yaml\n(.*?)```", re.DOTALL)
PICTURE = re.compile(r'aria-label="([^"]*)"[^>]*>\s*<div class="wide-form">\s*(<svg.*?</svg>)', re.DOTALL)
FOLDER = "pictures"
"""Beside the page."""


def measured(page: str | Path) -> str:
    """Commission the shipped axis from the page's own sketch; write the drawings of its report beside the page.

    Returns
    -------
    str : Markdown, what the command prints and the drawings. Raises `InputError`: the page has no sketch, or the
    commissioning refuses.
    """
    from microstage_ros.commands.operation import commission

    page = Path(page)
    sketch = SKETCH.search(page.read_text(encoding="utf-8"))
    if sketch is None:
        raise InputError(page, "no block that begins with `# sketch.yaml`", "the sketch that the page explains")
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()) as printed:
        here = Path(folder)
        write_text(here / "sketch.yaml", sketch[1])
        machine = str(config_file("axis.yaml"))
        status = commission.main(["--axis", str(here / "sketch.yaml"), "--machine", machine, "--seed", "3",
                                  "--out", str(here / "today")])
        words = printed.getvalue().replace(f"{folder}{os.sep}", "").strip()
        if status != 0:
            raise InputError(f"{page}: its sketch", words, "a machine that is ready")
        report = (here / "today" / "report.html").read_text(encoding="utf-8")
    return "\n".join(["```text", words, "```", "", *_drawings(report, page)])


def _drawings(report, page):
    """The drawings of a report as files beside the page: a line of Markdown each."""
    style = (SOURCE / "microstage_ros" / "report" / "page.css").read_text(encoding="utf-8")
    palette = style[:style.index("@media print")]
    os.makedirs(page.parent / FOLDER, exist_ok=True)
    for title, element in PICTURE.findall(report):
        name = f"{FOLDER}/{page.stem}_{re.sub('[^a-z]+', '_', title.lower()).strip('_')}.svg"
        write_text(page.parent / name, standalone(element, palette))
        yield f"![{title}]({name})\n"
