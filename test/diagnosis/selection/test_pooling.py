"""A long series in groups: dealt out whole, pooled by what most groups say."""

import pathlib

import numpy as np

from microstage_ros.diagnosis.batch import Case
from microstage_ros.diagnosis.pooling import GROUP, groups_of, pool
from microstage_ros.model.axis_file import load_axis
from test.diagnosis.emps import ROOT

AXIS = ROOT / "config/axis.yaml"


def case_of(tmp_path, records=100, holdout=7):
    return Case("", str(AXIS), tuple(f"r{n}.csv" for n in range(records)), tuple(f"h{n}.csv" for n in range(holdout)),
                tuple(f"b{n}.csv" for n in range(9)), str(tmp_path))


def report_of(group, causes, verdict="explained", size=0.02, rivals=()):
    axis = load_axis(AXIS).with_effects({name: {"width_rad": size} for name in causes})
    folder = pathlib.Path(group.out)
    folder.mkdir(parents=True)
    axis.save(folder / "extended.yaml")
    entries = [{"id": name, "parameters": {"width_rad": {"value": size, "stderr": 0.001, "unit": "rad"}}, "probability": 0.99,
                "share": 0.8, "gain": {"before": 2.0, "after": 1.0, "unit": "V"}, "channel": "voltage", "sentence": ""} for name in causes]
    gain = {"metric": "m", "unit": "V", "records": [group.name], "before": 2.0, "after": 1.0, "floor": 0.9, "ci95": [0.9, 1.1]}
    return {"verdict": verdict, "causes": entries, "rivals": list(rivals), "gain": gain,
            "findings": [{"channel": "voltage", "coordinate": "position", "statistic": 3.0, "threshold": 1.0, "left": None}]}


def test_every_record_is_in_one_group(tmp_path):
    groups = groups_of(case_of(tmp_path))
    assert sum((group.records for group in groups), ()) == case_of(tmp_path).records
    assert sum((group.holdout for group in groups), ()) == case_of(tmp_path).holdout
    assert max(len(group.records) for group in groups) <= GROUP
    assert len({group.out for group in groups}) == len(groups) and all(len(g.baseline) == 4 for g in groups)


def test_what_most_groups_name_is_the_cause_with_their_spread(tmp_path):
    groups = groups_of(case_of(tmp_path, 40))
    sizes = [0.018, 0.020, 0.022, 0.020, 0.020]
    reports = [report_of(group, ["backlash"], size=size) for group, size in zip(groups, sizes)]
    answer = pool(groups, reports, 3)
    assert (answer.verdict, [cause.id for cause in answer.causes], answer.seed) == ("explained", ["backlash"], 3)
    width = answer.causes[0].parameters["width_rad"]
    assert width.value == 0.020 and np.isclose(width.stderr, np.std(sizes, ddof=1) / 5**0.5)
    assert answer.effects["backlash"]["width_rad"] in sizes
    assert answer.gain.before == 2.0 and len(answer.gain.records) == 5


def test_a_cause_that_came_late_and_stayed_is_named_with_its_start(tmp_path):
    groups = groups_of(case_of(tmp_path, 80))
    reports = [report_of(group, [], "agrees") for group in groups[:8]] + [report_of(group, ["backlash"]) for group in groups[8:]]
    answer = pool(groups, reports, 0)
    assert [cause.id for cause in answer.causes] == ["backlash"] and np.isclose(answer.causes[0].share, 0.16)
    assert any("backlash was named in 2 of 10 groups (first in group 9)" in note for note in answer.notes)
    assert answer.pictures[0].curves["backlash"][1].tolist() == [0.0] * 8 + [0.8] * 2


def test_one_group_alone_among_many_is_no_cause(tmp_path):
    groups = groups_of(case_of(tmp_path, 80))
    reports = [report_of(group, ["backlash"] if number == 4 else [], "agrees") for number, group in enumerate(groups)]
    answer = pool(groups, reports, 0)
    assert (answer.verdict, answer.causes) == ("agrees", ())
    assert any("not named as a cause" in note for note in answer.notes)


def test_all_groups_healthy_is_healthy(tmp_path):
    groups = groups_of(case_of(tmp_path, 20))
    assert pool(groups, [report_of(group, [], "agrees") for group in groups], 0).verdict == "agrees"
