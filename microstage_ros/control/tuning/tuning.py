"""Tuning: limit-cycle experiment, Ziegler-Nichols, fine tuning by simulation, margins.

The experiment replaces the controller by a relay with hysteresis, U = U_0 +- d as the error's sign says, on the
axis as it is, friction and all, and reads amplitude and period of the limit cycle that follows. The ratio of
the fundamentals of voltage and position is the ultimate gain K_u, the period the ultimate period T_u.
Ziegler and Nichols: K_P = 0.6 K_u, T_I = T_u / 2, T_D = T_u / 8. Near standstill the axis is far from linear, so
this is the rough estimate that the paper takes it for; fine tuning follows on simulated friction.

Gains, ``gains`` and ``start``, are {name: number in the unit of its `control.gains.Gain`}; ``seed``, ``seeds`` (k,) and
``evaluations`` are counts [1].
"""

import math
from typing import NamedTuple

import numpy as np

from microstage_ros.control.runs.trials import sine_trial, step_trial
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import controller_margins, pid_margins
from microstage_ros.model.sensors.readings import read_sensors
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work
from microstage_ros.solver.step import advance

SEARCHED = ("proportional", "integral_time", "derivative_time", "filter_time")
LEAST_PHASE = 30.0  # degrees, in pre-sliding and at full speed (paper, section 5.1)
LEAST_GAIN = 6.0  # dB, there
GUARDED = ("pre-sliding", "sliding, 1000 um/s")


class LimitCycle(NamedTuple):
    """Outcome of a relay experiment."""

    ultimate_gain: float  # V/m
    ultimate_period: float  # s
    amplitude: float  # m, of the position's fundamental
    relay: float  # V


class Tuning(NamedTuple):
    """Gains, their cost, and their margins in every regime."""

    gains: dict
    cost: float
    margins: list


@compiled
def run_relay(plant, state, work, readings, bias, relay, hysteresis, encoder, voltage):
    """Relay control about 0 m; fills ``encoder`` [m] and ``voltage`` [V]."""
    sign = 1.0
    for n in range(encoder.size):
        read_sensors(plant, state, readings)
        if readings.encoder > hysteresis:
            sign = -1.0
        elif readings.encoder < -hysteresis:
            sign = 1.0
        encoder[n] = readings.encoder
        voltage[n] = bias + sign * relay
        advance(plant, state, work, voltage[n])


def limit_cycle(axis, relay=None, hysteresis=None, duration=2.0, seed=0):
    """Automatic limit-cycle experiment on the simulated axis.

    ``duration`` [s]; ``relay`` [V]: half height, default four times the breakaway voltage. ``hysteresis`` [m]: default
    forty counts, enough to slide. Returns `LimitCycle`; raises `InputError` if no limit cycle follows (the relay is too
    weak).
    """
    plant = make_plant(axis, NoiseSpec())
    resolution = axis.value("sensors.encoder.resolution")
    relay = 4.0 * breakaway_voltage(axis) if relay is None else relay
    hysteresis = 40.0 * resolution if hysteresis is None else hysteresis
    rows = round(duration / axis.value("period"))
    encoder, voltage = np.empty(rows), np.empty(rows)
    state = new_state(plant, seed)
    run_relay(plant, state, new_work(plant), new_readings(), 0.0, float(relay), float(hysteresis), encoder, voltage)
    encoder, voltage = encoder[rows // 2 :], voltage[rows // 2 :]
    turns = np.flatnonzero((voltage[:-1] < 0) & (voltage[1:] > 0))
    if len(turns) < 4:
        raise InputError(
            "relay", relay, f"a voltage above breakaway, {breakaway_voltage(axis):.3g} V, that swings the axis"
        )
    first, last = turns[0] + 1, turns[-1] + 1
    period = (last - first) / (len(turns) - 1) * axis.value("period")
    phase = np.exp(-2j * math.pi * np.arange(last - first) * axis.value("period") / period)
    u, y = (2 * abs(np.mean(signal[first:last] * phase)) for signal in (voltage, encoder))
    return LimitCycle(float(u / y), float(period), float(y), float(relay))


def breakaway_voltage(axis):
    """Voltage [V] at which both contacts of the nominal axis break away."""
    model = controller_parameters("pid_feedforward", axis, {})["feedforward"]
    force = float(model["volts_per_torque"]) * float(model["actuator"][0])
    return force + float(model["volts_per_force"]) * float(model["guideway"][0])


def ziegler_nichols(cycle, filter_share=0.3):
    """PID gains of a limit cycle; the derivative's filter is ``filter_share`` [1] of T_D."""
    derivative = cycle.ultimate_period / 8.0
    return {
        "proportional": 0.6 * cycle.ultimate_gain,
        "integral_time": 0.5 * cycle.ultimate_period,
        "derivative_time": derivative,
        "filter_time": filter_share * derivative,
        "derivative_on_reference": 1.0,
    }


def cost_of(axis, kind, gains, seeds):
    """Cost [nm] of gains: peak error of slow sines, twice the scatter and 0.2 per ms of settling of moves.

    What a move overshoots beyond `allowed_overshoot` counts in full.
    """
    sine = max(sine_trial(axis, kind, gains, 1e-5, 0.1, seed, cycles=1.0).peak for seed in seeds)
    distances = (1e-6, 1e-5, 1e-3)
    moves = [step_trial(axis, kind, gains, distance, seeds[0], moves=2, dwell=0.25) for distance in distances]
    worst = max(np.abs(trial.errors).max() for trial in moves)
    settling = sum(float(np.median(np.nan_to_num(trial.settling, nan=0.4))) for trial in moves)
    beyond = sum(max(t.overshoot.max() - allowed_overshoot(d), 0.0) for t, d in zip(moves, distances))
    return 1e9 * (sine + 2.0 * worst + beyond) + 200.0 * settling


def allowed_overshoot(distance):
    """Overshoot [m] that a move over ``distance`` [m] may have: 5 %, or 50 nm, whichever is larger."""
    return max(0.05 * distance, 50e-9)


def search(cost, start, evaluations, seed=0, accept=None, progress=None, names=SEARCHED):
    """Local random search over the logarithms of the gains ``names``.

    ``cost``: gains -> number; ``accept``: gains -> whether they are worth a simulation; ``progress`` is called
    with the number of candidates done. Returns (gains, cost).
    """
    random = np.random.default_rng(seed)
    best, best_cost, width = dict(start), cost(start), 0.25
    for done in range(evaluations):
        factors = np.exp(width * random.standard_normal(len(names)))
        candidate = {**best, **{name: best[name] * factor for name, factor in zip(names, factors)}}
        if accept is None or accept(candidate):
            found = cost(candidate)
            if found < best_cost:
                best, best_cost = candidate, found
            else:
                width = max(0.97 * width, 0.05)
        if progress:
            progress(done + 1)
    return best, best_cost


def fine_tune(axis, kind, start, seeds=(0, 1), evaluations=40, seed=0, progress=None):
    """Fine tuning by simulation over friction seeds, from the gains ``start``.

    Candidates with less than `LEAST_PHASE` or `LEAST_GAIN` in the `GUARDED` regimes are not simulated. Returns
    `Tuning`.
    """
    best, cost = search(
        lambda gains: cost_of(axis, kind, gains, seeds), start, evaluations, seed,
        lambda gains: guarded(pid_margins(axis, gains)), progress,
    )
    return Tuning(best, cost, controller_margins(axis, controller_parameters(kind, axis, best)))


def guarded(margins):
    """Whether the guarded regimes keep the least margins."""
    guarded = [m for m in margins if m.regime in GUARDED]
    return all(m.stable and m.phase_deg >= LEAST_PHASE and m.gain_db >= LEAST_GAIN for m in guarded)
