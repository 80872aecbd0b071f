"""What the observer law could reach if it knew the axis: its regulator, given the true motion.

Sensors, amplifier, friction and observer are those of every trial; only what the regulator reads of the observer
is replaced by the simulator's position of the stage, or speed of the motor, or both. Told both, what is left is the
price of a voltage that is held for a period while friction changes, and of the regulator's own lag. What lies
between is the price of not knowing, and says which of the two estimates it is paid for. With lost motion in the drive
the observer may be given: the gap, or the gap and when its contacts open and close.
"""

import numpy as np

from microstage_ros.control.evaluation.least_error import least_error
from microstage_ros.control.laws import pid
from microstage_ros.control.laws import registry as laws
from microstage_ros.control.laws import self_tuning_observer
from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.observer import law as observer_law
from microstage_ros.control.observer import lost_motion
from microstage_ros.control.runs.closed_loop import TRACE, run_loop
from microstage_ros.control.trajectories.profiles import sine
from microstage_ros.model.sensors.readings import sense
from microstage_ros.numerics.compiled import compiled
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work, usual_start
from microstage_ros.solver.step import advance

LEFT = 2e-9  # m, from the contact at which it is given as open
GIVEN_OF_GAP = ("nothing", "gap", "contact")
GAP_WIDTH = 0.00873  # rad, 0.5 degrees
PERIODS = (1e-4, 2e-4, 5e-4, 1e-3)  # s
GIVEN = {"nothing": (False, False), "position": (True, False), "speed": (False, True), "both": (True, True)}


@compiled
def observe(plant, state, readings, parameters, memory, reference):
    """A period of the observer law up to its regulator, for the ``reference`` [m] of now."""
    sense(plant, state, readings)
    if memory.started == 0:
        laws.controller_start(parameters, memory, reference, readings.encoder)
    pid.pid_motion(parameters.pid, memory.pid, parameters.period, reference, readings.encoder)
    observer_law.observer_step(
        parameters.observer,
        parameters.feedforward,
        memory.observer,
        parameters.period,
        readings.encoder,
        memory.voltage,
        readings.current,
    )


@compiled
def run_informed(plant, state, work, readings, parameters, memory, reference, position, speed, stage):
    """The loop of `closed_loop` whose regulator is given ``position`` or ``speed``; fills ``stage`` [m]."""
    observer = memory.observer
    for n in range(len(reference)):
        stage[n] = state.x
        observe(plant, state, readings, parameters, memory, reference[n])
        x, v = observer.x, observer.v
        if position:
            observer.x = state.x - observer.swing
        if speed:
            observer.v = plant.ratio * state.omega
        memory.voltage = self_tuning_observer.regulate(parameters, memory, reference[n])
        observer.x, observer.v = x, v
        advance(plant, state, work, memory.voltage)


def informed_sine(axis, seed, given="both", period=None, amplitude=1e-5, frequency=0.1, cycles=1.25):
    """Largest |true position - reference| [m] of a sine, without its first quarter cycle; ``given``: of `GIVEN`.

    ``amplitude`` [m], ``frequency`` [Hz], ``cycles`` [1]; ``period`` of control [s], None: the axis's; ``seed`` [1].
    """
    axis = axis if period is None else axis.with_values({"period": period}, source="derived")
    reference = sine(0.0, amplitude, frequency, cycles, axis.value("period"))
    plant, controller = make_plant(axis.machine or axis, NoiseSpec()), make_controller("self_tuning_observer", axis)
    state, stage = new_state(plant, seed=seed, friction=usual_start(plant)), np.empty(len(reference))
    run_informed(
        plant,
        state,
        new_work(plant),
        new_readings(),
        controller.parameters,
        controller.memory,
        reference,
        *GIVEN[given],
        stage,
    )
    return float(np.abs(stage - reference)[int(0.25 / cycles * len(reference)) :].max())


@compiled
def run_given_contact(plant, state, work, readings, parameters, memory, reference, stage):
    """The loop of `closed_loop` whose observer is given what of lost motion the simulator knows; fills ``stage`` [m].

    That is the gap, the moment at which the contact opens and at which it closes, and the motor's way and speed
    between.
    """
    o, side = memory.observer, state.side
    for n in range(len(reference)):
        stage[n] = state.x
        observe(plant, state, readings, parameters, memory, reference[n])
        o.gap, o.gap_variance = plant.gap, 0.0
        slack = plant.ratio * state.theta - state.x
        side = state.side if state.side != 0 else side
        ahead = side * (reference[n] - memory.reference) < 0.0  # the reference leads the other way
        if o.contact == lost_motion.TOUCHING and side != 0 and side * slack < 0.5 * plant.gap - LEFT and ahead:
            o.side, o.confirmed = side, 1
            lost_motion.open_contact(o, -1.0 * side, 0.0, 0.0)
        if o.contact != lost_motion.TOUCHING:
            o.travel, o.v = 0.5 * plant.gap + o.toward * slack, plant.ratio * state.omega
            if state.side == o.toward:
                lost_motion.settle(o, o.toward)
        memory.reference = reference[n]
        memory.voltage = self_tuning_observer.regulate(parameters, memory, reference[n])
        advance(plant, state, work, memory.voltage)


def gap_sine(axis, seed, given, width, amplitude=1e-5, frequency=0.1, cycles=3.25):
    """Largest |true position - reference| [m] of a sine through lost motion of ``width`` [rad]: (first cycle, last
    cycle).

    ``given``: "nothing", the "gap", or the gap and the "contact", see `run_given_contact`.
    ``amplitude`` [m], ``frequency`` [Hz], ``cycles`` [1], ``seed`` [1].
    """
    reference = sine(0.0, amplitude, frequency, cycles, axis.value("period"))
    plant = make_plant(axis.machine or axis, NoiseSpec(), effects={"backlash": {"width_rad": width}})
    gains = {} if given == "nothing" else {"known_gap": float(plant["gap"])}
    controller, stage = make_controller("self_tuning_observer", axis, **gains), np.empty(len(reference))
    state, work, none = (
        new_state(plant, seed=seed, friction=usual_start(plant)),
        new_work(plant),
        np.zeros_like(reference),
    )
    if given == "contact":
        run_given_contact(plant, state, work, new_readings(), controller.parameters, controller.memory, reference,
                          stage)
    else:
        trace = np.empty((len(reference), len(TRACE)))
        run_loop(
            plant, state, work, new_readings(), controller.parameters, controller.memory, reference, none, none, trace
        )
        stage = trace[:, TRACE.index("stage_m")]
    cycle = round(1.0 / frequency / axis.value("period"))
    error = np.abs(stage - reference)[cycle // 4 :]
    return float(error[:cycle].max()), float(error[-cycle:].max())


def limits(evaluation, periods=PERIODS):
    """Worst peak [m] of the sine of 10 um at 0.1 Hz, by what the regulator is given: {period [s]: {`GIVEN`: peak}}.

    ``periods``: of control [s].
    Beside them `least`, of `least_error`.
    """
    evaluation.progress("what not knowing costs")
    jobs = [(period, given, seed) for period in periods for given in GIVEN for seed in range(evaluation.extent.seeds)]
    found = {period: dict.fromkeys(GIVEN, 0.0) for period in periods}
    for (period, given, _), peak in zip(
        jobs, evaluation.each(lambda job: informed_sine(evaluation.axis, job[2], job[1], job[0]), jobs)
    ):
        found[period][given] = max(found[period][given], peak)
    for period in periods:
        found[period]["least"] = least_error(evaluation.axis, period, evaluation.extent.seeds)[1]
    return found


def gap_limits(evaluation):
    """Worst peak [m] of the sine of 10 um at 0.1 Hz with a gap of 0.5 degrees, {of `GIVEN_OF_GAP`: (first cycle,
    third)}."""
    evaluation.progress("what not knowing a gap costs")
    jobs = [(seed, given) for given in GIVEN_OF_GAP for seed in range(evaluation.extent.seeds)]
    peaks = evaluation.each(lambda job: gap_sine(evaluation.axis, job[0], job[1], GAP_WIDTH), jobs)
    return {
        given: tuple(max(p[k] for (_, of), p in zip(jobs, peaks) if of == given) for k in range(2))
        for given in GIVEN_OF_GAP
    }
