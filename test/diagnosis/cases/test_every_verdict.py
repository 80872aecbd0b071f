"""Every verdict on the screw axis end to end, the command line with --holdout and --baseline, and seeds drawn afresh.

The seeds are drawn anew in every run and printed, so that nothing rests on lucky ones; `MICROSTAGE_SEED` repeats a run. What
is asserted is a rate that a healthy code misses once in 10⁴ runs: of n cases at least the k that a code with
`HEALTHY_RATE` falls short of with that chance (`MICROSTAGE_FRESH_CASES` raises n).
"""

import dataclasses
import json
import os
import secrets

import numpy as np
import pytest
from scipy.stats import binom

from microstage_ros.commands.analysis.diagnose import main
from microstage_ros.diagnosis.case import diagnose_case
from microstage_ros.diagnosis.validation import fault_injection
from microstage_ros.diagnosis.validation.simulated_records import Hidden, make_case
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.effects import effects_of
from microstage_ros.places import config_file
from microstage_ros.records import write_record

SEED = int(os.environ.get("MICROSTAGE_SEED") or secrets.randbelow(2**31))
CASES = int(os.environ.get("MICROSTAGE_FRESH_CASES", "3"))
ALL = "MICROSTAGE_FRESH_CASES" in os.environ    # else a test ends as soon as the cases left cannot change what it asserts
HEALTHY_RATE = 0.96      # of clear single effects named first: what docs/diagnosis.md claims at least
NAMELESS_RATE = 0.75     # of what no catalogue holds that gets no name, and
NOTICED_RATE = 0.75      # that ends `unexplained`: 20 of 21 in the campaign bound both at 0.76 from below (docs/diagnosis.md)
CHANCE = 1.0e-4


def least(count, rate=HEALTHY_RATE, chance=CHANCE):
    """Hits of ``count`` that a code with this rate falls short of with at most this chance."""
    return int(max(k for k in range(count + 1) if binom.cdf(k - 1, count, rate) <= chance))


def test_the_asserted_rate_is_missed_once_in_ten_thousand():
    assert [least(n) for n in (1, 2, 3, 27, 100)] == [0, 0, 1, 21, 87]
    assert all(binom.cdf(least(n) - 1, n, HEALTHY_RATE) <= CHANCE < binom.cdf(least(n), n, HEALTHY_RATE) for n in (3, 27, 100))


def test_effects_of_fresh_seeds_are_named(axis):
    print(f"MICROSTAGE_SEED={SEED}")
    generator = np.random.default_rng(SEED)
    hits = []
    for number in range(CASES):
        name = str(generator.choice(effects_of(axis)))
        hidden = fault_injection.one(name, generator)
        records, holdout, baseline = make_case(axis, hidden, [SEED, number], generator.uniform(0.02, 0.06))
        answer = diagnose_case(axis, records, holdout, baseline)
        named = [cause.id for cause in answer.causes]
        open_ones = [i for rivals in answer.rivals for i in rivals.ids]
        print(f"  {name}: {answer.verdict} {named} open {open_ones}")
        hits.append(named[:1] == [name] or name in open_ones)
        if sum(hits) >= least(CASES) and not ALL:
            break
    assert sum(hits) >= least(CASES)


def test_what_no_catalogue_holds_gets_no_name(axis):
    """Of all kinds of it, in an order and with seeds drawn afresh. So few cases with so wide a bound assert no more than that
    not all are named; the kinds that cannot change that any more are left out."""
    print(f"MICROSTAGE_SEED={SEED}")
    said, kinds = {}, sorted(fault_injection.OUTSIDE)
    nameless, noticed = least(len(kinds), NAMELESS_RATE), least(len(kinds), NOTICED_RATE)
    assert nameless > 0 and noticed > 0
    for number in np.random.default_rng([SEED, 98]).permutation(len(kinds)).tolist():
        kind = kinds[number]
        generator = np.random.default_rng([SEED, 99, number])
        hidden = fault_injection.outside(kind, generator)
        answer = diagnose_case(axis, *make_case(axis, hidden, [SEED, 100, number], generator.uniform(0.02, 0.06)))
        said[kind] = (answer.verdict, [cause.id for cause in answer.causes])
        print(f"  {kind}: {said[kind]}")
        without_name = sum(not named for _, named in said.values())
        unexplained = sum(verdict == "unexplained" for verdict, _ in said.values())
        if without_name >= nameless and unexplained >= noticed and not ALL:
            break
    assert without_name >= nameless and unexplained >= noticed


def test_a_nameless_force_beside_an_encoder_error_is_only_partly_explained(axis):
    """A force that swings in time is in no catalogue; the encoder's error beside it is named, and the rest is not called noise.

    It swings by 0.63 N: in most channels less than friction's own noise (docs/claims.md)."""
    swing = fault_injection.outside("swinging force", np.random.default_rng(11))
    hidden = dataclasses.replace(swing, ids=("encoder_sde",), effects={"encoder_sde": {"period_m": 4e-6, "amplitude1_m": 3e-8}})
    records, holdout, baseline = make_case(axis, hidden, 61, 0.04)
    answer = diagnose_case(axis, records, holdout, baseline)
    assert {cause.id for cause in answer.causes} == {"encoder_sde"} and answer.verdict == "partly_explained"
    assert answer.gain.after > answer.gain.floor
    assert any("what is left in torque swings in time" in note for note in answer.notes)


def test_command_line_with_a_baseline_that_already_shows_the_effect(axis, tmp_path):
    """What the axis did while it was called healthy is no cause: --baseline records with the same offset, and nothing is named."""
    hidden = Hidden("offset", ("amplifier_offset",), {"amplifier_offset": {"offset_V": 0.03}})
    records, holdout, _ = make_case(axis, hidden, 62, 0.04)
    (other, _), _, _ = make_case(axis, hidden, 63, 0.04)
    files = {}
    for name, record in (("rec1", records[0]), ("hold", holdout[0]), ("base", other)):
        files[name] = tmp_path / f"{name}.csv"
        write_record(record, files[name])
    common = ["--axis", str(config_file("axis.yaml")), str(files["rec1"]), "--holdout", str(files["hold"])]
    assert main([*common, "--baseline", str(files["base"]), "--out", str(tmp_path / "same")]) == 0
    report = json.loads((tmp_path / "same" / "report.json").read_text())
    assert (report["verdict"], report["causes"], report["rivals"]) == ("agrees", [], [])
    assert report["gain"]["records"] == [str(files["hold"])] and report["sources"]["baseline"] == [str(files["base"])]
    assert main([*common, "--out", str(tmp_path / "alone")]) == 0
    report = json.loads((tmp_path / "alone" / "report.json").read_text())
    assert [cause["id"] for cause in report["causes"]] == ["amplifier_offset"]
    assert report["causes"][0]["parameters"]["offset_V"]["value"] == pytest.approx(0.03, abs=1e-3)
    assert load_axis(tmp_path / "alone" / "extended.yaml").effects["amplifier_offset"]["offset_V"] == pytest.approx(0.03, abs=1e-3)
