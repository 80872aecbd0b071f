"""Three machines that other people built, broke and recorded; skipped where their logs are not at hand."""

import json
import lzma
from pathlib import Path

import pytest

from microstage_ros.commands.__main__ import run
from microstage_ros.diagnosis.logs.case import diagnose_logs
from microstage_ros.records.logs import read_log
from microstage_ros.records.logs.description import description_of

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "foreign"
pytestmark = pytest.mark.skipif(not DATA.exists(), reason="the logs of foreign machines are not at hand (../shared/data/foreign)")
BALL = {"time": {"column": "time", "unit": "s"}, "reference": {"column": "set_point", "unit": "mm"},
        "following_error": {"column": "position_error", "unit": "mm"}, "current": {"column": "current", "unit": "A", "signed": False},
        "condition": ["load", "profile"], "run": ["run"], "cycle_restarts": True, "lead": {"value": 5, "unit": "mm"}}
COG = {"time": {"column": "Time", "unit": "s"}, "position": {"column": "Position", "unit": "rad"}, "velocity": {"column": "Velocity", "unit": "rad/s"},
       "reference_velocity": {"column": "Reference Velocity", "unit": "rad/s"}, "current": {"column": "Iq", "unit": "A"}}
EPOS = {"time": {"column": "time", "unit": "ms"}, "velocity": {"column": "Velocity actual value averaged", "unit": "rpm"},
        "torque": {"column": "Torque actual value averaged", "unit": "%"}, "nominal_torque": {"value": 9.84, "unit": "mN m"},
        "lead": {"value": 2, "unit": "mm"}}


def ball(state, load):
    """One log of the ball screw."""
    return read_log(DATA / "ball_screw" / f"{state}_{load}kgf.csv.xz", description_of(BALL, "ball"))


def said(result):
    """Names told for sure, and all that were told at all."""
    sure = {c.id for c in result.diagnosis.causes}
    return sure, sure | {i for r in result.diagnosis.rivals for i in r.ids}


def test_washed_out_grease_shows_as_friction():
    result = diagnose_logs([ball("normal", 20)], [ball("lackLubrication1", 20)], description_of(BALL, "ball"))
    sure, told = said(result)
    assert "friction_level_change" in told and sure <= {"friction_level_change", "viscous_change"}
    assert all("speed" in r.experiment["decides"] for r in result.diagnosis.rivals)


@pytest.mark.parametrize("state", ["lackLubrication1", "backlash1", "spalling3"])
def test_where_levels_were_shifted_no_level_is_named(state):
    result = diagnose_logs([ball("normal", -40)], [ball(state, -40)], description_of(BALL, "ball"))
    assert not said(result)[0] & {"friction_level_change", "gravity_tilt", "direction_asymmetry", "amplifier_gain"}
    # what differs at the beginning of either stroke differs at other places on the way out than on the way back
    assert "position_dependent_friction" not in said(result)[1]
    assert any("shifted" in note for note in result.diagnosis.notes)


@pytest.mark.parametrize("load", [20, -40])
def test_the_healthy_screw_agrees_with_itself(load):
    whole = ball("normal", load)
    early, late = whole.rows(whole.run < 3), whole.rows(whole.run >= 3)
    assert diagnose_logs([early], [late], description_of(BALL, "ball")).diagnosis.verdict == "agrees"


def test_conditions_are_compared_like_with_like():
    from microstage_ros.quantities.errors import InputError
    with pytest.raises(InputError, match="in common"):
        diagnose_logs([ball("normal", 20)], [ball("normal", -40)], description_of(BALL, "ball"))


def cogging(tmp_path):
    """The motor's log divided at its switch: (compensated, not compensated)."""
    lines = lzma.open(DATA / "brushless_motor" / "speed_test.csv.xz", "rt").read().splitlines()
    parts = []
    for value in ("0", "1"):
        rows = [line for line in lines[1:] if line.rstrip().endswith(f" {value}")]
        path = tmp_path / f"switch_{value}.csv"
        path.write_text("\n".join([lines[0], *rows]))
        parts.append(read_log(path, description_of(COG, "cog")))
    return parts


def test_cogging_shows_as_ripple_of_the_turn(tmp_path):
    calm, cogs = cogging(tmp_path)
    result = diagnose_logs([calm], [cogs], description_of(COG, "cog"))
    assert "torque_ripple" in said(result)[1] and "torque_ripple" not in result.hidden
    half = len(calm) // 2
    first, second = calm.rows(slice(0, half)), calm.rows(slice(half, None))
    assert diagnose_logs([first], [second], description_of(COG, "cog")).diagnosis.verdict == "agrees"


def test_friction_of_the_lead_screw_is_read(tmp_path):
    """Torque at constant speeds: a level with a sign that turns round, and growth with speed."""
    names = [f"{sign}{n}" for sign in ("", "n") for n in (50, 100, 200)]
    logs = [read_log(DATA / "lead_screw" / "steady_state" / f"{n}.csv.xz", description_of(EPOS, "epos")) for n in names]
    result = diagnose_logs(logs, logs[:1], description_of(EPOS, "epos"))
    healthy = {(row[0], row[2]): (row[3], row[4]) for row in result.healthy}
    level, error = healthy[("effort", "level")]
    assert 0.15 < level / 9.84e-3 < 0.45 and error < 0.1 * level
    assert healthy[("effort", "viscous")][0] > 0.0


def test_command_line(tmp_path):
    """From the log to the page: the proposal is taken as it is, with the lead added."""
    source = DATA / "ball_screw" / "normal_20kgf.csv.xz"
    assert run("log", [str(source), "--out", str(tmp_path / "look")]) == 0
    text = (tmp_path / "look" / "LOG.yaml").read_text()
    assert "cycle_restarts: true" in text and "signed: false" in text and "unit: mm" in text
    (tmp_path / "LOG.yaml").write_text(text + "\nlead: {value: 5, unit: mm}\n")
    out = tmp_path / "answer"
    assert run("diagnose", ["--log", str(tmp_path / "LOG.yaml"), "--baseline", str(source), "--out", str(out),
                            str(DATA / "ball_screw" / "spalling3_20kgf.csv.xz")]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["format"] == 1 and report["verdict"] in ("agrees", "unexplained", "undetermined", "explained", "partly_explained")
    assert "backlash" in {**report["visible"], **report["not_visible"]} and (out / "report.html").stat().st_size > 20_000
    assert run("diagnose", ["--log", str(tmp_path / "LOG.yaml"), "--baseline", str(source), "--out", str(tmp_path / "course"), "--over-time",
                            *(str(DATA / "ball_screw" / f"{n}_20kgf.csv.xz") for n in ("backlash1", "lackLubrication1"))]) == 0
    trend = json.loads((tmp_path / "course" / "trend.json").read_text())
    points = trend["courses"]["friction_level_change"]["points"]
    assert len(points) == 3 and points[2]["value"] > points[1]["value"] + 0.1
