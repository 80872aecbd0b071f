"""Which command serves which drive: the page's table is the code's, and every refusal is one line that says why."""

from pathlib import Path

import pytest

from microstage_ros.commands.analysis import compare, robustness, tune
from microstage_ros.commands.drives import EVERY, SERVICES, table
from microstage_ros.commissioning.sketch import sketch_from_dict
from microstage_ros.identification.pipeline import identify
from microstage_ros.model.axis_file import load_axis
from microstage_ros.quantities.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
FILES = {"voltage_motor": "axis.yaml", "force": "emps.yaml",
         **{name: f"axes/{name}.yaml" for name in ("current_motor", "voice_coil", "stepper", "piezo")}}
ASKED = {
    "tune": lambda path, out: tune.main(["--axis", path, "--type", "pid", "--out", f"{out}/tuned.yaml"]),
    "robustness": lambda path, out: robustness.main(["--axis", path, "--only", "nominal", "--seeds", "1"]),
    "compare": lambda path, out: compare.main(["--axis", path, "--quick", "--out", str(out)]),
    "commission": lambda path, out: sketch_from_dict(load_axis(path).as_dict(), path),
    "identify": lambda path, out: identify([object()], load_axis(path), 1),
}
REFUSED = [(command, drive) for command, service in SERVICES.items() for drive in EVERY.drives if drive not in service.drives]


def test_the_page_has_the_table_of_the_code():
    page = (ROOT / "docs" / "actuators_and_sensors.md").read_text(encoding="utf-8")
    assert "\n".join(table()) in page
    assert {command for command, _ in REFUSED} == set(ASKED) and all(s.otherwise for s in SERVICES.values() if s is not EVERY)


@pytest.mark.parametrize("command, drive", REFUSED)
def test_what_is_refused_is_refused_in_one_line_that_says_why(command, drive, tmp_path):
    with pytest.raises(InputError, match=f"drive.type: got '{drive}', expected .*") as refusal:
        ASKED[command](str(ROOT / "config" / FILES[drive]), tmp_path)
    assert "\n" not in str(refusal.value) and len(str(refusal.value)) < 400
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("drive", ["current_motor", "voice_coil"])
def test_a_campaign_of_machines_runs_on_other_drives_with_a_force(drive):
    assert ASKED["robustness"](str(ROOT / "config" / FILES[drive]), None) == 0
