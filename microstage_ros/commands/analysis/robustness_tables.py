"""Tables of ``robustness``: on a terminal and for a document."""

import numpy as np
from rich.console import Console
from rich.table import Table

from microstage_ros.control.robustness import campaign
from microstage_ros.metrology.rates import rate


def of_machines(rows):
    """Sentence: on how many machines a run failed or did not rest, exact 95 % intervals (Clopper and Pearson 1934).

    Runs of one machine are no independent trials; machines drawn at random are.
    """
    parts = []
    for words, keys in (("failed", ("failed",)), ("swung or rested beside the target", ("swinging", "off"))):
        count = sum(any(row[key] for key in keys) for row in rows)
        parts.append(f"machines that {words}: {rate(count, len(rows))}")
    return ", ".join(parts) + ", 95 % intervals"


HEADS = [
    "condition",
    "failed",
    "> 5 um",
    "swings",
    "off",
    "largest (um)",
    "sine (nm)",
    "settled (nm)",
    "swing (nm)",
    "off (nm)",
]


def _heads(arguments):
    """Heads of the columns with figures."""
    beside = [f"{arguments.beside} (um)", "worse for (s)"] if arguments.beside else []
    return [*HEADS[5:], *beside, *(["best fixed (um)"] if arguments.opponents else [])]


def _figures(row, arguments):
    """Figures of a row as text, below `_heads`."""
    found = [
        f"{row['largest'] * 1e6:.3g}",
        *(f"{row[name] * 1e9:.3g}" for name in ("sine", "settled", "swing", "left")),
    ]
    if arguments.beside:
        found += [f"{row['other'] * 1e6:.3g}", f"{row['worse_s']:.3g}"]
    return found + ([_of_fixed(row)] if arguments.opponents else [])


def _of_fixed(row):
    """Best fixed law that rests there, and in brackets one of smaller error that does not."""
    least = min(row["fixed"], key=lambda entry: entry["largest"])
    best = _named(row["best"])
    return best if least["largest"] == row["best"]["largest"] else f"{best} ({_named(least)})"


def _named(fixed):
    """Largest error [um] and law, and whether it swings or rests beside its target."""
    return f"{fixed['largest'] * 1e6:.3g} {fixed['law']}{', not at rest' if fixed['restless'] else ''}"


def _beyond(rows, others):
    """Names of the rows whose largest error is beyond that of the ``others`` [m] by `campaign.FACTOR`."""
    limits = [max(campaign.FACTOR * other, campaign.HARMLESS) for other in others]
    return [row["condition"] for row, limit in zip(rows, limits) if row["largest"] > limit]


def _against_fixed(rows):
    """Sentences: where the law is beyond the best fixed law that rests there, where none does, what each fails."""
    resting = [row for row in rows if not row["best"]["restless"]]
    beyond = _beyond(resting, [row["best"]["largest"] for row in resting])
    nowhere = [row["condition"] for row in rows if row["best"]["restless"]]
    ahead = _beyond(rows, [min(entry["largest"] for entry in row["fixed"]) for row in rows])
    total = sum(row["runs"] for row in rows)
    failed = {}
    for row in rows:
        for entry in row["fixed"]:
            failed[entry["law"]] = failed.get(entry["law"], 0) + entry["failed"]
    return (
        f" Largest error beyond {campaign.FACTOR:g} times that of the best fixed law that rests there and"
        f" {campaign.HARMLESS * 1e9:g} nm: {_listed(beyond)}; of the best that rests or not: {_listed(ahead)}."
        f" No fixed law rests: {_listed(nowhere)}. Of {total} runs each fail:"
        f" {', '.join(f'{law} {count}' for law, count in failed.items())}."
    )


def document(rows, arguments):
    """(header, rows, remark) of the table for a document: conditions one by one, random machines as quantiles."""
    total = sum(row["runs"] for row in rows)
    counts = ", ".join(
        f"{sum(row[key] for row in rows)} {words}"
        for key, words in (
            ("failed", "failed"),
            ("beyond", "beyond 5 um"),
            ("swinging", "swing at rest"),
            ("off", "rest beside their target"),
        )
    )
    last = arguments.seed + arguments.seeds - 1
    remark = f"Worst of the seeds {arguments.seed} … {last}. Of {total} runs {counts}; {of_machines(rows)}."
    if arguments.random:
        remark = f"Machines {arguments.first} … {arguments.first + arguments.random - 1}. {remark}"
    if arguments.beside:
        beyond = _beyond(rows, [row["other"] for row in rows])
        long = [row["condition"] for row in rows if row["worse_s"] > 1.0]
        remark += (
            f" Largest error beyond {campaign.FACTOR:g} times that of {arguments.beside} and"
            f" {campaign.HARMLESS * 1e9:g} nm: {_listed(beyond)}. Worse than it for more than a second:"
            f" {_listed(long)}."
        )
    if arguments.opponents:
        remark += _against_fixed(rows)
    if not arguments.random:
        return (
            ["condition", "failed", *_heads(arguments)],
            [
                [
                    row["condition"],
                    f"{row['failed']} of {row['runs']}" if row["failed"] else "–",
                    *_figures(row, arguments),
                ]
                for row in rows
            ],
            remark,
        )
    keys = ("largest", "sine", "settled", "swing", "left", "other", "worse_s")
    found = []
    for words, share in (("median", 0.5), ("90 %", 0.9), ("worst", 1.0)):
        over = {key: np.quantile([row[key] for row in rows], share) for key in keys}
        if arguments.opponents:
            least = np.quantile([row["best"]["largest"] for row in rows], share)
            over["best"] = {"law": "", "largest": least, "restless": 0}
            over["fixed"] = [over["best"]]
        found.append([words, *_figures(over, arguments)])
    return ["over the machines", *_heads(arguments)], found, remark


def _listed(names, most=12):
    """Number and names, as far as a sentence bears them."""
    return f"{len(names)} ({'; '.join(names)})" if 0 < len(names) <= most else str(len(names))


def show(rows, law, arguments):
    """Print the rows of `campaign.summary` for a ``law``."""
    table = Table(*HEADS[:5], *_heads(arguments), title=f"{law}: worst of {arguments.seeds} seeds")
    for row in rows:
        counts = [
            f"{row[name]} of {row['runs']}" if row[name] else "–" for name in ("failed", "beyond", "swinging", "off")
        ]
        table.add_row(row["condition"], *counts, *_figures(row, arguments))
    console = Console()
    console.width = max(console.width, 190 if arguments.opponents else 150)  # the table is wide
    console.print(table)
