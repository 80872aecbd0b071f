"""A diagnosis in a technician's words: names and remedies of the effects (each effect owns its own), verdicts,
sizes."""

import re

from microstage_ros.model.effects import REGISTRY
from microstage_ros.quantities.readable import quantity

MOST = 3                       # sizes reported in a sentence
SUFFIXES = ("_rad", "_m", "_s", "_kg", "_N_m", "_Nm", "_V", "_hz", "_N", "_K", "_Pa", "_m_s")

VERDICTS = {
    "agrees": "The model agrees with the records.",
    "explained": "What the model lacked is found, down to the noise.",
    "partly_explained": "Part of what the model lacks is found; something is left.",
    "undetermined": "Something is there, but these records cannot tell what.",
    "unexplained": "The model and the records part, and no cause of the catalogue fits.",
}
#: Tone of a verdict on the page.
TONES = {
    "agrees": "good",
    "explained": "good",
    "partly_explained": "caution",
    "undetermined": "caution",
    "unexplained": "bad",
}


def name_of(cause_id):
    """Plain name of an effect; the id itself for one that has none."""
    return REGISTRY[cause_id].label if cause_id in REGISTRY else cause_id.replace("_", " ").capitalize()


def worded(text, ids):
    """A sentence in which effects stand by their plain names, in quotes, and not by the ``ids`` of report.json."""
    names = {one: f"“{name_of(one)[:1].lower()}{name_of(one)[1:]}”" for one in ids}
    longest_first = sorted(map(re.escape, names), key=len, reverse=True)
    return re.sub(rf"\b({'|'.join(longest_first)})\b", lambda found: names[found[0]], text) if names else text


def listed(words, joint):
    """``a, b and c``."""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + f" {joint} " + words[-1]


def advice_for(cause_id):
    """What to do next about an effect."""
    return REGISTRY[cause_id].remedy if cause_id in REGISTRY else ""


def sentence_of(cause_id, parameters):
    """Name and sizes in one sentence; ``parameters``: {name: `diagnosis.Parameter`}."""
    sizes = [f"{_plain(name)} {quantity(number.value, number.unit, stderr=number.stderr)}"
            for name, number in list(parameters.items())[:MOST]]
    more = f" and {len(parameters) - MOST} more sizes" if len(parameters) > MOST else ""
    return f"{name_of(cause_id)}: {', '.join(sizes)}{more}." if sizes else f"{name_of(cause_id)}."


def _plain(name):
    """A parameter's name without its unit: ``width_rad`` as ``width``."""
    for suffix in sorted(SUFFIXES, key=len, reverse=True):
        if name.endswith(suffix) and len(name) > len(suffix):
            return name[: -len(suffix)].replace("_", " ")
    return name.replace("_", " ")


def is_measured(report):
    """Whether the field ``gain`` of a ``report``, the mapping of report.json, holds numbers; without any nothing is
    said of it."""
    return None not in (report["gain"][key] for key in ("before", "after", "floor"))
