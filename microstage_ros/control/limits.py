"""What the observer law could reach if it knew the axis: its regulator, told the true motion.

Sensors, amplifier, friction and observer are those of every trial; only what the regulator reads of the observer
is replaced by the simulator's position of the stage, or speed of the motor, or both. Told both, what is left is the
price of a voltage that is held for a period while friction changes, and of the regulator's own lag. What lies
between is the price of not knowing, and says which of the two estimates it is paid for.
"""

import numpy as np

from microstage_ros.axis.compiled import compiled
from microstage_ros.axis.plant import NoiseSpec, make_plant, new_readings, new_state, new_work
from microstage_ros.axis.sensors import sense
from microstage_ros.axis.step import advance
from microstage_ros.control import laws, observer_law, pid
from microstage_ros.control.controller import make_controller
from microstage_ros.control.profiles import sine

PERIODS = (1e-4, 2e-4, 5e-4, 1e-3)  # s
TOLD = {"nothing": (False, False), "position": (True, False), "speed": (False, True), "both": (True, True)}


@compiled
def run_informed(plant, state, work, readings, parameters, memory, reference, position, speed, stage):
    """The loop of `closed_loop` whose regulator is told ``position`` or ``speed``; fills ``stage`` [m]."""
    observer = memory.observer
    for n in range(len(reference)):
        sense(plant, state, readings)
        stage[n] = state.x
        if memory.started == 0:
            laws.controller_start(memory, reference[n], readings.encoder)
        pid.pid_motion(parameters.pid, memory.pid, parameters.period, reference[n], readings.encoder)
        observer_law.observer_step(
            parameters.observer, parameters.feedforward, observer, parameters.period, readings.encoder,
            memory.voltage, readings.current,
        )
        x, v = observer.x, observer.v
        if position:
            observer.x = state.x - observer.swing
        if speed:
            observer.v = plant.ratio * state.omega
        memory.voltage = laws.regulate(parameters, memory, reference[n])
        observer.x, observer.v = x, v
        advance(plant, state, work, memory.voltage)


def informed_sine(axis, seed, told="both", period=None, amplitude=1e-5, frequency=0.1, cycles=1.25):
    """Largest |true position - reference| [m] of a sine, without its first quarter of a cycle; ``told``: of `TOLD`."""
    axis = axis if period is None else axis.with_values({"period": period}, source="derived")
    reference = sine(0.0, amplitude, frequency, cycles, axis.value("period"))
    plant, controller = make_plant(axis, NoiseSpec()), make_controller("self_tuning_observer", axis)
    state, stage = new_state(plant, seed=seed), np.empty(len(reference))
    run_informed(
        plant, state, new_work(plant), new_readings(), controller.parameters, controller.memory, reference, *TOLD[told], stage
    )
    return float(np.abs(stage - reference)[int(0.25 / cycles * len(reference)) :].max())


def limits(bench, periods=PERIODS):
    """Worst peak [m] of the sine of 10 um at 0.1 Hz, by what the regulator is told: {period [s]: {`TOLD`: peak}}."""
    bench.progress("what not knowing costs")
    jobs = [(period, told, seed) for period in periods for told in TOLD for seed in range(bench.extent.stress_seeds)]
    found = {period: dict.fromkeys(TOLD, 0.0) for period in periods}
    for (period, told, _), peak in zip(jobs, bench.each(lambda job: informed_sine(bench.axis, job[2], job[1], job[0]), jobs)):
        found[period][told] = max(found[period][told], peak)
    return found
