"""The page is whole in itself, says what it was given, and is the same for the same input."""

import html
import re
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest

from microstage_ros.quantities.errors import InputError
from microstage_ros.report.drawing_file import drawing, standalone
from microstage_ros.report.page import LARGEST_SVG, Page, breakable, is_short, picture, typeset
from microstage_ros.report.plots import new_figure, plot_signal


def small_figure():
    figure, axes = new_figure()
    axes.plot([0, 1, 2], [0, 1, 0], label="a & b")
    axes.set_title("A title")
    axes.legend()
    return figure


def full_page():
    page = Page("A <title>", "simulated", configuration="config/axis.yaml", seed=3, about={"Records": "a.csv"})
    page.verdict("It is fine & well.", "good", "Nothing to do.")
    page.key_figures([("4s", "120 nm", "paper: 160 nm"), ("bias", "3 nm")])
    for number in range(4):
        page.section(f"Section {number}")
        page.text("Words <b>.")
        page.note("A remark.")
    page.table(["target", "4s (nm)"], [["1 µm", 98.0], ["2 µm", None], ["3 µm", float("nan")]], "A table", marked=[1])
    page.figure(small_figure(), "A figure", "A triangle")
    page.heading("More")
    page.list(["one", "two"])
    with page.details("Folded"):
        page.code("./microstage demo")
        with page.details("Deeper"):
            page.text("Deep.")
    page.text("After the fold.")
    return page.html()


VOID = ("meta", "img", "br", "link", "input")


class Checker(HTMLParser):
    """Every tag that opens closes, in order."""

    def __init__(self):
        super().__init__()
        self.open, self.seen = [], []

    def handle_starttag(self, tag, attributes):
        self.seen.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_whole_well_formed_and_self_contained():
    text = full_page()
    checker = Checker()
    checker.feed(text)
    assert not checker.open
    assert not re.search(r"(?:src|href)=\"(?!data:|#)", text)
    assert "http" not in re.sub(r"data:[^\"]+", "", text)
    plots = [attributes for tag, attributes in checker.seen if attributes.get("class") == "plot both"]
    assert plots[0]["aria-label"] == "A triangle" and sum(tag == "svg" for tag, _ in checker.seen) == 2


def test_names_in_drawings_are_unique_and_colours_follow_the_scheme():
    page = Page("T")
    page.figure(small_figure())
    page.figure(small_figure())
    text = page.html()
    names = re.findall(r' id="([^"]+)"', text)
    assert len(names) == len(set(names)) and all(f"#{name}" in text for name in names)
    drawings = "".join(re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL))
    assert "var(--ink)" in drawings and "var(--data-blue)" in drawings and "#1d2329" not in drawings and "font-family" not in drawings
    assert ">A title</text>" in drawings and "prefers-color-scheme: dark" in text


def test_the_narrow_form_keeps_the_figure():
    figure = small_figure()
    wide, size = drawing(figure, "a"), tuple(figure.get_size_inches())
    narrow = drawing(figure, "a", narrow=True)
    widths = [float(re.search(r'viewBox="0 0 ([0-9.]+)', text)[1]) for text in (wide, narrow)]
    assert widths[1] < 0.5 * widths[0] and tuple(figure.get_size_inches()) == size


def test_it_says_what_it_was_given():
    text = html.unescape(re.sub(r"<style>.*?</style>|<script>.*?</script>|<svg.*?</svg>|<[^>]*>", " ", full_page(), flags=re.DOTALL))
    for words in ("A <title>", "simulated", "It is fine & well.", "Nothing to do.", "120 nm", "paper: 160 nm", "Words <b>.",
                  "A table", "A figure", "one", "./microstage demo", "Deep.", "config/axis.yaml", "microstage_ros 0.1.0",
                  "a.csv"):
        assert words in text, words
    assert "nan" not in text
    assert full_page().count("<li><a href") == 4
    assert full_page().index("After the fold.") > full_page().rindex("</details>")


def test_same_input_same_bytes():
    assert full_page() == full_page()


def test_large_drawings_become_pictures():
    figure, axes = new_figure()
    for seed in range(8):
        plot_signal(axes, np.arange(100_000), np.random.default_rng(seed).normal(size=100_000))
    page = Page("T")
    page.figure(figure)
    assert picture(figure).startswith("data:image/png;base64,") and picture(figure) in page.html()
    assert len(drawing(small_figure(), "a")) < LARGEST_SVG / 10


def test_it_is_written_and_bad_input_is_told(tmp_path):
    page = Page("T")
    page.save(tmp_path / "deep/report.html")
    assert (tmp_path / "deep/report.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    with pytest.raises(InputError, match="that can be written"):
        page.save(tmp_path / "deep")
    with pytest.raises(InputError, match="one of good"):
        page.verdict("?", "green")
    with pytest.raises(InputError, match="row 1"):
        page.table(["a", "b"], [[1, 2], [1]])


def test_long_names_break_between_their_parts_only():
    assert str(breakable("contacts.actuator.stribeck_velocity")) == "contacts.<wbr>actuator.<wbr>stribeck_<wbr>velocity"
    assert str(breakable("3.40966 ± 0.00078 Ω")) == "3.40966 ± 0.00078 Ω" and str(breakable("<b>")) == "&lt;b&gt;"
    assert is_short("64.8 ± 4.3 mN m/rad\n13.15 ± 0.88 mN m/rad") and not is_short("torque balance")


@pytest.mark.parametrize("given, set_so", [
    ("-8.2", "−8.2"), ("-5.0 (-6.3 … -3.7)", "−5.0 (−6.3 … −3.7)"), ("99% of it", "99\u00a0% of it"), ("95 %: 1 … 2", "95\u00a0%: 1 … 2"),
    ("friction x 0.5", "friction × 0.5"), ("2026-11-29", "2026-11-29"), ("normal_-40kgf.csv", "normal_-40kgf.csv"), ("ISO 230-2", "ISO 230-2"), (3, 3)])
def test_numbers_are_set_as_in_a_book(given, set_so):
    assert typeset(given) == set_so


def test_code_is_kept_to_the_letter():
    page = Page("T")
    page.code("a: -1   # 5% <b>\n\n  b: 2\n")
    shown = re.sub(r"</?span>", "", re.findall(r"<pre>(.*?)</pre>", page.html(), flags=re.DOTALL)[0])
    assert html.unescape(shown) == "a: -1   # 5% <b>\n\n  b: 2\n"


def test_a_drawing_stands_alone_as_a_file_with_its_own_colours():
    """Another page shows it as an image, which has no other style than its own."""
    text = standalone(drawing(small_figure(), "a"), ":root { --ink: #123456; }")
    root = ElementTree.fromstring(text)
    assert root.tag == "{http://www.w3.org/2000/svg}svg" and "--ink: #123456" in root[0].text
    assert root.get("fill") == "var(--ink)" and len(text) > len(drawing(small_figure(), "a"))
