"""A usage error is one line and status 2, for every command that parses its own options."""

import importlib

import pytest

from microstage_ros.commands import COMMANDS, module_of

OWN = [name for name in COMMANDS if name not in ("test", "cell", "demo", "move", "replay", "experiment")]


@pytest.mark.parametrize("name", OWN)
def test_usage_error_is_one_line(name, capsys):
    with pytest.raises(SystemExit) as stop:
        importlib.import_module(module_of(name)).main(["--no-such-option", "x"])
    said = capsys.readouterr().err
    assert stop.value.code == 2 and len(said.splitlines()) == 1
    assert f"microstage {name}" in said and "--help" in said
