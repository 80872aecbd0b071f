"""The course over many logs: what differed for a time is told although it is over, and the picture counts logs."""

import json
import re

import numpy as np
import pytest

from microstage_ros.commands.analysis.diagnose import main as diagnose
from microstage_ros.diagnosis.logs.report.pictures import course
from microstage_ros.diagnosis.logs.report.trend import passing
from microstage_ros.diagnosis.logs.selection.course import Point
from test.diagnosis.logs.test_file_kinds import motion
from test.diagnosis.logs.test_many import LOG


def points(values, baseline=1):
    """A course of one point per log."""
    return [Point(f"log {k}", 0, value, 0.01, k < baseline) for k, value in enumerate(values)]


@pytest.mark.parametrize("values, changes, wanted", [
    ([0.0, 0.0, 0.27, -0.03], [], [1]),                # one log off the others
    ([0.0, 0.0, 0.02, -0.02], [], []),                 # no more than their errors
    ([0.0, 0.0, 0.27], [], []),                        # two logs: neither is the odd one
    ([0.0, 0.0, 0.0, 0.3, 0.3, 0.0], [3, 5], [2, 3]),  # from one change to the next
    ([0.0, 0.3, 0.3, 0.0], [1, 3], [0, 1]),            # changed from the first log of now
    ([0.0, 0.3, 0.3], [1], [])])                       # nothing after it
def test_what_differed_for_a_time_is_found(values, changes, wanted):
    assert passing(points(values), changes) == wanted


def test_a_change_that_is_over_is_in_the_headline(tmp_path):
    (tmp_path / "LOG.yaml").write_text(LOG)
    files = []
    for number, level in enumerate((1.0, 1.0, 1.0, 1.0, 1.6, 1.0)):
        t, r, x, _, i = motion(number, level)
        files.append(tmp_path / f"{number}.csv")
        files[-1].write_text("t,r,x,i\n" + "".join(f"{a:.3f},{b:.5f},{c:.5f},{d:.4f}\n" for a, b, c, d in zip(t, r, x, i)))
    files = [str(file) for file in files]
    assert diagnose(["--log", str(tmp_path / "LOG.yaml"), "--baseline", *files[:3], "--over-time", "--out", str(tmp_path / "out"), *files[3:]]) == 0
    trend = json.loads((tmp_path / "out" / "trend.json").read_text())
    assert trend["verdict"] == "agrees" and trend["passed"]["logs"] == [2] and trend["passed"]["back"]
    assert trend["sentences"][0].startswith(f"Log 2 of 3 ({files[4]}) differs from the baseline: ")
    assert "friction has changed" in trend["sentences"][0] and "The logs after that agree with the baseline" in trend["sentences"][0]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Log 2 of 3" in page and "What has changed for a time" in page
    assert ("Dashed" in page) == any(one["changes_at"] for one in trend["courses"].values())


def test_the_picture_counts_logs_of_now_from_one():
    axes = course(points([0.0, 0.0, 0.0, 0.3, 0.0], baseline=2), "change", [3], per_log=True).axes[0]
    assert axes.get_xlabel().startswith("log of now")
    assert all(tick == round(tick) for tick in axes.get_xticks())
    drawn = np.concatenate([line.get_xdata() for line in axes.lines if line.get_marker() == "o"])
    assert sorted(drawn) == [-1, 0, 1, 2, 3]
    dashed = [line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == "--"]
    assert dashed == [1.5]
    assert re.match("repetition", course(points([0.0, 0.1]), "change").axes[0].get_xlabel())
