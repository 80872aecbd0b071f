"""The commissioned axis file against the truth: the same law on the same machine, told the one and told the other.

    PYTHONPATH=test/commissioning python test/commissioning/told_the_truth.py FOLDER...     # folders with truth.yaml and axis.yaml
"""

import sys
from pathlib import Path

import numpy as np

from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.model.axis_file import load_axis

TARGETS, REPEATS, SEEDS = (1e-6, 1e-5, 1e-4, 1e-3), 6, (11, 12)
NOISE = {}


def figures(axis, truth):
    """(4s [m] by target, largest error of a slow sine [m], largest swing at rest [m]) of the true stage."""
    period, four_s, sine, swing = axis.value("period"), [], 0.0, 0.0
    for target in TARGETS:
        errors = []
        for seed in SEEDS:
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
    for seed in SEEDS:
        run = Run(program=[{"sine": {"amplitude_m": 1e-5, "frequency_hz": 0.1, "cycles": 1.0}}], start_m=0.0, controller=_section(axis))
        found = simulate(axis, run, seed, machine=truth)
        error = np.abs(found["stage_m"] - found["reference_m"])
        sine = max(sine, float(error[len(error) // 4:].max()))
    return four_s, sine, swing


def _section(axis):
    kind = axis.controller["type"]
    return {"type": kind, **axis.controller.get(kind, {})}


def main():
    """Print one line per folder, and how often each figure is within 1.5 times that of the truth."""
    ratios, sines, swings = [], [], []
    for folder in map(Path, sys.argv[1:]):
        if not (folder / "axis.yaml").exists():
            continue
        axis, truth = load_axis(folder / "axis.yaml"), load_axis(folder / "truth.yaml")
        told = truth.with_controller({"type": axis.controller["type"]})
        ours, best = figures(axis, truth), figures(told, truth)
        ratio = [a / b for a, b in zip(ours[0], best[0])]
        ratios.append(ratio)
        sines.append(ours[1] / best[1])
        swings.append(ours[2])
        print(folder.name, axis.controller["type"], "4s [nm]", [round(v * 1e9, 1) for v in ours[0]], "told the truth", [round(v * 1e9, 1) for v in best[0]],
              f"sine {ours[1] * 1e9:.0f} / {best[1] * 1e9:.0f} nm, swing {ours[2] * 1e9:.0f} / {best[2] * 1e9:.0f} nm", flush=True)
    ratios = np.array(ratios)
    print(f"{len(ratios)} machines; 4s within 1.5 times: {np.mean(ratios <= 1.5):.0%} of {ratios.size}; slow sine: {np.mean(np.array(sines) <= 1.5):.0%}; "
          f"median ratio {np.median(ratios):.2f}, {np.median(sines):.2f}; swing above 0.2 um at rest: {np.sum(np.array(swings) > 2e-7)}")


if __name__ == "__main__":
    main()
