"""The catalogue as the command prints it: complete, true of every shipped axis, and the page in docs."""

import pathlib
import re

import numpy as np
import pytest
import yaml

from microstage_ros.commands import answer
from microstage_ros.commands.analysis import effects as command
from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.effects import REGISTRY, check_effects
from microstage_ros.model.effects.effect import CONTACTS
from microstage_ros.places import SOURCE, config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.plant import make_plant

PAGE = SOURCE / "docs" / "reference" / "effects.md"
AXES = ["axis.yaml", "emps.yaml", *sorted(f"axes/{name}.yaml" for name in ("current_motor", "piezo", "stepper", "voice_coil"))]


def asked(*words):
    """The answer of the command to a program: {id: facts}."""
    answer.begin()
    assert command.main(list(words)) == 0
    return answer.facts()["effects"]


def accepted(effect, axis):
    """Whether the simulation takes the effect on this axis, at one of its contacts if it acts on one."""
    drawn = effect.draw(np.random.default_rng(1), 1.0)
    given = {} if callable(drawn) else drawn
    for contact in CONTACTS if effect.on_contact else (None,):
        try:
            make_plant(axis, effects={effect.id: {**given, **({"contact": contact} if contact else {})}})
        except InputError:
            continue
        return True
    return False


@pytest.mark.parametrize("file", AXES)
def test_of_an_axis_those_are_listed_that_the_simulation_takes(file, capsys):
    axis = load_axis(config_file(file))
    takes = {name for name, effect in REGISTRY.items() if effect.acts_on(axis) and accepted(effect, axis)}
    assert set(asked("--axis", str(config_file(file)))) == takes
    assert 10 < len(takes) < len(REGISTRY)
    shown = capsys.readouterr().out
    assert all(f" {name} " in shown for name in takes) and "\x1b" not in shown


@pytest.mark.parametrize("name", REGISTRY)
def test_what_is_explained_of_one(name, capsys):
    facts = asked(name)[name]
    shown = capsys.readouterr().out
    assert facts["label"] in shown and facts["remedy"] in shown
    assert all(f"{parameter} [{said['unit']}]" in shown for parameter, said in facts["parameters"].items())
    required = {parameter for parameter, spec in REGISTRY[name].parameters.items() if spec.default is None}
    assert {parameter for parameter, said in facts["parameters"].items() if said["default"] is None} == required


def test_an_id_that_there_is_not_and_one_that_the_axis_cannot_have(capsys):
    with pytest.raises(InputError, match="did you mean backlash"):
        command.main(["backlsh"])
    with pytest.raises(InputError, match="a transmission that is not rigid"):
        command.main(["backlash", "--axis", str(config_file("emps.yaml"))])


def test_the_examples_of_the_page_are_taken(capsys):
    text = PAGE.read_text(encoding="utf-8")
    run = run_from_dict(yaml.safe_load(text.split("```yaml")[1].split("```")[0]), "run.yaml")
    assert set(run.effects) == {"backlash", "friction_level_change"}
    terms = check_effects(yaml.safe_load(re.search(r"`(screw_pitch_error: \{.*?\})`", text, re.S)[1]))
    assert len(terms["screw_pitch_error"]["amplitude_m"]) == 2


def test_the_page_in_docs_is_what_the_command_writes(capsys):
    assert command.main(["--markdown"]) == 0
    assert capsys.readouterr().out == pathlib.Path(PAGE).read_text(encoding="utf-8")
