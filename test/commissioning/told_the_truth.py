"""The commissioned axis file against the truth: the same law on the same machine, given the one and given the other.

    PYTHONPATH=test/commissioning python test/commissioning/told_the_truth.py [--anew] FOLDER...

Folders with truth.yaml and axis.yaml. Given the truth, the law is run with the gains of the rule, with the margins that
the commissioning asks for (`law_choice.choose_law` on the true axis, without any draws), and with those once more on
other seeds: how often 24 moves of one law leave 1.5 times the 4s of 24 others by chance. --anew: gains for the
commissioned file are chosen by today's code, not taken from the file.
"""

import sys
from pathlib import Path

import numpy as np

from microstage_ros.commissioning.design.law_choice import choose_law
from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.model.axis_file import load_axis

TARGETS, REPEATS, SEEDS, OTHER_SEEDS = (1e-6, 1e-5, 1e-4, 1e-3), 6, (11, 12, 13, 14), (21, 22, 23, 24)
NOISE = {}


def figures(axis, truth, seeds=SEEDS):
    """(4s [m] by target, largest error of a slow sine [m], largest swing at rest [m]) of the true stage."""
    period, four_s, sine, swing = axis.value("period"), [], 0.0, 0.0
    for target in TARGETS:
        errors = []
        for seed in seeds:
            program = [{"move_to_m": place, "dwell_s": 0.3} for _ in range(REPEATS) for place in (target, 0.0)]
            found = simulate(axis, Run(program=program, start_m=0.0, controller=_section(axis)), seed, machine=truth)
            stage, reference = found["stage_m"], found["reference_m"]
            ends = np.flatnonzero(np.diff(reference) != 0.0)
            starts = [k for k in np.flatnonzero(np.diff(ends) > round(0.2 / period))] + [len(ends) - 1]
            for k in starts:
                last = ends[k] + round(0.29 / period)
                rows = slice(last - round(0.1 / period), last)
                if abs(reference[last] - target) < 1e-12:
                    errors.append(float(np.mean(stage[rows])) - target)
                swing = max(swing, float(np.ptp(stage[rows])))
        four_s.append(4.0 * float(np.std(errors, ddof=1)))
    for seed in seeds:
        run = Run(program=[{"sine": {"amplitude_m": 1e-5, "frequency_hz": 0.1, "cycles": 1.0}}], start_m=0.0, controller=_section(axis))
        found = simulate(axis, run, seed, machine=truth)
        error = np.abs(found["stage_m"] - found["reference_m"])
        sine = max(sine, float(error[len(error) // 4:].max()))
    return four_s, sine, swing


def _section(axis):
    kind = axis.controller["type"]
    return {"type": kind, **axis.controller.get(kind, {})}


def with_margins(axis, kind):
    """The axis file with the gains that the commissioning would choose for it, if it chooses ``kind`` too."""
    law, gains, _ = choose_law(axis.with_controller({"type": kind}), [], True)
    return axis.with_controller({"type": law, law: gains} if law == kind else {"type": kind})


def main():
    """Print a line per folder, and how often each figure is within 1.5 times that of the truth."""
    names = [name for name in sys.argv[1:] if name != "--anew"]
    rows = []
    for folder in map(Path, names):
        if not (folder / "axis.yaml").exists():
            continue
        axis, truth = load_axis(folder / "axis.yaml"), load_axis(folder / "truth.yaml")
        kind = axis.controller["type"]
        fair = with_margins(truth, kind)
        laws = (with_margins(axis, kind) if "--anew" in sys.argv else axis, truth.with_controller({"type": kind}), fair)
        rows.append([figures(law, truth) for law in laws] + [figures(fair, truth, OTHER_SEEDS)])
        print(folder.name, kind, "; ".join(
            f"{name}: 4s {[round(v * 1e9, 1) for v in four_s]} sine {sine * 1e9:.0f} swing {swing * 1e9:.0f} nm"
            for name, (four_s, sine, swing) in zip(("commissioned", "truth", "truth with margins"), rows[-1])), flush=True)
    for name, ours, best in (("truth", 0, 1), ("truth with margins", 0, 2), ("by chance", 3, 2)):
        four_s = np.array([np.divide(row[ours][0], row[best][0]) for row in rows])
        sines = np.array([row[ours][1] / row[best][1] for row in rows])
        print(f"{name}: {len(rows)} machines; within 1.5 times: 4s {np.sum(four_s <= 1.5)} of {four_s.size}, slow sine "
              f"{np.sum(sines <= 1.5)} of {sines.size}; median ratio {np.median(four_s):.2f}, {np.median(sines):.2f}")
    print("swing above 0.2 um at rest:", sum(row[0][2] > 2e-7 for row in rows))


if __name__ == "__main__":
    main()
