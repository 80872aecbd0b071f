"""Commissioning of machines nobody was told of: random ones, and faulty ones.

    PYTHONPATH=test/commissioning python test/commissioning/campaign.py --machines 20 --faults all --out FILE.json
"""

import argparse
import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from machines import FAULTS, Machine, random_axis
from scipy.stats import beta

from microstage_ros.commissioning.experiments.machine import Machine as Hand
from microstage_ros.commissioning.procedure import commission
from microstage_ros.commissioning.report import report_tree, write_answer
from microstage_ros.commissioning.sketch import load_sketch
from microstage_ros.commissioning.store import Store
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import controller_margins
from microstage_ros.control.tuning.tuning import GUARDED
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import Setup
from microstage_ros.model.axis_file import axis_from_dict
from microstage_ros.places import config_file

EXPECTED = {"motor_polarity": "polarity", "encoder_polarity": "polarity", "current_polarity": "current_polarity", "encoder_dead": "encoder_dead",
            "encoder_frozen": "encoder_dead", "counts_quarter": "encoder_scale", "counts_fourfold": "encoder_scale", "stuck": "stuck",
            "end_stop": "end_stop", "no_current": "ready", "zero_current": "ready", "delay": "delay", "encoder_delay": "delay", "resonance": "resonance", "": "ready"}


def one(sketch, fault, seed, folder, truth=None):
    """One commissioning. Returns a row of what came of it."""
    truth = truth or (random_axis(sketch.axis, seed) if seed else sketch.axis)
    if fault == "resonance":  # a third of the sketch's
        values = {key: sketch.axis.value(key) for key in ("transmission.stiffness", "stage.mass")}
        truth = truth.with_values(values, source="estimate")
    folder.mkdir(parents=True, exist_ok=True)
    truth.save(folder / "truth.yaml")
    options = {"truth": str(folder / "truth.yaml"), "fault": fault, "frozen_after": frozen_after(seed)}
    backend = make_hardware("machines:Machine", Setup(sketch.axis, seed, options))
    backend.open()
    hand = Hand(backend, sketch.axis)
    begun = time.process_time()
    outcome = commission(hand, sketch, Store(folder, f"{fault}{seed}"), seed)
    write_answer(outcome, hand, folder, {"seed": seed})
    machine = Machine.made[-1]
    failed = [c.id for c in outcome.checks.values() if not c.passed]
    got = outcome.verdict if outcome.verdict != "refused" else failed[0]
    if fault == "encoder_dead" and got == "stuck" and "an encoder that does not count" in outcome.says:
        got = EXPECTED[fault]  # of drives whose command does not tell whether the motor turns the sentence names both
    estimates = {k: (e.value, e.stderr) for k, e in outcome.estimates.items() if e.determined and truth.has(k) and not isinstance(e.value, list)}
    hits = {k: abs(v - truth.value(k)) <= 1.96 * s for k, (v, s) in estimates.items() if s}
    return {"fault": fault, "seed": seed, "got": got, "right": got == EXPECTED[fault], "says": outcome.says, "law": outcome.law,
            "time_s": hand.time, "cpu_s": time.process_time() - begun, "range_m": [machine.lowest, machine.highest],
            "within": machine.lowest >= sketch.axis.value("travel.minimum") and machine.highest <= sketch.axis.value("travel.maximum"),
            "wrong_m": machine.wrong, "wrong_s": machine.wrong_time, "wrong_run_s": machine.wrong_run, "true_margins": true_margins(outcome, truth), "law_of_friction": truth.law("actuator"),
            "voltage_V": machine.most_voltage, "moves": outcome.moves, "sine_m": outcome.sine, "held": hits,
            "report": report_tree(outcome, hand)["margins"], "remarks": outcome.remarks[-2:]}


def frozen_after(seed):
    """Reading after which the encoder freezes: 1 to 140 s into the commissioning at 10 kHz, which lasts longer."""
    return int(np.random.default_rng((seed, 7)).uniform(1e4, 1.4e6))


def true_margins(outcome, truth):
    """[phase margin in degrees, gain margin in dB] of the law that was taken on the linearised true machine, sliding at 1 mm/s; None without one."""
    if outcome.axis is None or not outcome.law or outcome.verdict != "ready":
        return None
    found = controller_margins(truth, controller_parameters(outcome.law, outcome.axis, {}))
    return None if found is None else next([m.phase_deg, m.gain_db] for m in found if m.regime == GUARDED[1])


def interval(hits, count):
    """Clopper-Pearson's 95 % interval of a rate."""
    low = beta.ppf(0.025, hits, count - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, count - hits) if hits < count else 1.0
    return f"{hits} of {count} ({low:.0%} to {high:.0%})"


def other_friction(truth, law):
    """The machine with another friction law at the actuator, of the same sliding curve (and slope from rest, for LuGre)."""
    tree = truth.as_dict()
    contact = tree["contacts"]["actuator"]
    kept = {name: contact[name] for name in ("static", "coulomb", "stribeck_velocity", "stribeck_exponent", "viscous")}
    if law == "lugre":
        kept["stiffness"] = {**contact["stiffness"], "value": float(sum(contact["stiffness"]["value"]))}
        kept["damping"] = {"value": 1e-4, "unit": "N m s/rad", "source": "estimate"}
    tree["contacts"]["actuator"] = {"law": law, **kept}
    return axis_from_dict(tree, law)


def main():
    """Run the campaign."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--machines", type=int, default=10)
    parser.add_argument("--first", type=int, default=1, help="first seed; those of faults follow each other, repeats 100 apart")
    parser.add_argument("--faults", nargs="*", default=[], choices=[*FAULTS, "all"], metavar="NAME", help=", ".join(FAULTS))
    parser.add_argument("--repeats", type=int, default=1, help="machines per kind of fault")
    parser.add_argument("--friction", default="", choices=("", "lugre", "coulomb_viscous_stribeck"), help="law of the machines' actuators (default: the sketch's)")
    parser.add_argument("--axis", default=str(config_file("axis.yaml")), help="axis file of the sketch (default: the shipped one)")
    parser.add_argument("--period", type=float, default=0.0, help="control period [s] of sketch and machines (default: the sketch's)")
    parser.add_argument("--out", default="")
    arguments = parser.parse_args()
    sketch = load_sketch(arguments.axis)
    if arguments.period:
        sketch = replace(sketch, axis=sketch.axis.with_values({"period": arguments.period}, source="datasheet"))
    todo = [(fault, arguments.first + k + 100 * n) for n in range(arguments.repeats) for k, fault in enumerate(FAULTS) if fault in arguments.faults or "all" in arguments.faults]
    todo += [("", seed) for seed in range(arguments.first, arguments.first + arguments.machines)]
    rows = []
    for fault, seed in todo:
        with tempfile.TemporaryDirectory() as folder:
            truth = other_friction(random_axis(sketch.axis, seed), arguments.friction) if arguments.friction else None
            rows.append(one(sketch, fault, seed, Path(arguments.out + ".d") / f"{fault}{seed}" if arguments.out else Path(folder), truth))
        row = rows[-1]
        held = sum(row["held"].values()), len(row["held"])
        print(f"{row['fault'] or 'healthy':16s} {row['seed']:3d} {'ok ' if row['right'] else 'NOT'} {row['got']:16s} {row['law']:22s} {row['time_s']:6.1f} s "
              f"cpu {row['cpu_s']:5.1f} 4s {[round(m['four_s_m'] * 1e9, 1) for m in row['moves']]} sine {row['sine_m'] * 1e9:.0f} nm held {held} "
              f"{'' if row['within'] else 'BEYOND'} {row['says'][:100]} {row['remarks']}", flush=True)
        if arguments.out:
            Path(arguments.out).write_text(json.dumps(rows, default=str))
    summary(rows)


def summary(rows):
    """The rates, each with its interval."""
    print(interval(sum(row["right"] for row in rows), len(rows)), "as expected")
    held = [hit for row in rows for hit in row["held"].values()]
    if held:
        print("intervals that held the truth:", interval(sum(held), len(held)))
    wrong = [row for row in rows if row["fault"] in ("motor_polarity", "encoder_polarity", "encoder_dead", "encoder_frozen")]
    if wrong:
        print(f"wrong motion: at most {max(row['wrong_m'] for row in wrong) * 1e6:.2f} µm, {max(row['wrong_s'] for row in wrong):.3f} s in all and {max(row['wrong_run_s'] for row in wrong):.3f} s "
              f"in one go faster than 10 µm/s; beyond 10 µm: {sum(row['wrong_m'] > 1e-5 for row in wrong)}, beyond 0.1 s in all: {sum(row['wrong_s'] > 0.1 for row in wrong)}, "
              f"in one go: {sum(row['wrong_run_s'] > 0.1 for row in wrong)} of {len(wrong)}")
    pairs = [(row["report"], row["true_margins"]) for row in rows if row["true_margins"] and row["report"]["phase_deg"] is not None]
    close = [abs(a["phase_deg"] - b[0]) <= 3.0 and (a["gain_dB"] is None or abs(a["gain_dB"] - b[1]) <= 1.0) for a, b in pairs]
    if pairs:
        print("margins within 3° and 1 dB:", interval(sum(close), len(close)))
    print("beyond travel or voltage:", sum(not row["within"] for row in rows), "longest:", f"{max(row['time_s'] for row in rows):.0f} s of machine time")


if __name__ == "__main__":
    sys.exit(main())
