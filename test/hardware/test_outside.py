"""Backends from outside: modules on PYTHONPATH, entry points, what is wrong with them."""

import math
import textwrap
from types import SimpleNamespace

import pytest

from microstage_ros import hardware
from microstage_ros.commands.backend import chosen_backend
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.outside import OutsideBackend
from microstage_ros.hardware.protocol import HardwareError, Reading, Setup, instruments, safety_members
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

AXIS = load_axis(config_file("axis.yaml"))

MODULE = """
    import math

    class Card:
        simulated = False

        def __init__(self, setup):
            self.setup, self.written, self.log = setup, 0.0, []
            if "bad" in setup.options:
                raise ValueError("option bad")

        def open(self):
            self.log.append("open")

        def read(self):
            if self.setup.options.get("burst"):
                raise OSError("cable out")
            return self.setup.options.get("reading", 1.0e-6)

        def write(self, voltage):
            self.written = voltage

        def close(self):
            self.log.append("close")

    class Simulated(Card):
        simulated = True

    class Half:
        def __init__(self, setup):
            pass
        def open(self):
            pass
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """The name of a module in a temporary folder on the path."""
    (tmp_path / "laboratory").mkdir()
    (tmp_path / "laboratory" / "card.py").write_text(textwrap.dedent(MODULE))
    (tmp_path / "laboratory" / "broken.py").write_text("import a_package_that_is_not_there\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    return "laboratory.card"


def made(name, **options):
    return make_hardware(name, Setup(AXIS, 3, options))


def test_a_class_from_the_path_needs_five_members_only(module):
    card = made(f"{module}:Card")
    card.open()
    assert card.read()[:1] == (1e-6,) and math.isnan(card.read().current)
    card.write(0.25)
    card.close()
    assert card.written == 0.25 and card.log == ["open", "close"] and card.setup.seed == 3
    assert not card.simulated and not card.has_truth and not hasattr(card, "arrays")
    assert made(f"{module}:Simulated").simulated


@pytest.mark.parametrize("given, expected", [
    (Reading(1.0, 2.0, 3.0), (1.0, 2.0, 3.0)), ((1.0, 2.0), (1.0, 2.0, math.nan)), ([1.0, None, 3.0], (1.0, math.nan, 3.0)),
    (SimpleNamespace(encoder=1.0, current=None), (1.0, math.nan, math.nan))])
def test_forms_of_a_reading(module, given, expected):
    assert made(f"{module}:Card", reading=given).read() == pytest.approx(expected, nan_ok=True)


class Unsafe:
    """A card whose safety members fail, each in its own way."""

    simulated, pressed, switches = False, 1, (0, 1)

    def __init__(self, setup):
        self.enabled = []

    def open(self):
        pass

    def read(self):
        return 0.0

    def write(self, voltage):
        pass

    def close(self):
        pass

    def enable(self, on):
        if on:
            raise OSError("cable out")
        self.enabled.append(on)

    def e_stop(self):
        if self.pressed is None:
            raise OSError("cable out")
        return self.pressed

    def limit_switches(self):
        return self.switches

    def temperature(self):
        raise ValueError("no sensor")


def test_safety_members_raise_errors_of_the_hardware_and_give_what_is_expected():
    card = OutsideBackend("unsafe", Unsafe, Setup(AXIS))
    members = safety_members(card)
    assert set(members) == {"enable", "e_stop", "limit_switches"}
    assert members["e_stop"]() is True and members["limit_switches"]() == (False, True)
    members["enable"](False)
    assert card._inner.enabled == [False]
    with pytest.raises(HardwareError, match=r"^enable\(\): OSError: cable out$"):
        members["enable"](True)
    card._inner.pressed = None
    with pytest.raises(HardwareError, match=r"^e_stop\(\): OSError: cable out$"):
        members["e_stop"]()
    for wrong in (None, 3, (True,), (True, False, True)):
        card._inner.switches = wrong
        with pytest.raises(HardwareError, match=r"^limit_switches\(\) gave .*, expected \(lower, upper\), True for the one that is actuated$"):
            members["limit_switches"]()
    with pytest.raises(HardwareError, match="no sensor"):
        instruments(card)["temperature"]()


def test_what_it_raises_is_an_error_of_the_hardware(module):
    with pytest.raises(HardwareError, match="read.*OSError: cable out"):
        made(f"{module}:Card", burst=True).read()
    with pytest.raises(HardwareError, match="expected Reading"):
        made(f"{module}:Card", reading="far").read()


@pytest.mark.parametrize("name, words", [
    ("abacus", "one of simulated, daq.* or package.module:Class"),
    ("laboratory.card", "package.module:Class"),
    ("laboratory.card:None.", "package.module:Class"),
    ("laboratory.nothing:Card", "module laboratory.nothing that can be imported.*No module named"),
    ("laboratory.broken:Card", "that can be imported.*a_package_that_is_not_there"),
    ("laboratory.card:Chart", "a class named Chart in module laboratory.card"),
    ("laboratory.card:Half", "missing: read, write, close, simulated")])
def test_one_line_says_what_is_wrong(module, name, words):
    with pytest.raises(InputError, match=words) as caught:
        made(name)
    assert "\n" not in str(caught.value)


def test_a_constructor_that_fails(module):
    with pytest.raises(InputError, match="ValueError: option bad"):
        made(f"{module}:Card", bad=1)


def test_an_entry_point(module, monkeypatch):
    point = SimpleNamespace(name="lab_card", value=f"{module}:Card")
    monkeypatch.setattr(hardware.importlib.metadata, "entry_points", lambda group: [point] if group == hardware.GROUP else [])
    assert made("lab_card").read().encoder == 1e-6
    with pytest.raises(InputError, match="lab_card"):
        made("other_card")


def test_mode_and_words_follow_the_backend(module, tmp_path):
    options = tmp_path / "card.yaml"
    options.write_text("reading: 2.0e-6\n")

    def chosen(name, file=str(options)):
        return chosen_backend(SimpleNamespace(backend=name, backend_options=file, seed=1), AXIS)

    real, simulated = chosen(f"{module}:Card"), chosen(f"{module}:Simulated")
    assert real.mode == "paced" and simulated.mode == "lockstep" and chosen("simulated", None).mode == "lockstep"
    assert "simulated" not in real.words("axis", 1).lower() and "simulated" in simulated.words("axis", 1)
    assert real.driver_parameters == {"backend": f"{module}:Card", "backend_options": "{reading: 2.0e-06}"}
    assert real.nodes(("axis_driver", "interferometer_logger")) == ("axis_driver",)
    with pytest.raises(InputError, match="its own time"):
        real.mode_or("lockstep")
    options.write_text("- 1\n")
    with pytest.raises(InputError, match="card.yaml.*a mapping"):
        chosen(f"{module}:Card")
    with pytest.raises(InputError, match="none.yaml"):
        chosen(f"{module}:Card", "none.yaml")
