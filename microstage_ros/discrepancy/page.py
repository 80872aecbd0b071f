"""The page of a diagnosis: verdict, the picture that convinces, causes, gain, what to do next, details.

Takes the mapping of report.json for every number, so that page and file cannot differ, and the
`Diagnosis` for the pictures.
"""

import html

from microstage_ros.discrepancy.drawing import bars, curves
from microstage_ros.discrepancy.words import VERDICTS, advice_for, name_of
from microstage_ros.report.page import Page

PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))
SCALED = ("V", "A", "m", "s", "N", "N m", "Hz", "rad", "m/s")


def headline(report):
    """The verdict in one sentence: the largest causes with their share, and what is open."""
    names = [name_of(cause["id"]).lower() for cause in report["causes"]]
    text = VERDICTS[report["verdict"]]
    if names:
        text = f"{text[:-1]}: {_listed(names)}."
    if report["rivals"]:
        text += " Open: " + "; ".join(" or ".join(name_of(i).lower() for i in r["ids"]) for r in report["rivals"]) + "."
    return text


def _listed(words):
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def quantity(value, unit, digits=3):
    """Value with unit and prefix: 2.5e-5 m as ``25 µm``; ``–`` for None."""
    if value is None:
        return "–"
    if unit == "1":
        return f"{value:.{digits}g}"
    factor, prefix = 1.0, ""
    if unit in SCALED and value:
        factor, prefix = next((p for p in PREFIXES if abs(value) >= p[0]), PREFIXES[-1])
    return f"{value / factor:.{digits}g} {prefix}{unit}"


def write_page(report, diagnosis, axis, path):
    """Write report.html. Raises OSError if it cannot be written."""
    page = Page("What the axis does and the model does not", f"{axis.name} · {report['verdict'].replace('_', ' ')}")
    page.lead(headline(report))
    if report["gain"]:
        page.figures(_key_figures(report["gain"]))
    if diagnosis.pictures:
        page.picture(curves(diagnosis.pictures[0]), _caption(diagnosis.pictures[0]))
    _causes(page, report["causes"])
    _next(page, report)
    _where(page, diagnosis)
    _details(page, report, axis)
    page.write(path)


def _key_figures(gain):
    unit = gain["unit"]
    removed = _removed(gain)
    low, high = (quantity(v, unit) for v in gain["ci95"])
    figures = [("before", quantity(gain["before"], unit), "axis file as given"),
               ("after", quantity(gain["after"], unit), f"95 %: {low} … {high}"),
               ("noise", quantity(gain["floor"], unit), "what no model can take away")]
    if removed is not None:
        figures.append(("removed", f"{removed:.0%}", "of what stood out of the noise"))
    return figures


def _removed(gain):
    """Share of the excess over the noise floor, in mean square, that the causes take away; None if there is none."""
    excess = gain["before"] ** 2 - gain["floor"] ** 2
    if excess <= 0.0:
        return None
    return min(max((gain["before"] ** 2 - max(gain["after"], gain["floor"]) ** 2) / excess, 0.0), 1.0)


def _caption(picture):
    return picture.title if not picture.cause else f"{picture.title}: {name_of(picture.cause).lower()}"


def _causes(page, causes):
    if not causes:
        return
    page.section("Causes that are sure")
    rows = []
    for cause in causes:
        sizes = "<br>".join(f"{html.escape(name)} = {_with_interval(p)}" for name, p in cause["parameters"].items())
        gain = cause["gain"]
        fell = f"{quantity(gain['before'], gain['unit'])} → {quantity(gain['after'], gain['unit'])}"
        rows.append((f"<b>{html.escape(name_of(cause['id']))}</b><br><code>{cause['id']}</code>",
                     f"{html.escape(cause['sentence'])}<br><small>{sizes}</small>", f"{cause['share']:.0%}", fell))
    page.table(("cause", "size", "share", "held-out rms"), rows)


def _with_interval(parameter):
    value, spread, unit = parameter["value"], parameter["stderr"], parameter["unit"]
    if value is None or spread is None:
        return quantity(value, unit)
    return f"{quantity(value, unit)} ({quantity(value - 1.96 * spread, unit)} … {quantity(value + 1.96 * spread, unit)})"


def _next(page, report):
    page.section("What to do next")
    items = [f"<b>{html.escape(name_of(cause['id']))}:</b> {html.escape(advice_for(cause['id']))}" for cause in report["causes"]]
    for rivals in report["rivals"]:
        items.append(f"<b>Open: {' or '.join(html.escape(name_of(i).lower()) for i in rivals['ids'])}.</b> "
                     f"{html.escape(rivals['why'])}. Run <code>{rivals['experiment']}</code> on the machine, "
                     "record it, and diagnose again with that record.")
    if report["verdict"] == "unexplained":
        strongest = [f["coordinate"] for f in report["findings"] if f["significant"]][:2]
        items.append("Nothing in the catalogue fits. The residual goes with "
                     + (html.escape(_listed(strongest)) if strongest else "none of the coordinates examined")
                     + "; look for what changes along it.")
    if report["verdict"] == "agrees":
        items.append("Nothing. Keep these records as a baseline for later.")
    else:
        items.append("<code>extended.yaml</code> is the axis file with these causes; <code>simulate</code> and the driver "
                     "run it as it is.")
    page.items(items)


def _where(page, diagnosis):
    if diagnosis.findings:
        page.section("Where model and measurement part")
        page.picture(bars(diagnosis.findings), "How strongly the residual goes with each coordinate, against what chance gives "
                     "on a healthy axis (dashed)")
    for picture in diagnosis.pictures[1:]:
        page.picture(curves(picture), _caption(picture))


def _details(page, report, axis):
    page.section("Details")
    gain = report["gain"]
    if gain:
        page.paragraph(f"{html.escape(gain['metric'])}. Held out: {html.escape(', '.join(gain['records']))}.")
    page.items([html.escape(note) for note in report["notes"]])
    if report["identified"]:
        page.paragraph("Numbers of the axis file that were fitted along:")
        page.table(("number", "as given", "fitted (95 %)"),
                   [(f"<code>{key}</code>", quantity(axis.value(key), number["unit"], 4), _with_interval(number))
                    for key, number in report["identified"].items()])
    sources = "; ".join(f"{kind}: {', '.join(map(str, names)) or 'none'}" for kind, names in report["sources"].items())
    page.paragraph(html.escape(f"Axis file {report['axis']}; {sources}; seed {report['seed']}; "
                               f"microstage_ros {report['version']}."))
