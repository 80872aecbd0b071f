"""``--machine``: the simulated machine is another one than the controller is given."""

import pytest
import yaml

from microstage_ros.commands.__main__ import main
from microstage_ros.commands.backend import ChosenBackend, chosen_backend
from microstage_ros.commands.operation.cell import add_backend
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.run_on_cell import law_of, with_run
from microstage_ros.control.runs.run_file import run_from_dict
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import Setup
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import read_record

SHIPPED = str(config_file("axis.yaml"))


@pytest.fixture
def heavy(tmp_path):
    path = tmp_path / "heavy.yaml"
    load_axis(SHIPPED).with_values({"stage.mass": 9.0}).save(path)
    return path


def test_simulate_runs_on_the_machine_with_the_controller_of_the_axis(tmp_path, heavy):
    run = tmp_path / "run.yaml"
    run.write_text("controller: {type: pid}\nprogram: [{move_to_m: 1.0e-5, dwell_s: 0.05}]\n")
    assert main(["simulate", "--axis", SHIPPED, "--machine", str(heavy), "--run", str(run), "--out", str(tmp_path / "r.csv"), "--seed", "3"]) == 0
    shipped, machine = load_axis(SHIPPED), load_axis(heavy)
    given = run_from_dict({"controller": {"type": "pid"}, "program": [{"move_to_m": 1e-5, "dwell_s": 0.05}]})
    wanted, other = simulate(shipped, given, 3, machine), simulate(shipped, given, 3)
    written = read_record(tmp_path / "r.csv")["encoder_m"]
    assert written == pytest.approx(wanted["encoder_m"], abs=1e-12) and abs(wanted["stage_m"] - other["stage_m"]).max() > 1e-9


def test_the_simulated_backend_takes_it(heavy):
    parser = Parser(prog="p")
    add_backend(parser)
    chosen = chosen_backend(parser.parse_args(["--machine", str(heavy)]), load_axis(SHIPPED))
    made = make_hardware(chosen.name, Setup(load_axis(SHIPPED), 0, chosen.options))
    assert float(made.own_arrays[0][0]["mass"]) == 9.0 and chosen.simulated


@pytest.mark.parametrize("machine, words", [(str(config_file("emps.yaml")), "period"), ("/no/file.yaml", "file not found")])
def test_a_machine_that_does_not_fit_is_refused(tmp_path, capsys, machine, words):
    run = tmp_path / "run.yaml"
    run.write_text("controller: {type: pid}\nprogram: [{move_to_m: 1.0e-5}]\n")
    assert main(["simulate", "--axis", SHIPPED, "--machine", machine, "--run", str(run), "--out", str(tmp_path / "r.csv")]) == 2
    assert words in capsys.readouterr().err


def test_an_experiment_gives_the_effects_of_its_run_file_to_the_machine_that_it_simulates():
    axis = load_axis(SHIPPED)
    run = run_from_dict({"effects": {"backlash": {"width_rad": 0.02}}, "program": [{"move_to_m": 1e-5}]})
    chosen = with_run(ChosenBackend(options={"machine": SHIPPED}), run, axis)
    sent = yaml.safe_load(chosen.driver_parameters["backend_options"])
    assert sent == {"machine": SHIPPED, "effects": {"backlash": {"width_rad": 0.02}}}
    made, without = (make_hardware("simulated", Setup(axis, 0, options)).own_arrays[0][0] for options in (sent, {}))
    assert made["gap"] > 0.0 and without["gap"] == 0.0
    with pytest.raises(InputError, match="run: effects: got 'backlash', expected none, as backend daq has a machine"):
        with_run(ChosenBackend("daq", simulated=False), run, axis)


def test_an_experiment_takes_controller_noise_and_start_of_its_run_file(capsys):
    """They were left out, and the help said so; where they are another machine's that is said."""
    axis = load_axis(SHIPPED)
    run = run_from_dict({"controller": {"type": "pid", "proportional": 3.0e5}, "noise": {"encoder_m": 0.0}, "start_m": 1e-3,
                         "start": {"friction": "relaxed"}, "program": [{"move_to_m": 1e-5}]})
    sent = yaml.safe_load(with_run(ChosenBackend(options={"noise": {"current_A": 0.0}}), run, axis).driver_parameters["backend_options"])
    assert sent == {"noise": {"current_A": 0.0, "encoder_m": 0.0}, "position": 1e-3, "friction": "relaxed"}
    assert make_hardware("simulated", Setup(axis, 0, sent)).truth.stage_position == pytest.approx(1e-3)
    law = law_of(run, axis)
    assert law["controller"] == "pid" and yaml.safe_load(law["gains"]) == {"proportional": 3.0e5}
    assert capsys.readouterr().err == ""
    daq = ChosenBackend("daq", simulated=False)
    assert with_run(daq, run, axis) is daq and with_run(None, run, axis) is None
    assert capsys.readouterr().err.splitlines() == [
        "warning: run: noise, start_m, start not used: the machine of backend daq has its own",
        "warning: run: controller, noise, start_m, start not used: the cell that runs has its own"]
    with pytest.raises(InputError, match="controller.type: got 'none', expected a control law"):
        law_of(run_from_dict({"controller": {"type": "none"}, "program": [{"move_to_m": 1e-5}]}), axis)
    assert law_of(run_from_dict({"program": [{"move_to_m": 1e-5}]}), axis) == {}
    with pytest.raises(InputError, match="run: controller.*proportional"):
        law_of(run_from_dict({"controller": {"type": "pid", "proportional": -1.0}, "program": [{"move_to_m": 1e-5}]}), axis)
