"""A matplotlib figure as a vector drawing that lives in a page: colours of the page's scheme, a narrow form for
phones."""

import io
import pickle
import re
import textwrap

NARROW_INCH = 4.1
"""Width of the form for narrow windows: text keeps its size at 390 pixels."""

MOST_OF_WIDTH = 0.75
"""Share of a narrow form's width that a line below an axis may take."""

NARROWEST_ROW_INCH = 2.1
JOINED_FROM = 60
"""Markers in a row that are joined to one path."""
INK = {"#1d2329": "ink", "#000000": "ink", "#59636e": "soft", "#e4e8ec": "line", "#d8dde3": "line", "#8a949e": "soft",
       "#cccccc": "line", "#b0b0b0": "line", "#808080": "soft"}
"""Colours of text, axes and grid to the page's variables, so that a dark page has light ones."""

DATA = {"#0072b2": "data-blue", "#56b4e9": "data-sky", "#d55e00": "data-orange", "#009e73": "data-green"}
"""Colours of data that need another lightness on a dark page."""


def drawing(figure, salt, narrow=False):
    """The SVG element of a figure, text as text.

    Parameters
    ----------
    figure : matplotlib figure. salt : makes the names inside unlike those of other drawings of the page.
    narrow : in the form for narrow windows; the figure itself is left as it was.

    Returns
    -------
    str : the element, the same for the same figure and salt.
    """
    return _as_page_element(_svg(narrowed(figure) if narrow else figure, salt))


def standalone(element: str, palette: str) -> str:
    """A drawing of a page (`drawing`) as the text of an SVG file, which other pages show as an image.

    Parameters
    ----------
    element : of `drawing`. palette : CSS that gives the page's variables their colours, for light and dark.
    """
    head = ('<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
            'font-family="sans-serif" style="background: var(--paper)" ')
    return element.replace("<svg ", head, 1).replace(">", f">\n<style>{palette}</style>", 1) + "\n"


def narrowed(figure):
    """A copy of the ``figure``, laid out for a narrow window."""
    from microstage_ros.report.plots import legend_above  # it imports matplotlib

    figure = pickle.loads(pickle.dumps(figure))
    rows = max(
        (axes.get_subplotspec().get_gridspec().nrows for axes in figure.axes if axes.get_subplotspec()), default=1
    )
    figure.set_size_inches(NARROW_INCH, max(figure.get_size_inches()[1], NARROWEST_ROW_INCH * rows))
    for axes in figure.axes:
        if axes.get_legend() is not None:
            legend_above(axes)
        label = axes.xaxis.label
        share = label.get_window_extent().width / (MOST_OF_WIDTH * figure.bbox.width)
        if share > 1.0:
            label.set_text(textwrap.fill(label.get_text(), int(len(label.get_text()) / share)))
        axes.locator_params(axis="x", nbins=5) if axes.get_xscale() == "linear" and _plain_ticks(axes.xaxis) else None
    return figure


def _plain_ticks(axis):
    """Whether the ticks of an axis are matplotlib's own choice, not places that the figure named."""
    from matplotlib.ticker import MaxNLocator

    return isinstance(axis.get_major_locator(), MaxNLocator)


def fits_narrow(figure):
    """Whether the figure can be laid out narrow: no two plots side by side."""
    return all(axes.get_subplotspec().get_gridspec().ncols == 1 for axes in figure.axes if axes.get_subplotspec())


def _svg(figure, salt):
    from matplotlib import rc_context  # half a second that pages without figures need not wait

    out = io.BytesIO()
    with rc_context({"svg.hashsalt": salt, "svg.fonttype": "none"}):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    return out.getvalue().decode("utf-8")


def _dots(text):
    """Long rows of round markers as one path each: a dot is a line of no length with round ends."""
    sizes = {name: 2.0 * max(abs(float(n)) for n in re.findall(r"-?[\d.]+", path))
             for name, path in re.findall(r'<path id="(\w+)" d="([^"]*)"', text) if "C" in path}

    def joined(found):
        uses = re.findall(r'<use xlink:href="#(\w+)" x="([^"]+)" y="([^"]+)" style="([^"]*)"/>', found[0])
        if len({(name, style) for name, _, _, style in uses}) > 1 or uses[0][0] not in sizes:
            return found[0]
        colour = re.findall(r"fill: ?([^;]+)", uses[0][3])[0]
        faint = re.search(r"(?:fill-)?opacity: ?([\d.]+)", uses[0][3])
        way = "".join(f"M{x} {y}h0" for _, x, y, _ in uses)
        return (
            f'<path d="{way}" style="fill: none; stroke: {colour}; stroke-width: {sizes[uses[0][0]]:.2f};'
            " stroke-linecap: round"
            + (f"; stroke-opacity: {faint[1]}" if faint else "")
            + '"/>'
        )

    return re.sub(rf"(?:<use [^>]*/>\s*){{{JOINED_FROM},}}", joined, text)


def _as_page_element(text):
    """An SVG file as an element of a page: no prologue, no unused names, short numbers, colours by variable."""
    text = text[text.index("<svg"):]
    text = re.sub(r"<metadata>.*?</metadata>\s*|<!--.*?-->\s*", "", text, flags=re.S)
    used = set(re.findall(r"[\"(]#([^\")]+)", text))
    text = re.sub(r' id="([^"]+)"', lambda found: found[0] if found[1] in used else "", text)
    text = re.sub(
        r"<[^>]+>", lambda tag: re.sub(r"(\d\.\d\d)\d+", r"\1", tag[0]), text
    )  # places, not the labels' numbers
    text = re.sub(r'<style type="text/css">.*?</style>', "", text, flags=re.S)
    text = _dots(text)
    for colour, name in {**INK, **DATA}.items():
        text = re.sub(rf"((?:fill|stroke): ?){colour}", rf"\1var(--{name})", text, flags=re.I)
    text = re.sub(r"; font-family: [^;\"]*", "", text)  # the page's
    text = re.sub(
        r'<svg [^>]*?viewBox="([^"]+)"[^>]*>', r'<svg viewBox="\1" role="img" fill="var(--ink)">', text, count=1
    )
    return re.sub(r"\n\s*", "\n", text).strip()
