"""One run of a coarse axis with a fine stage on top, without ROS.

The coarse axis is controlled by its own law on its own encoder. The fine stage is controlled, by integral action, on
what an interferometer sees of the top: coarse position + fine position. So the fine stage takes what the coarse one
leaves, and returns to its middle as the coarse one arrives.

    (m_c + m_f) dv_c/dt = … − m_f dv_f/dt,      m_f dv_f/dt = … − m_f dv_c/dt        v_f relative to the coarse stage

Each component is solved exactly over a sixteenth of a period; the force between them is that of the piece before. A
delay of a piece takes damping from the fine stage's resonance w_0 of about (m_f/m) w_0 T/16, far less than it has.
"""

import math

import numpy as np

from microstage_ros import __version__
from microstage_ros.control.laws import registry as laws
from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.runs.simulate import run_controller
from microstage_ros.model.coarse_fine import FINE_LAW
from microstage_ros.model.sensors.readings import read_sensors
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import Record
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work, usual_start
from microstage_ros.solver.step import advance

PIECES = 16             # of a period, between which the components exchange their forces
# of a plant: numbers that belong to the period of reading
SENSORS = ("current_filter", "current_sample", "sensor_parameters")
TRACE = (
    "encoder_m",
    "current_A",
    "motor_angle_rad",
    "interferometer_m",
    "voltage_V",
    "fine_position_m",
    "fine_command_V",
    "stage_m",
    "stage_velocity_m_s",
)


@compiled
def run_both(coarse, fine, reference, disturbance, mass, trace):
    """Run both components over all rows of ``reference`` [m]; fills ``trace`` (rows, len(TRACE)).

    ``coarse``, ``fine``: tuples of plant, state, work, readings, parameters and memory of the law, each an array of
    one.
    """
    plant, state, work, readings, law, memory = (
        coarse[0][0],
        coarse[1][0],
        coarse[2][0],
        coarse[3][0],
        coarse[4][0],
        coarse[5][0],
    )
    plant_f, state_f, work_f, readings_f, law_f, memory_f = (
        fine[0][0],
        fine[1][0],
        fine[2][0],
        fine[3][0],
        fine[4][0],
        fine[5][0],
    )
    push, push_f, speed, speed_f = plant.push, plant_f.push, state.v, state_f.v
    pull_f = 0.0
    for n in range(len(reference)):
        read_sensors(plant, state, readings)
        read_sensors(plant_f, state_f, readings_f)
        top = readings.interferometer + state_f.x
        command = laws.controller_step(law, memory, reference[n], readings.encoder, readings.current) + disturbance[n]
        command_f = laws.controller_step(law_f, memory_f, reference[n], top, np.nan)
        trace[n, 0], trace[n, 1], trace[n, 2], trace[n, 3] = (
            readings.encoder,
            readings.current,
            readings.motor_angle,
            top,
        )
        trace[n, 4], trace[n, 5], trace[n, 6] = command, readings_f.encoder, command_f
        trace[n, 7], trace[n, 8] = state.x + state_f.x, state.v + state_f.v
        for _ in range(PIECES):
            plant.push = push - pull_f
            advance(plant, state, work, command)
            pull, speed = mass * (state.v - speed) / plant.period, state.v
            plant_f.push = push_f - pull
            advance(plant_f, state_f, work_f, command_f)
            pull_f, speed_f = mass * (state_f.v - speed_f) / plant_f.period, state_f.v
    plant.push, plant_f.push = push, push_f


def make_piece(axis, noise=None, effects=None):
    """`solver.plant.make_plant` for pieces of the axis's period; sensors stay those of the period, the amplifier's
    noise its density; ``noise``: `NoiseSpec`."""
    whole = make_plant(axis, noise, effects)
    plant = make_plant(axis.with_values({"period": axis.value("period") / PIECES}), noise, effects)
    for name in SENSORS:
        plant[name] = whole[name]
    plant["amplifier_noise"] *= math.sqrt(PIECES)
    return plant


def simulate_coarse_fine(machine, run, seed=0):
    """Columns {name: (rows,)} of one run of a `CoarseFine`.

    Parameters
    ----------
    machine : `model.coarse_fine.CoarseFine`.
    run : `control.runs.run_file.Run`; its noise and effects are those of the coarse axis.
    seed : of every random number [1].

    Raises
    ------
    InputError : a voltage file, another period, or what `make_plant` refuses.
    """
    coarse, fine = machine.coarse, machine.fine
    period, mass = coarse.value("period"), fine.value("stage.mass")
    if run.period_s is not None and abs(run.period_s / period - 1.0) > 1e-9:
        raise InputError(f"{run.place}: period_s", run.period_s, f"{period:g} s, the period of both components")
    tables = run.tables(period)
    if np.any(tables["open_loop"]):
        raise InputError(
            f"{run.place}: program", "voltage_file", "references: each component has a controller of its own"
        )
    plant, plant_f = make_piece(machine.alone["coarse"], NoiseSpec(**run.noise), run.effects), make_piece(fine)
    controller, controller_f = run_controller(coarse, run), make_controller(FINE_LAW, fine)
    state = new_state(plant, seed=seed, position=tables["start"], friction=run.friction or usual_start(plant))
    trace = np.empty((len(tables["reference"]), len(TRACE)))
    parts = []
    for each, begin, law in ((plant, state, controller), (plant_f, new_state(plant_f, seed=seed + 1), controller_f)):
        records = [each, begin, new_work(each), new_readings(), law.parameters, law.memory]
        parts.append(tuple(np.ndarray((1,), record.dtype, record) for record in records))
    run_both(*parts, tables["reference"], tables["disturbance"], mass, trace)
    columns = {"t_s": np.arange(len(trace)) * period, "reference_m": tables["reference"]}
    columns |= {name: trace[:, place].copy() for place, name in enumerate(TRACE)}
    if tables["disturbance"].any():
        columns["disturbance_V"] = tables["disturbance"]
    return columns


def coarse_fine_record(machine, run, seed=0):
    """`Record` of `simulate_coarse_fine`, with version, ``seed`` [1], components and run in its metadata."""
    columns = simulate_coarse_fine(machine, run, seed)
    metadata = {
        "version": __version__,
        "seed": seed,
        "axis": machine.name,
        "run": run.place,
        "controller": run.controller,
        "noise": run.noise,
        "effects": run.effects,
        "components": {"coarse": machine.coarse.name, "fine": machine.fine.name},
    }
    return Record(float(machine.coarse.value("period")), columns, run.place, metadata)
