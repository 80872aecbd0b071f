"""A report as one HTML file that needs nothing beside it: verdict first, figures, details below.

    page = Page("Accuracy of the axis", "simulated", configuration="config/axis.yaml", seed=1)
    page.verdict("All four targets are reached within 200 nm.", "good")
    page.key_figures([("4s at 10 µm", "120 nm", "paper: 160 nm")])
    page.section("Moves")
    page.table(["target", "4s"], [["10 µm", "120 nm"]])
    page.figure(figure, "Position against time", "Four curves that settle on their targets")
    with page.details("How it was measured"):
        page.text("…")
    page.save("report.html")
"""

import base64
import functools
import io
import math
import re
from contextlib import contextmanager
from pathlib import Path

import jinja2
from markupsafe import Markup, escape

from microstage_ros import __version__
from microstage_ros.files import write_text
from microstage_ros.quantities.errors import InputError
from microstage_ros.report.drawing_file import drawing, fits_narrow

TONES = {"good": "✓", "caution": "!", "bad": "✗", "neutral": "i"}
"""Tone of a verdict to its mark; tone is never shown by colour alone."""

LARGEST_SVG = 300_000
"""Characters beyond which a drawing is kept as a picture of pixels."""

MOST_COLUMNS = 6
"""Columns of a table beyond which it may be broader than the text, where the window is."""

PICTURE_DPI = 180
SCREEN_DPI = 96


@functools.cache
def _beside(name):
    """The text of the template, its style or its script, which lie beside this file and are put into every page."""
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


class Page:
    """One report, built from top to bottom.

    Parameters
    ----------
    title, subtitle : what the page is about; say here if the axis was simulated.
    configuration : file or words that name the configuration.
    seed : of everything random in it.
    about : further lines of the footer, name to text.
    """

    def __init__(self, title, subtitle="", configuration=None, seed=None, about=None):
        self.title, self.subtitle = title, subtitle
        self._about = [("Version", f"microstage_ros {__version__}")]
        self._about += [(name, str(value)) for name, value in (("Configuration", configuration), ("Seed", seed))
                        if value is not None]
        self._about += [(name, str(value)) for name, value in (about or {}).items()]
        self._verdict, self._figures = None, 0
        self._lead, self._sections = [], []
        self._parts = self._lead

    def verdict(self, sentence, tone="neutral", more=""):
        """The answer in one sentence. tone : good, caution, bad or neutral; more : what to do next.

        Raises InputError: an unknown tone.
        """
        if tone not in TONES:
            raise InputError("verdict: tone", tone, "one of " + ", ".join(TONES))
        self._verdict = {"sentence": sentence, "tone": tone, "mark": TONES[tone], "more": more}

    def key_figures(self, figures):
        """Figures to see at a glance: list of (name, value with unit, remark or '')."""
        entries = [(*figure, "")[:3] for figure in figures]
        self._parts.append({"kind": "keys", "entries": entries})

    def section(self, title):
        """Begin a section; what follows goes into it."""
        section = {"title": title, "parts": []}
        self._sections.append(section)
        self._parts = section["parts"]

    def heading(self, text):
        """A heading within a section."""
        self._parts.append({"kind": "heading", "text": text})

    def text(self, text):
        """A paragraph."""
        self._parts.append({"kind": "text", "text": text, "note": False})

    def note(self, text):
        """A paragraph of less weight."""
        self._parts.append({"kind": "text", "text": text, "note": True})

    def code(self, text):
        """Lines as they are: a command, a file."""
        self._parts.append({"kind": "code", "text": text})

    def list(self, entries):
        """A list of short texts."""
        self._parts.append({"kind": "list", "entries": list(entries)})

    def table(self, header, rows, caption="", marked=()):
        """A table.

        Parameters
        ----------
        header : names of the columns, with units.
        rows : rows of texts or numbers, shape (rows, columns); None is shown as a dash.
        caption : what the table shows.
        marked : numbers of the rows to bring out, shape (k,).

        Raises
        ------
        InputError : a row of another length than the header.
        """
        shown = [[_cell(value) for value in row] for row in rows]
        for number, row in enumerate(shown):
            if len(row) != len(header):
                raise InputError(f"table {caption or header[0]}: row {number}", f"{len(row)} cells", f"{len(header)}")
        numeric = [k > 0 and all(_is_numeric(row[k]) for row in shown) for k in range(len(header))]
        self._parts.append({"kind": "table", "header": list(header), "rows": shown, "caption": caption,
                            "numeric": numeric, "marked": set(marked)})

    def figure(self, figure, caption="", alt=""):
        """A matplotlib figure, drawn into the page: a vector drawing that zooms, and one for narrow windows.

        A very large one is a picture of pixels. alt : what it shows, for those who cannot see it.
        """
        self._figures += 1
        wide = drawing(figure, f"microstage{self._figures}")
        part = {"kind": "figure", "caption": caption, "alt": alt or caption, "wide": Markup(wide), "narrow": "",
                "width": round(figure.get_size_inches()[0] * SCREEN_DPI), "source": None}
        if len(wide) > LARGEST_SVG:
            part |= {"wide": "", "source": picture(figure)}
        elif fits_narrow(figure):
            part["narrow"] = Markup(drawing(figure, f"microstage{self._figures}n", narrow=True))
        self._parts.append(part)

    @contextmanager
    def details(self, title):
        """What is added inside is folded away behind `title`; on paper it is shown."""
        outer, inner = self._parts, []
        outer.append({"kind": "details", "title": title, "parts": inner})
        self._parts = inner
        try:
            yield self
        finally:
            self._parts = outer

    def html(self):
        """The page as text."""
        environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, finalize=typeset)
        environment.filters |= {"breakable": breakable, "short": is_short, "lines": code_lines}
        environment.globals |= {"style": Markup(_beside("page.css")), "script": Markup(_beside("page.js")),
                                "most": MOST_COLUMNS}
        template = environment.from_string(_beside("page.html"))
        return template.render(title=self.title, subtitle=self.subtitle, verdict=self._verdict, lead=self._lead,
                               sections=self._sections, about=self._about)

    def save(self, path):
        """Write the page; it gets its name when it is complete.

        Raises
        ------
        InputError : the place cannot be written.
        """
        write_text(path, self.html())


def is_short(text):
    """True for a number with its unit, of one line or several, that is not to be broken within a line."""
    return _is_numeric(text) and max(map(len, text.split("\n"))) < 26


HYPHEN = re.compile(r"(?<![^\s(±…])-(?=\.?\d)")
PERCENT = re.compile(r"(?<=\d)[ \u202f]?%")
TIMES = re.compile(r"(?<=[a-z]) x (?=\d)")


def typeset(value):
    """A text as a book sets it: a minus before negative numbers, a space that does not break before per cent.

    Parameters
    ----------
    value : what the template shows, of any type [any unit]; markup, such as code and drawings, stays as it is.
    """
    if not isinstance(value, str) or isinstance(value, Markup):
        return value
    return TIMES.sub(" × ", PERCENT.sub("\u00a0%", HYPHEN.sub("−", value)))


LONG_WORD = re.compile(r"[\w./-]{12,}")


def breakable(text):
    """A cell's text in which long names may break after ``_``, ``.`` and ``/``, not within a word: in narrow
    windows."""
    return Markup(LONG_WORD.sub(lambda word: re.sub(r"([_./])(?=\w)", r"\1<wbr>", word[0]), str(escape(typeset(text)))))


def code_lines(text):
    """Code whose long lines go on below, further in, and are copied as they are."""
    return Markup("").join(Markup("<span>{}\n</span>").format(line) for line in text.rstrip("\n").split("\n"))


def picture(figure):
    """A matplotlib figure as pixels in a data address. The same figure always gives the same bytes."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=PICTURE_DPI, metadata={"Software": None})
    return "data:image/png;base64," + base64.b64encode(out.getvalue()).decode()


def _cell(value):
    """A table's cell as text."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.4g}".replace("-", "−") if math.isfinite(value) else "–"
    return str(value)


def _is_numeric(text):
    """True for cells that belong to the right: numbers with or without unit, and dashes."""
    return text == "–" or text.lstrip("−-+±<≤>≥~ ")[:1].isdigit()
