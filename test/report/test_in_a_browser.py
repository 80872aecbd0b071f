"""Pages in a browser: nothing on the console, nothing cut off at a phone's width, ink on paper in dark mode."""

import re

import numpy as np
import pytest
from browser import PROGRAM, Browser

from microstage_ros.report.page import Page
from microstage_ros.report.plots import new_figure

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no Chromium on this machine")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A page with everything that pages have: cards, wide tables, long words, figures, folded parts."""
    made = Page("A page of everything", "paper axis; nothing moved", configuration="config/axis.yaml", seed=1)
    made.verdict("12 parameters are determined by these records, 13 are not.", "caution", "What is not determined keeps its value.")
    made.section("Parameters")
    made.table(["parameter", "identified", "95 % interval", "before", "how"],
               [[f"contacts.actuator.stribeck_velocity_{k}", "171 ± 26 mrad/s", "120.9 … 221.3 mrad/s", "180.0 mrad/s", "torque balance"]
                for k in range(12)], "A table that is wider than a phone")
    figure, axes = new_figure(2, 1, sharex=True)
    for row in axes:
        row.plot(np.linspace(0.0, 1.0, 500), np.sin(np.linspace(0.0, 20.0, 500)), label="measured")
        row.set_ylabel("position [µm]")
    axes[0].legend()
    made.figure(figure, "Two plots, one above the other", "two sines")
    with made.details("Records"):
        made.list(["/a/rather/long/path/without/any/space/in/it/of_a_record_that_was_made_yesterday.mcap"])
    path = tmp_path_factory.mktemp("page") / "page.html"
    made.save(path)
    return path


@pytest.fixture(scope="module")
def browser():
    """A running Chromium."""
    with Browser() as running:
        yield running


def brightness(colour):
    """Of ``rgb(r, g, b)``, 0 to 255."""
    return np.mean([int(part) for part in re.findall(r"\d+", colour)[:3]])


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [1400, 390])
def test_page_reads(browser, page, width, dark):
    seen = browser.look(page, width, dark)
    assert not seen["errors"] and not seen["cut"]
    assert seen["width"] <= width and "12 parameters are determined" in seen["text"]
    assert (brightness(seen["ink"]) > brightness(seen["background"])) == dark
    assert abs(brightness(seen["ink"]) - brightness(seen["background"])) > 120.0


SCROLLS = """document.title = [...document.querySelectorAll("pre, .wide")].map(
  box => box.tagName + (box.scrollWidth > box.clientWidth + 2 ? " scrolls" : " is whole")).join(", "); document.body.append(document.title);"""


def test_code_and_broad_tables_are_whole_where_the_window_has_room(browser, tmp_path):
    """A line of code goes on below; a table of many columns may be broader than the text. On a phone it scrolls, and says so."""
    page = Page("Code and a broad table")
    page.section("LOG.yaml")
    page.code("following_error: {column: position_error, unit: mm}     # a guess: the file does not tell it (range 10.64); " + "why it is so, " * 10)
    page.section("Moves")
    page.table([f"bias pooled (95 %) {k}" for k in range(10)], [["self_tuning", *["−5.0 (−6.3 … −3.7)"] * 4, 1, 2, 3, 4, 5]])
    page.save(tmp_path / "page.html")
    wide, narrow = (browser.look(tmp_path / "page.html", width, before=SCROLLS) for width in (1600, 390))
    assert "PRE is whole, DIV is whole" in wide["text"] and wide["width"] <= 1600 and "scroll it sideways" not in wide["text"]
    assert "PRE is whole, DIV scrolls" in narrow["text"] and narrow["width"] <= 390 and "scroll it sideways" in narrow["text"]


def test_what_is_cut_off_and_what_fails_is_noticed(browser, tmp_path):
    path = tmp_path / "bad.html"
    path.write_text("<p style='width: 2000px; text-align: right'><b>beyond</b></p><script>console.error('broken')</script>")
    seen = browser.look(path, 390)
    assert seen["errors"] == ["broken"] and "beyond" in seen["cut"]
