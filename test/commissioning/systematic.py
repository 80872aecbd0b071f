"""What `SYSTEMATIC` should be: the relative error of every number, beyond what its records' scatter explains, over commissioned machines.

    PYTHONPATH=test/commissioning python test/commissioning/systematic.py FILE.json.d/*     # folders that campaign.py leaves
"""

import json
import math
import sys
from pathlib import Path

from microstage_ros.commissioning.estimation.parameters import SYSTEMATIC
from microstage_ros.model.axis_file import load_axis


def rows(folders):
    """By key: list of (relative error, relative standard uncertainty as reported) over the machines that have a report."""
    found = {}
    for folder in map(Path, folders):
        if not (folder / "report.json").exists() or not (folder / "truth.yaml").exists():
            continue
        truth, report = load_axis(folder / "truth.yaml"), json.loads((folder / "report.json").read_text(encoding="utf-8"))
        for key, each in report["parameters"].items():
            if each["determined"] and truth.has(key) and not isinstance(each["value"], list) and each["stderr"]:
                found.setdefault(key, []).append((each["value"] / truth.value(key) - 1.0, each["stderr"] / abs(each["value"])))
    return found


def systematic(pairs, now):
    """Relative standard uncertainty beside the records' scatter that brings the mean square of error over uncertainty to one.

    ``pairs``: (relative error, reported relative uncertainty, with ``now`` in it). Bisection: sum e²/(s² − now² + part²) = n.
    """
    low, high = 0.0, 2.0
    for _ in range(60):
        part = 0.5 * (low + high)
        power = sum(e * e / max(s * s - now * now + part * part, 1e-12) for e, s in pairs) / len(pairs)
        low, high = (part, high) if power > 1.0 else (low, part)
    return high


def main(folders):
    """Print the table."""
    print(f"{'parameter':40s} machines  within 95 %   now    would be")
    for key, pairs in sorted(rows(folders).items()):
        now = SYSTEMATIC.get(key, 0.0)
        held = sum(abs(e) <= 1.96 * s for e, s in pairs)
        print(f"{key:40s} {len(pairs):8d} {held:12d}   {now:.4f}   {systematic(pairs, now):.4f}  (rms error {math.sqrt(sum(e * e for e, _ in pairs) / len(pairs)):.4f})")


if __name__ == "__main__":
    main(sys.argv[1:])
