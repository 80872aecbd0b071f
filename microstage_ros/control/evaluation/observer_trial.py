"""How well the friction observer knows what the simulator knows."""

import numpy as np

from microstage_ros.control.runs.trials import jump_trace, trial
from microstage_ros.control.observer import law as observer_law
from microstage_ros.control import friction_observer as observer
from microstage_ros.control.runs.closed_loop import TRACE
from microstage_ros.control.trajectories.profiles import sine
from microstage_ros.numerics.compiled import compiled

MOTIONS = {
    "sine 10 um": [{"sine": {"amplitude_m": 1e-5, "frequency_hz": 0.1, "cycles": 1.0}}],
    "sine 1 mm": [{"sine": {"amplitude_m": 1e-3, "frequency_hz": 0.3, "cycles": 1.0}}],
    "moves 1 um": [{"move_to_m": place, "dwell_s": 0.3} for place in (1e-6, 0.0, 1e-6, 0.0)],
    "moves 10 um": [{"move_to_m": place, "dwell_s": 0.3} for place in (1e-5, 0.0, 1e-5, 0.0)],
    "moves 1 mm": [{"move_to_m": place, "dwell_s": 0.3} for place in (1e-3, 0.0, 1e-3, 0.0)],
}
LEVEL_JUMPS = (0.85, 1.15)
LEVEL_SINES = ((1e-5, 0.1), (1e-5, 0.25), (1e-4, 0.25))  # m, Hz
LEVEL_JUMP_AT, LEVEL_SEEN_BY, LEVEL_JUDGED_TO = 4.0, 6.0, 8.0  # s
LEVEL_SEEN = 0.02  # error of a level that is seen


@compiled
def replay(parameters, model, memory, period, encoder, voltage, current, trace):
    """Run the observer over a record; fills ``trace`` (rows, 4): force by the laws, unexplained force, level, x."""
    observer_law.observer_start(memory, encoder[0])
    before = 0.0
    for n in range(encoder.size):
        observer_law.observer_step(parameters, model, memory, period, encoder[n], before, current[n])
        before = voltage[n]
        trace[n, 0] = model.force_per_torque * memory.actuator_friction + memory.guideway_friction
        trace[n, 1] = model.moving_mass * memory.d
        trace[n, 2] = memory.level
        trace[n, 3] = memory.x


def observe(axis, columns, **gains):
    """Observer over the columns of a run, shape (rows, 4), see `replay`."""
    face = observer.FrictionObserver(axis, **gains)
    trace = np.empty((len(columns["t_s"]), 4))
    replay(
        face.parameters, face.model, face.memory, face.period, columns["encoder_m"], columns["voltage_V"],
        columns["current_A"], trace,
    )
    return trace


def observer_trial(axis, motion, seed, kind="self_tuning_observer"):
    """Relative rms error of the total friction [1], error of the level at the end [1], rms error of the position [m].

    ``seed`` of the run [1].
    """
    columns = trial(axis, kind, {}, MOTIONS[motion], seed)
    trace = observe(axis, columns)
    per_torque = axis.value("transmission.gear_ratio") / axis.value("transmission.pitch") * 2 * np.pi
    true = per_torque * columns["actuator_friction_Nm"] + columns["guideway_friction_N"]
    error = trace[:, 0] + trace[:, 1] - true
    slid = slice(len(error) // 2, None)
    return {
        "total": float(np.sqrt(np.mean(error**2) / np.mean(true**2))),
        "level": float(np.sqrt(np.mean((trace[slid, 2] - columns["actuator_level"][slid]) ** 2))),
        "position": float(np.sqrt(np.mean((trace[:, 3] - columns["stage_m"]) ** 2))),
    }


def level_jump_trial(axis, amplitude, frequency, factor, seed, kind="self_tuning_observer"):
    """The friction of both contacts becomes ``factor`` times what it was during a sine, its random part
    going on. ``amplitude`` [m], ``frequency`` [Hz], ``factor`` and ``seed`` [1].

    ``seen`` [s]: time after which the level is first within `LEVEL_SEEN` of the true one, once that has jumped;
    ``mean``, ``rms``: of its error from 2 to 4 s after the jump (the true level goes on varying at random).
    """
    def jump(plant):
        for contact in ("actuator", "guideway"):
            plant[contact]["level"] *= factor

    period = axis.value("period")
    reference = sine(0.0, amplitude, frequency, LEVEL_JUDGED_TO * frequency, period)
    row = round(LEVEL_JUMP_AT / period)
    trace = jump_trace(axis, kind, seed, reference, row, jump)
    columns = {name: trace[:, n] for n, name in enumerate(TRACE)} | {"t_s": period * np.arange(len(reference))}
    true = columns["actuator_level"]
    error = observe(axis, columns)[:, 2] - true
    jumped = row + int(np.argmax(np.abs(true[row:] / true[row - 1] - 1.0) > 0.5 * abs(factor - 1.0)))
    seen = np.abs(error[jumped:]) < LEVEL_SEEN
    late = error[round(LEVEL_SEEN_BY / period) :]
    return {
        "seen": (jumped - row + int(np.argmax(seen))) * period if seen.any() else np.inf,
        "mean": abs(float(np.mean(late))),
        "rms": float(np.sqrt(np.mean(late**2))),
    }
