"""Stability margins of a tuning on the linearised axis, in pre-sliding and in sliding.

Linearised, every sticking block of a contact is a spring and every slipping one nothing; the sliding curve
has the slope dM_f/dw = sigma - (F_s - F_C) (delta/V_S) (w/V_S)^(delta-1) exp(-(w/V_S)^delta), which below
V_S is negative. With motor, rotor, drive train and stage as in the model, voltage held over the period, and
the discrete controller, the loop is cut at the voltage. Gain margin: factor on all gains until
instability (upwards, and downwards where the loop is only conditionally stable). Phase margin: at the gain crossovers.
Paper, section 5.1: phase margin at least 30 degrees, gain margin about 40 dB.

``gains``: {name of `pid.GAINS`: number, SI}; ``period`` is that of control [s], ``delay`` counts further periods [1].
"""

import math
from typing import NamedTuple

import control
import numpy as np

from microstage_ros.control.laws import registry as laws
from microstage_ros.control.design.linear_loop import (
    OBSERVER_STATES,
    QUADRATIC_STATES,
    cut_loop,
    linear_matrices,
    observer_step,
    quadratic_step,
    regime_slopes,
)


class Margins(NamedTuple):
    """Margins of one loop in one regime."""

    regime: str
    stable: bool
    phase_deg: float
    gain_db: float  # upward gain margin
    gain_down_db: float  # how far the gains may fall (infinite if they may fall to zero)
    crossover_hz: float  # highest gain crossover
    sensitivity: float  # largest |1/(1+L)|


def linear_axis(axis, actuator=(0.0, 0.0), guideway=(0.0, 0.0)):
    """State-space model of the axis, command -> (position, current): `linear_loop.linear_matrices`.

    ``actuator``, ``guideway``: (stiffness, damping) of the contacts, in the unit of each as there.
    """
    return control.ss(*linear_matrices(axis, actuator, guideway), 0.0)


def regimes(axis):
    """Linearised axes: list of (name, plant voltage -> (position, current), (stiffness, damping) at the stage).

    Pre-sliding: all blocks stick. Sliding: at each of `SLIDING_SPEEDS`.
    """
    return [
        (name, linear_axis(axis, actuator, guideway), slopes)
        for name, actuator, guideway, slopes in regime_slopes(axis)
    ]


def pid_transfer(gains, period, delay=0):
    """Discrete transfer function error [m] -> voltage [V] of the PID law, with ``delay`` further periods.

    ``gains``: mapping with the names of `pid.GAINS`.
    """
    kp, share = gains["proportional"], period / (period + gains["filter_time"])
    z = control.tf([1, 0], [1], period)
    integral = kp * period / gains["integral_time"] * z / (z - 1)
    derivative = kp * gains["derivative_time"] / period * share * (z - 1) / (z - (1 - share))
    return (kp + integral + derivative) * control.tf([1], [1] + [0] * delay, period)


def loop_of(plant, controller, period):
    """Open loop [1] (discrete state space): ``plant`` (continuous, first output the position) sampled with hold."""
    return control.ss(controller) * control.sample_system(plant[0, 0], period, "zoh")


def observer_loop(axis, plant, stiffness, damping, parameters):
    """Open loop of the observer law, cut at the amplifier, in a regime of given friction slopes at the stage.

    ``plant``: voltage -> (position, current); ``stiffness`` [N/m] and ``damping`` [N s/m]: what the observer's
    friction law adds in this regime; ``parameters``: record of `controller.controller_parameters`.
    """
    period = float(parameters["period"])
    sampled = control.sample_system(plant, period, "zoh")
    big, inputs, row = cut_loop(
        sampled.A, sampled.B, sampled.C, observer_step(parameters, stiffness, damping), OBSERVER_STATES
    )
    return control.ss(big, inputs, -row, 0.0, period)


def frequency_response(loop, omega, period):
    """Response of a discrete state space with one input and output at ``omega`` [rad/s], shape (n,); all frequencies in
    one solve."""
    shifted = np.exp(1j * omega * period)[:, None, None] * np.eye(len(loop.A)) - loop.A
    return (loop.C @ np.linalg.solve(shifted, loop.B[None].astype(complex)))[:, 0, 0] + loop.D[0, 0]


def loop_margins(loop, period, regime=""):
    """`Margins` of an open loop (discrete state space)."""
    stable = bool(np.all(np.abs(control.feedback(loop, 1).poles()) < 1 - 1e-9))
    omega = np.geomspace(0.1, math.pi / period, 6000)[:-1]
    response = frequency_response(loop, omega, period)
    (left, cross), (gains, _) = crossings(omega, response)
    return Margins(
        regime, stable, float(left.min(initial=math.inf)), float(gains[gains > 0.0].min(initial=math.inf)),
        float((-gains[gains < 0.0]).min(initial=math.inf)), float(cross.max(initial=0.0) / 2 / math.pi),
        float(np.max(1 / np.abs(1 + response))),
    )


def crossings(omega, response):
    """((phase margins [degrees], where), (gain margins [dB], where)) at every crossing of unity and of -180 degrees,
    one array each; a gain margin below 0 is how far the gains may fall.

    ``response``: of a loop [1] at ``omega`` [rad/s], shape (n,), interpolated on logarithmic axes: beside a resonance
    the phase turns by 2 degrees from one of 6000 points to the next.
    """
    size, turned, places = np.log(np.abs(response)), np.unwrap(np.angle(response)), np.log(omega)
    beside = np.mod(turned, 2.0 * math.pi) - math.pi

    def at(k, of, wanted):
        share = of[k] / (of[k] - of[k + 1])
        return tuple(each[k] + share * (each[k + 1] - each[k]) for each in (wanted, places))

    phase, cross = at(np.flatnonzero(np.diff(np.sign(size))), size, turned)
    turn = np.flatnonzero((np.diff(np.sign(beside)) != 0) & (np.abs(np.diff(beside)) < math.pi))
    gain, turns = at(turn, beside, size)
    left = np.degrees(np.abs(np.mod(phase, 2.0 * math.pi) - math.pi))
    return (left, np.exp(cross)), (-20.0 / math.log(10.0) * gain, np.exp(turns))


def pid_margins(axis, gains, delay=0):
    """`Margins` of PID gains on the encoder in every regime of an axis (list)."""
    period = axis.value("period")
    transfer = pid_transfer(gains, period, delay)
    return [loop_margins(loop_of(plant, transfer, period), period, name) for name, plant, _ in regimes(axis)]


def quadratic_margins(axis, parameters):
    """`Margins` of the linear quadratic law (its parameter record), cut at the amplifier, in every regime (list)."""
    period, found = float(parameters["period"]), []
    for name, plant, _ in regimes(axis):
        sampled = control.sample_system(plant, period, "zoh")
        big, inputs, row = cut_loop(sampled.A, sampled.B, sampled.C, quadratic_step(parameters), QUADRATIC_STATES)
        found.append(loop_margins(control.ss(big, inputs, -row, 0.0, period), period, name))
    return found


def controller_margins(axis, parameters):
    """`Margins` of a controller (its parameter record) in every regime; None for a law without linear form."""
    loop = laws.LAWS[laws.NAMES[parameters["kind"]]].loop
    if not loop:
        return None
    if loop != "observer" or not float(parameters["feedforward"]["force_per_ampere"]) > 0.0:
        return pid_margins(axis, {name: float(parameters["pid"][name]) for name in parameters["pid"].dtype.names})
    period = float(parameters["period"])
    return [
        loop_margins(observer_loop(axis, plant, stiffness, damping, parameters), period, name)
        for name, plant, (stiffness, damping) in regimes(axis)
    ]


def margin_rows(margins):
    """Rows of text for a table: regime, stable, phase, gain up and down, crossover, peak sensitivity."""
    def formatted(value, pattern):
        return "any" if math.isinf(value) else format(value, pattern)

    return [
        [m.regime, "yes" if m.stable else "no", formatted(m.phase_deg, ".0f"), formatted(m.gain_db, ".1f"),
         formatted(m.gain_down_db, ".1f"), f"{m.crossover_hz:.0f}", f"{m.sensitivity:.1f}"]
        for m in margins
    ]


MARGIN_HEADS = [
    "regime",
    "stable",
    "phase (deg)",
    "gain up (dB)",
    "gain down (dB)",
    "crossover (Hz)",
    "peak sensitivity",
]
