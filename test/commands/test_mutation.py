"""The mutation command: a weak test lets mutants live, a strict one does not; what it takes is checked."""

import importlib.util
import json

import pytest

from microstage_ros.commands.project import mutation
from microstage_ros.quantities.errors import InputError

pytestmark = pytest.mark.skipif(not importlib.util.find_spec("cosmic_ray"), reason="cosmic-ray is not installed")
FILE = "microstage_ros/metrology/repeatability.py"


def test_tests_of_something_else_notice_nothing(tmp_path, capsys):
    out = tmp_path / "out.json"
    assert (
        mutation.main(
            [FILE, "--tests", "test/metrology/test_rates.py", "--sample", "1", "--seed", "3", "--json", str(out)]
        )
        == 0
    )
    found = json.loads(out.read_text(encoding="utf-8"))
    assert (found["tried"], found["noticed"], len(found["rows"])) == (1, 0, 1) and found["mutants"] > 10
    said = capsys.readouterr().out
    assert said.startswith("survived") and "0 of 1" in said


def test_a_mutant_that_the_tests_notice(tmp_path):
    out = tmp_path / "out.json"
    assert (
        mutation.main(
            [
                FILE,
                "--tests",
                "test/metrology/test_repeatability.py",
                "--sample",
                "1",
                "--seed",
                "3",
                "--json",
                str(out),
            ]
        )
        == 0
    )
    assert json.loads(out.read_text(encoding="utf-8"))["noticed"] == 1


@pytest.mark.parametrize(
    "arguments, words",
    [(["nowhere"], "nowhere"), (["hardware", "--tests", "test/none.py"], "test/none.py"), ([FILE], "--tests")],
)
def test_bad_input_is_one_line(arguments, words):
    with pytest.raises(InputError, match=words):
        mutation.main(arguments)
