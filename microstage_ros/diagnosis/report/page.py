"""The page of a diagnosis: verdict, the picture that convinces, causes, gain, what to do next, details.

Takes the mapping of report.json for every number, so that page and file cannot differ, and the
`Diagnosis` for the pictures.
"""

from microstage_ros.diagnosis.report.drawing import curves, strengths
from microstage_ros.diagnosis.report.wording import TONES, VERDICTS, advice_for, is_measured, listed, name_of, worded
from microstage_ros.report.page import Page
from microstage_ros.quantities.readable import quantity

STRONGEST = 2                  # coordinates named where no cause fits
SHOWN_SOURCES = 4              # file names listed in the footer


def headline(report):
    """The verdict in one sentence, with what is sure and what is open."""
    names = [name_of(cause["id"]).lower() for cause in report["causes"]]
    text = VERDICTS[report["verdict"]]
    if names and report["verdict"] == "undetermined":
        text = f"Found: {listed(names, 'and')}. Beside that, these records cannot tell what else there is."
    elif names:
        text = f"{text[:-1]}: {listed(names, 'and')}."
    opened = [listed([name_of(i).lower() for i in rivals["ids"]], "or") for rivals in report["rivals"]]
    return text + (f" Open: {'; '.join(opened)}." if opened else "")


def write_page(report, diagnosis, axis, path):
    """Write report.html. Raises InputError if it cannot be written."""
    page = Page("Where the axis and its model part", axis.name, configuration=report["axis"], seed=report["seed"],
                about={kind.capitalize(): _sources(names) for kind, names in report["sources"].items()})
    page.verdict(headline(report), TONES[report["verdict"]], more=_more(report))
    if is_measured(report):
        if not _stands_out(report):
            page.key_figures(_of_learning_records(report))
        else:
            page.key_figures(_key_figures(report["gain"]) if report["causes"] else _without_causes(report["gain"]))
    if diagnosis.pictures:
        _picture(page, diagnosis.pictures[0])
    if report["causes"]:
        _causes(page, report["causes"])
    page.section("What to do next")
    page.list(_next(report))
    if report["consequences"]:
        page.section("What it means for the work")
        page.table(
            ("error of the stage", "as the axis file predicts", "with the causes"),
            [
                (c["name"], quantity(c["before"], c["unit"]), quantity(c["after"], c["unit"]))
                for c in report["consequences"]
            ],
            "The same moves under the shipped controller, simulated with the axis file and with extended.yaml.",
        )
    _where(page, diagnosis)
    _details(page, report, axis)
    page.save(path)


def _sources(names):
    if len(names) > SHOWN_SOURCES:
        return f"{', '.join(map(str, names[:SHOWN_SOURCES]))} … ({len(names)} in all)"
    return ", ".join(map(str, names)) or "none"


def _more(report):
    removed = _removed(report["gain"]) if report["causes"] else None
    return (
        ""
        if removed is None
        else f"On records it had not seen this takes away {removed:.0%} of what stood out of the noise."
    )


def _stands_out(report):
    """Whether the held-out records show anything beyond the noise, or nothing was said to."""
    return report["verdict"] == "agrees" or (_beyond(report["gain"], "before") or 0.0) > 0.0


def _of_learning_records(report):
    """What is said where the held-out records hold nothing: the strongest dependence in those to learn from."""
    strongest = max(report["findings"], key=lambda f: f["left"] / f["threshold"], default=None)
    noise = quantity(report["gain"]["floor"], report["gain"]["unit"])
    cards = [("Noise", noise, "held-out records: nothing beyond it")]
    if strongest is None:
        return cards
    over = strongest["left"] / strongest["threshold"]
    where = f"{strongest['channel']} against {strongest['coordinate']}, records to learn from"
    return [("Strongest dependence", f"{over:.2g} ×", f"the threshold of a healthy axis: {where}"), *cards]


def _without_causes(gain):
    """Before is after where nothing is named."""
    unit = gain["unit"]
    low, high = (quantity(v, unit, 4) for v in gain["ci95"])
    residual = f"residual {quantity(gain['before'], unit, 4)}, 95 %: {low} … {high}"
    return [
        ("Beyond the noise", quantity(_beyond(gain, "before"), unit), f"held-out records; {residual}"),
        _noise(gain),
    ]


def _noise(gain):
    """The card of the noise floor."""
    over = "; all three are residual over noise" if gain["unit"] == "1" else ""
    return "Noise", quantity(gain["floor"], gain["unit"]), f"no model can go below{over}"


def _key_figures(gain):
    """What stands out of the noise, before and after: the residuals themselves may differ in the last digit only."""
    unit = gain["unit"]
    low, high = (quantity(v, unit, 4) for v in gain["ci95"])
    cards = [
        (
            "Beyond the noise before",
            quantity(_beyond(gain, "before"), unit),
            f"axis file as given; {quantity(gain['before'], unit, 4)} with the noise",
        ),
        (
            "Beyond the noise after",
            quantity(_beyond(gain, "after"), unit),
            f"with the causes; {quantity(gain['after'], unit, 4)} with the noise, 95 %: {low} … {high}",
        ),
        _noise(gain),
    ]
    removed = _removed(gain)
    return (
        cards
        if removed is None
        else [*cards, ("Taken away", f"{removed:.0%}", "of the mean square beyond the noise, held-out records")]
    )


def _beyond(gain, when):
    """Rms beyond the noise floor; None where a number is missing."""
    if gain[when] is None or gain["floor"] is None:
        return None
    return max(gain[when] ** 2 - gain["floor"] ** 2, 0.0) ** 0.5


def _removed(gain):
    """Share of the excess over the noise floor, in mean square, that is taken away; None without excess."""
    if None in (gain["before"], gain["after"], gain["floor"]):
        return None
    excess = gain["before"] ** 2 - gain["floor"] ** 2
    if excess <= 0.0:
        return None
    return min(max((gain["before"] ** 2 - max(gain["after"], gain["floor"]) ** 2) / excess, 0.0), 1.0)


def _picture(page, picture):
    caption = picture.title.removeprefix(f"{picture.cause}: ")
    caption = f"{name_of(picture.cause)}: {caption}" if picture.cause else caption[:1].upper() + caption[1:]
    page.figure(curves(picture), caption, f"{picture.y_label} against {picture.x_label}: {', '.join(picture.curves)}")


def _causes(page, causes):
    page.section("Causes that are named")
    rows = [
        (
            name_of(cause["id"]),
            _size(cause),
            f"{cause['share']:.0%}",
            f"{cause['probability']:.2f}",
            quantity(cause["gain"]["before"], cause["gain"]["unit"], 4),
            quantity(cause["gain"]["after"], cause["gain"]["unit"], 4),
        )
        for cause in causes
    ]
    page.table(
        ("cause", "how much", "share", "probability", "residual before", "after"),
        rows,
        "Share: of what stood out of the noise on held-out records; what is left counts where a cause shows or where"
        " something stands above the noise floor. Probability: that the cause is there and rightly named, calibrated on"
        " simulated axes. Residuals: rms there, without and with the cause.",
    )
    with page.details("Fitted sizes with their 95 % intervals"):
        page.table(
            ("cause", "size", "value", "from", "to"),
            [
                (cause["id"], name, *_interval(number))
                for cause in causes
                for name, number in cause["parameters"].items()
            ],
        )


def _size(cause):
    """The sentence of a cause without its name, which stands beside it."""
    size = cause["sentence"].removeprefix(f"{name_of(cause['id'])}: ")
    return size[:1].upper() + size[1:]


def _interval(number):
    """(value, lower and upper end of the 95 % interval) as texts."""
    value, spread, unit = number["value"], number["stderr"], number["unit"]
    if value is None or spread is None:
        return quantity(value, unit) if value is not None else None, None, None
    return tuple(quantity(v, unit) for v in (value, value - 1.96 * spread, value + 1.96 * spread))


def _next(report):
    entries = [f"{name_of(cause['id'])}: {advice_for(cause['id'])}" for cause in report["causes"]]
    for rivals in report["rivals"]:
        entries.append(
            f"Open, {listed([name_of(one).lower() for one in rivals['ids']], 'or')}: "
            f"{worded(rivals['why'], rivals['ids']).rstrip('.')}. "
            f"Run {rivals['experiment']} on the machine, "
            "record it, and diagnose again with that record."
        )
    if report["verdict"] in ("unexplained", "partly_explained"):
        strongest = [f"{f['coordinate']} ({f['channel']})" for f in report["findings"]
                     if f["significant"] and (f["left"] or 0.0) > f["threshold"]][:STRONGEST]
        if strongest:
            entries.append(f"What is left goes with {listed(strongest, 'and')}: look for what changes along it.")
        elif report["verdict"] == "unexplained":
            entries.append(
                "The residual goes with none of the coordinates examined; more records of other motions may show it."
            )
    if report["verdict"] == "agrees":
        entries.append("Nothing. Keep these records: if the axis moves in them, they can serve as --baseline later.")
    elif report["causes"]:
        entries.append("extended.yaml is the axis file with these causes; simulate and the driver run it as it is.")
    return entries


def _where(page, diagnosis):
    if not diagnosis.findings and len(diagnosis.pictures) < 2:
        return
    page.section("Where they part")
    if diagnosis.findings:
        page.figure(
            strengths(diagnosis.findings),
            "How strongly the residual goes with each coordinate. Left of the dashed "
            "line it is what chance gives on a healthy axis.",
            "Bars: strength per coordinate, before and after",
        )
    for picture in diagnosis.pictures[1:]:
        _picture(page, picture)


def _details(page, report, axis):
    page.section("Details")
    gain = report["gain"]
    if is_measured(report):
        page.text(f"Measure: {gain['metric']}. Held out: {', '.join(gain['records'])}.")
    if report["notes"]:
        page.list(report["notes"])
    if report["identified"]:
        page.table(("number of the axis file", "as given", "fitted along", "from", "to"),
                   [(key, quantity(axis.value(key), number["unit"], 4), *_interval(number))
                    for key, number in report["identified"].items()])
