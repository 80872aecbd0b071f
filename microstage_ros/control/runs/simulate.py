"""One run of the model without ROS: axis, run and seed in, columns out."""

import numpy as np

from microstage_ros import __version__
from microstage_ros.control.laws.controller import Controller, controller_parameters
from microstage_ros.control.runs.closed_loop import SURROUNDINGS, TRACE, run_loop, surroundings
from microstage_ros.control.trajectories.lead_in import lead_in
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.top_speed import top_speed
from microstage_ros.quantities.command import VOLTAGE
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import Record
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work, usual_start

PIECE = 100_000
"""Control periods between two reports of progress; the state passes from piece to piece unchanged."""


def run_controller(axis, run):
    """The controller that a run asks for: its own section, or the axis's shipped one."""
    section = dict(run.controller) or {"type": axis.controller.get("type", "none")}
    kind = section.pop("type")
    return Controller(kind, controller_parameters(kind, axis, section, place=f"{run.place}: controller"))


def simulate(axis, run, seed=0, machine=None, progress=None, finish=None):
    """Simulate one run.

    A reference that begins in motion is led in from rest (see `control.trajectories.lead_in`), unless the run says
    where it starts.

    Parameters
    ----------
    axis : `Axis` that the controller is given. run : `control.runs.run_file.Run`.
    seed : of every random number in the run [1].
    machine : `Axis` that is simulated, where it is another one (default: ``axis.machine``, else ``axis``).
    progress : called with (periods done, periods in all), or None.
    finish : called with the `Controller` at the end, or None.

    Returns
    -------
    dict of columns, each of shape (rows,): those of a record (`records.columns`), and what only a
    simulator knows: true stage position and velocity, motor speed, friction and friction levels.

    Raises
    ------
    InputError : the machine's drive is commanded in another quantity than the axis's.
    """
    machine = machine or axis.machine or axis
    if actuator_of(machine).command != actuator_of(axis).command:
        raise InputError(f"{machine.place}: drive.type", machine.choices["drive.type"],
                         f"a drive commanded in {actuator_of(axis).command.units}, as that of {axis.place}")
    if run.period_s is not None:
        axis, machine = (each.with_values({"period": run.period_s}, source="derived") for each in (axis, machine))
    period = axis.value("period")
    tables = run.tables(period, top_speed(machine))
    plant = make_plant(machine, noise=NoiseSpec(**run.noise), effects=run.effects)
    before = (
        np.empty(0)
        if run.start_m is not None
        else lead_in(tables["reference"], axis.value("sensors.encoder.resolution"))
    )
    friction = run.friction or usual_start(plant)
    state = new_state(
        plant, seed=seed, position=float(before[0]) if len(before) else tables["start"], friction=friction
    )
    controller = run_controller(axis, run)
    led = {name: np.concatenate([before if name == "reference" else 0.0 * before, tables[name]])
           for name in ("reference", "open_loop", "disturbance")}
    trace = np.empty((len(led["reference"]), len(TRACE)))
    work, readings = new_work(plant), new_readings()
    for start in range(0, len(trace), PIECE if progress else len(trace)):
        rows = slice(start, start + PIECE) if progress else slice(None)
        run_loop(
            plant, state, work, readings, controller.parameters, controller.memory,
            led["reference"][rows], led["open_loop"][rows], led["disturbance"][rows], trace[rows],
        )
        if progress:
            progress(min(start + PIECE, len(trace)), len(trace))
    if finish:
        finish(controller)
    trace = trace[len(before):]
    columns = {"t_s": np.arange(len(trace)) * period, "reference_m": tables["reference"]}
    columns |= {name: trace[:, place].copy() for place, name in enumerate(TRACE) if name not in SURROUNDINGS}
    columns |= surroundings(trace)
    actuator = actuator_of(machine)
    columns[actuator.command.column] = columns.pop("voltage_V")
    columns |= actuator.derived_columns(machine, columns)
    if not actuator.measures_current:
        del columns["current_A"]
    if tables["disturbance"].any():
        columns[actuator.command.disturbance] = tables["disturbance"]
    return columns


def simulated_record(axis, run, seed=0, machine=None, progress=None, **more):
    """`Record` of `simulate`, with version, ``seed`` [1], axis, run and what the law has learned of the axis (SI) in
    its metadata."""
    learned = {}
    columns = simulate(axis, run, seed, machine, progress, lambda controller: learned.update(controller.learned))
    metadata = {
        "version": __version__,
        "seed": seed,
        "axis": axis.name,
        "run": run.place,
        "controller": run.controller,
        "noise": run.noise,
        "effects": {**(machine or axis).effects, **run.effects},
        **more,
    }
    if learned:
        metadata["learned"] = {name: number._asdict() for name, number in learned.items()}
    if machine is not None:
        metadata["machine"] = machine.as_dict()
    command = actuator_of(axis).command
    if command is not VOLTAGE:
        metadata["command"] = command.as_dict()
    return Record(float(columns["t_s"][1] - columns["t_s"][0]), columns, run.place, metadata)
