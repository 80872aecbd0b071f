"""The page that a technician reads: what changed, how much, since when, how sure, what else, what to look at, what
would decide."""

import math

from microstage_ros.diagnosis.logs.preprocessing.channels import FLUCTUATION
from microstage_ros.diagnosis.logs.selection import course as course_module
from microstage_ros.diagnosis.logs.report import pictures
from microstage_ros.diagnosis.report.wording import TONES, advice_for, listed, name_of, worded
from microstage_ros.report.page import Page
from microstage_ros.quantities.readable import quantity

SHOWN = 4
# of the rows of now, below which an answer that nothing has changed says so with that reserve
LEAST_COMPARED = 0.5
VERDICTS = {
    "agrees": "Nothing has changed beyond what this machine differs from itself.",
    "explained": "What has changed is found",
    "partly_explained": "Part of what has changed is found; something is left",
    "undetermined": "Something has changed, and these logs cannot tell which of the names below it is",
    "unexplained": "Something has changed, and none of the known causes fits it.",
}


def headline(report):
    """The answer in one sentence."""
    names = [f"{name_of(c['id']).lower()} ({size_of(c)})" for c in report["causes"]]
    opened = [listed([name_of(i).lower() for i in r["ids"]], "or") for r in report["rivals"]]
    text = VERDICTS[report["verdict"]]
    if report["verdict"] == "agrees" and report["compared"] < LEAST_COMPARED:
        return (
            f"Only {report['compared']:.0%} of these logs move as the baseline does; in that part nothing has changed,"
            " the rest is not known."
        )
    if names:
        text = f"{text}: {'; '.join(names)}" if report["verdict"] != "undetermined" else f"Found: {'; '.join(names)}"
    if opened:
        text += f"{'. Open' if names else ''}: {'; '.join(opened)}"
    return text.rstrip(".") + "."


def _tone(report):
    return (
        "caution" if report["verdict"] == "agrees" and report["compared"] < LEAST_COMPARED else TONES[report["verdict"]]
    )


def size_of(cause):
    """The first size of a cause in words, with its 95 % interval."""
    for name, p in cause["parameters"].items():
        value, spread = p["value"], p["stderr"]
        if value is None:
            continue
        if name == "factor" or name.endswith("_factor"):
            return _per_cent(value - 1.0, spread, "+")
        if p["unit"] == "1":
            return _per_cent(value, spread)
        return (
            f"{quantity(value, p['unit'])}, 95 %: {quantity(value - 1.96 * spread, p['unit'])} …"
            f" {quantity(value + 1.96 * spread, p['unit'])}"
        )
    return "size open"


def _per_cent(value, spread, sign=""):
    """A share ``value`` [1] with standard uncertainty ``spread`` [1]: it and its 95 % interval in words [%], rounded to
    the first significant digit of the interval's half width."""
    half = 196.0 * spread
    decimals = min(max(0, -math.floor(math.log10(half))), 6) if half > 0.0 else 0
    low, high = 100.0 * value - half, 100.0 * value + half
    return f"{100.0 * value:{sign}.{decimals}f} %, 95 %: {low:{sign}.{decimals}f} … {high:{sign}.{decimals}f} %"


def write_page(report, result, path, description):
    """Write report.html. Raises InputError if it cannot be written."""
    name = description.name or description.place
    page = Page("What has changed on this machine", name, configuration=report["log"], seed=report["seed"],
                about={"Baseline": _sources(report["sources"]["baseline"]), "Now": _sources(report["sources"]["now"])})
    page.verdict(headline(report), _tone(report), more=_more(report))
    page.key_figures(_figures(report, result))
    main = "effort" if "effort" in result.evidence["reduced"] else next(iter(result.evidence["reduced"]))
    of_error = any(c["channel"] == "error" for c in report["causes"])
    if of_error and result.context.channels["error"].kind != FLUCTUATION:
        main = "error"
    _figure(
        page,
        pictures.over_stroke(result, main),
        "Over the stroke, each direction by itself: the baseline with its spread from run to run, now, "
        "and the baseline with the named causes added.",
    )
    if report["causes"] or report["rivals"]:
        _causes(page, report)
    page.section("What to do next")
    page.list(_next(report))
    _course(page, report, result)
    page.section("Measured and model in time")
    for channel in (name for name, c in result.evidence["reduced"].items() if c.channel.kind != FLUCTUATION):
        _figure(
            page, pictures.in_time(result, channel), f"{channel.capitalize()}: the first stretch of the logs of now."
        )
    if any(
        "ripple" in i for i in [c["id"] for c in report["causes"]] + [i for r in report["rivals"] for i in r["ids"]]
    ):
        _figure(page, pictures.ripple(result), "Ripple by its order: cycles per turn.")
    _blind(page, report)
    _healthy(page, report)
    if report["notes"]:
        page.section("About the logs")
        page.list(report["notes"])
    page.save(path)


def _figure(page, figure, caption):
    if figure is not None:
        page.figure(figure, caption, caption)


def _sources(names):
    return ", ".join(map(str, names[:SHOWN])) + (f" … ({len(names)} in all)" if len(names) > SHOWN else "")


def _more(report):
    if report["verdict"] == "agrees":
        seen = sum(entry["visible"] for entry in report["visible"].values())
        return f"{seen} of the catalogue's effects would show in these signals; what would not is listed below."
    if report["rivals"]:
        return f"This would decide: {report['rivals'][0]['experiment']}."
    return ""


def _figures(report, result):
    repeats = {s: min(spread.repetitions.values()) for s, spread in result.evidence["spreads"].items()}
    groups = max(max(spread.groups.values()) for spread in result.evidence["spreads"].values())
    figures = [("Baseline", f"{min(repeats.values())} repetitions", f"{groups} log{'s' if groups > 1 else ''}")]
    gain = report["gain"]
    figures.append(("Change from the baseline", f"{gain['before']:.1f} ×", "the usual scatter from run to run (rms)"))
    if report["causes"] or report["rivals"]:
        figures.append(("Left over", f"{gain['after']:.1f} ×", "the same, with what is named taken out"))
    for cause in report["causes"][:2]:
        size, _, spread = size_of(cause).partition(", ")
        certainty = f"probability {cause['probability']:.2f}"
        figures.append((name_of(cause["id"]), size, f"{spread}; {certainty}" if spread else certainty))
    return figures


def _causes(page, report):
    page.section("What has changed")
    since = {entry["id"]: entry for entry in report["since"]}
    rows = []
    for cause in report["causes"]:
        rows.append(
            (
                name_of(cause["id"]),
                size_of(cause),
                _since(since.get(cause["id"])),
                f"{cause['share']:.0%}",
                f"{cause['probability']:.2f}",
            )
        )
    if rows:
        page.table(
            ("cause", "how much", "since", "share", "probability"),
            rows,
            "Share: of what stands out. Probability: that the cause is there and rightly named, calibrated on simulated"
            " machines.",
        )
    if report["rivals"]:
        page.heading("What cannot be distinguished")
        page.table(("one of", "why", "this would decide"), [
            (", ".join(name_of(i).lower() for i in r["ids"]), worded(r["why"], r["ids"]), r["experiment"])
            for r in report["rivals"]])
    with page.details("All fitted sizes with their 95 % intervals"):
        page.table(
            ("cause", "size", "value", "from", "to"),
            [
                (
                    c["id"],
                    name,
                    quantity(p["value"], p["unit"]),
                    quantity(p["value"] - 1.96 * p["stderr"], p["unit"]),
                    quantity(p["value"] + 1.96 * p["stderr"], p["unit"]),
                )
                for c in report["causes"]
                for name, p in c["parameters"].items()
                if p["value"] is not None and p["stderr"] is not None
            ],
        )


def _since(entry):
    if entry is None:
        return "–"
    return "the first log of now" if entry["from_the_start"] else f"{entry['source']}, repetition {entry['repetition']}"


def _next(report):
    entries = [f"{name_of(c['id'])}: {advice_for(c['id'])}" for c in report["causes"]]
    for rivals in report["rivals"]:
        names = listed([worded(i, [i]) for i in rivals["ids"]], "and")
        entries.append(f"To decide between {names}: {rivals['experiment']}. "
                       f"If it is the first: {advice_for(rivals['ids'][0])}")
    if report["verdict"] in ("unexplained", "partly_explained"):
        strongest = sorted(
            (f for f in report["findings"] if f["significant"]), key=lambda f: -(f["left"] or 0.0) / f["threshold"]
        )[:2]
        entries += [f"What is left shows at: {f['coordinate']} ({f['channel']})." for f in strongest]
    return entries or [
        "Nothing. Keep these logs: with every further healthy log the thresholds become more this machine's own."
    ]


def _course(page, report, result):
    ids = [c["id"] for c in report["causes"]] or [r["ids"][0] for r in report["rivals"]]
    if not ids:
        return
    for stage in result.evidence["stages"]:
        for choice in stage.chosen:
            if choice.name.rstrip("+") == ids[0]:
                points = course_module.course_of(stage, choice.name, result.evidence["groups"])
                changes = course_module.change_points([p.value for p in points], [p.stderr for p in points])
                page.section("Since when")
                _figure(
                    page,
                    pictures.course(points, "change\n[% of the level]", changes),
                    f"{name_of(ids[0])}: size in every repetition with its 95 % interval, against the baseline's mean."
                    + (" Dashed: where its mean changes." if changes else ""),
                )
                return


def _blind(page, report):
    page.section("What these logs can and cannot show")
    shown = [
        (name_of(name), f"{100 * entry['detectable']:.0f} %")
        for name, entry in report["visible"].items()
        if entry["visible"]
    ]
    if shown:
        page.table(
            ("visible here", "from about"),
            shown,
            "Smallest change that would be named, in per cent of the level of friction (or of the following error).",
        )
    page.table(
        ("not visible here", "would need"), [(name_of(name), need) for name, need in report["not_visible"].items()]
    )


def _healthy(page, report):
    page.section("The healthy machine, as its baseline shows it")
    rows = [
        (
            h["channel"],
            h["condition"],
            h["name"],
            quantity(h["value"], h["unit"], stderr=h["stderr"]),
        )
        for h in report["healthy"]
        if h["value"] is not None
    ]
    header = ("channel", "condition", "size", "value ± standard error")
    shown = [k for k in range(len(header)) if k != 1 or any(row[k] for row in rows)]
    page.table([header[k] for k in shown], [[row[k] for k in shown] for row in rows])
