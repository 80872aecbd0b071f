"""Stability margins of a PID tuning on the linearised axis, in pre-sliding and in sliding.

Linearised, every sticking block of a contact is a spring and every slipping one nothing; the sliding curve
has the slope dM_f/dw = sigma - (F_s - F_C) (delta/V_S) (w/V_S)^(delta-1) exp(-(w/V_S)^delta), which below
V_S is negative. With motor, rotor, drive train and stage as in the model, voltage held over the period, and
the discrete controller, the loop is cut at the voltage. Gain margin: factor on all gains until
instability (upwards, and downwards where the loop is only conditionally stable). Phase margin: at the gain crossovers.
Paper, section 5.1: phase margin at least 30 degrees, gain margin about 40 dB.
"""

import math
from typing import NamedTuple

import control
import numpy as np

from microstage_ros.control.feedforward import packed_contact

#: Speeds [m/s] at which sliding is linearised: creeping (steepest fall of the Stribeck curve) and moving.
SLIDING_SPEEDS = (1e-6, 1e-3)


class Margins(NamedTuple):
    """Margins of one loop in one regime."""

    regime: str
    stable: bool
    phase_deg: float
    gain_db: float  # upward gain margin
    gain_down_db: float  # how far the gains may fall (infinite if they may fall to zero)
    crossover_hz: float  # highest gain crossover
    sensitivity: float  # largest |1/(1+L)|


def sliding_slope(packed, speed):
    """dF/dw of a packed contact's sliding curve at ``speed`` >= 0, viscous part included."""
    static, coulomb, velocity, exponent, viscous = packed[:5]
    ratio = max(speed / velocity, 1e-9)
    return viscous - (static - coulomb) * exponent / velocity * ratio ** (exponent - 1) * math.exp(-(ratio**exponent))


def stuck_stiffness(packed):
    """Sum of the block stiffnesses of a packed contact."""
    count = int(packed[10])
    return float(np.sum(packed[11 : 11 + count]))


def linear_axis(axis, actuator=(0.0, 0.0), guideway=(0.0, 0.0)):
    """State-space model voltage -> position of the axis.

    ``actuator``, ``guideway``: (stiffness, damping) of the contacts, at the screw angle (torque at the motor
    shaft) and at the stage. States: current, motor speed, motor angle, stage speed, position; a force-driven
    axis has the last two.
    """
    m = axis.value("stage.mass")
    if axis.choices["drive.type"] == "force":
        a = np.array([[-guideway[1] / m, -guideway[0] / m], [1.0, 0.0]])
        return control.ss(a, np.array([[axis.value("drive.gain") / m], [0.0]]), np.array([[0.0, 1.0]]), 0.0)
    gear = axis.value("transmission.gear_ratio")
    q = axis.value("transmission.pitch") / (2 * math.pi) / gear
    resistance, inductance = axis.value("drive.resistance"), axis.value("drive.inductance")
    emf, torque, inertia = (axis.value(f"drive.{key}") for key in ("back_emf", "torque_constant", "rotor_inertia"))
    stiffness, damping = axis.value("transmission.stiffness"), axis.value("transmission.damping")
    a = np.array([
        [-resistance / inductance, -emf / inductance, 0.0, 0.0, 0.0],
        [torque / inertia, -(actuator[1] / gear + q * q * damping) / inertia,
         -(actuator[0] / gear + q * q * stiffness) / inertia, q * damping / inertia, q * stiffness / inertia],
        [0.0, 1.0, 0.0, 0.0, 0.0],
        [0.0, q * damping / m, q * stiffness / m, -(damping + guideway[1]) / m, -(stiffness + guideway[0]) / m],
        [0.0, 0.0, 0.0, 1.0, 0.0],
    ])
    b = np.array([[1.0 / inductance], [0.0], [0.0], [0.0], [0.0]])
    return control.ss(a, b, np.array([[0.0, 0.0, 0.0, 0.0, 1.0]]), 0.0)


def regimes(axis):
    """Linearised axes by regime: pre-sliding (all blocks stick), and sliding at `SLIDING_SPEEDS`."""
    contacts = {name: packed_contact(axis, name) for name in ("actuator", "guideway")}
    screw = axis.value("transmission.pitch") / (2 * math.pi)

    def contact(name, speed):
        packed = contacts[name]
        if packed is None:
            return (0.0, 0.0)
        if speed is None:
            return (stuck_stiffness(packed), packed[4])
        return (0.0, sliding_slope(packed, speed / (screw if name == "actuator" else 1.0)))

    axes = {"pre-sliding": linear_axis(axis, contact("actuator", None), contact("guideway", None))}
    for speed in SLIDING_SPEEDS:
        axes[f"sliding {speed:g} m/s"] = linear_axis(axis, contact("actuator", speed), contact("guideway", speed))
    return axes


def pid_transfer(gains, period, delay=0):
    """Discrete transfer function error -> voltage of the PID law, with ``delay`` further periods.

    ``gains``: mapping with the names of `pid.GAINS`.
    """
    kp, share = gains["proportional"], period / (period + gains["filter_time"])
    z = control.tf([1, 0], [1], period)
    integral = kp * period / gains["integral_time"] * z / (z - 1)
    derivative = kp * gains["derivative_time"] / period * share * (z - 1) / (z - (1 - share))
    return (kp + integral + derivative) * control.tf([1], [1] + [0] * delay, period)


def loop_margins(plant, controller, period, regime=""):
    """`Margins` of the loop ``controller`` (discrete) x ``plant`` (continuous, sampled with zero-order hold)."""
    loop = control.ss(controller) * control.sample_system(plant, period, "zoh")
    stable = bool(np.all(np.abs(control.feedback(loop, 1).poles()) < 1 - 1e-9))
    omega = np.geomspace(0.1, math.pi / period, 20000)[:-1]
    response = control.frequency_response(loop, omega).frdata[0, 0]
    gain, phase = np.abs(response), np.unwrap(np.angle(response))
    cross = np.flatnonzero(np.diff(np.sign(gain - 1)))
    turn = np.flatnonzero((np.diff(np.sign(response.imag)) != 0) & (response.real[:-1] < 0))
    distances = np.abs((np.degrees(phase[cross]) % 360) - 180)
    up = [-20 * math.log10(gain[k]) for k in turn if gain[k] < 1]
    down = [20 * math.log10(gain[k]) for k in turn if gain[k] > 1]
    return Margins(
        regime, stable, float(distances.min()) if len(cross) else math.inf,
        min(up, default=math.inf), min(down, default=math.inf),
        float(omega[cross[-1]] / 2 / math.pi) if len(cross) else 0.0, float(np.max(1 / np.abs(1 + response))),
    )


def pid_margins(axis, gains, delay=0):
    """`Margins` of PID gains in every regime of an axis (list)."""
    period = axis.value("period")
    transfer = pid_transfer(gains, period, delay)
    return [loop_margins(plant, transfer, period, name) for name, plant in regimes(axis).items()]
