"""Stability margins of a tuning on the linearised axis, in pre-sliding and in sliding.

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

from microstage_ros.control.feedforward.axis import packed_contact
from microstage_ros.control.laws import registry as laws
from microstage_ros.control.observer import friction_level, motion_filter
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.friction.curve import stribeck_slope
from microstage_ros.solver.plant import NoiseSpec, make_plant

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
    return viscous + stribeck_slope(speed, static, coulomb, velocity, exponent)


def stuck_stiffness(packed):
    """Sum of the block stiffnesses of a packed contact."""
    count = int(packed[10])
    return float(np.sum(packed[11 : 11 + count]))


def linear_axis(axis, actuator=(0.0, 0.0), guideway=(0.0, 0.0)):
    """State-space model of the axis, command -> (position, current), from the numbers of the compiled step.

    ``actuator``, ``guideway``: (stiffness, damping) of the contacts, at the screw angle (torque at the motor
    shaft) and at the stage. States: current (of drives that have one), motor speed and angle (of transmissions that
    are not rigid), stage speed, position. A drive without a current has the position as its only output.
    """
    plant = make_plant(axis.with_effects({}), NoiseSpec.none())
    kind = actuator_of(axis)
    pull, spring, drag = kind.linearised(plant)
    q, gear, m = (float(plant[name]) for name in ("ratio", "gear", "mass"))
    inertia, stiffness, damping = (float(plant[name]) for name in ("inertia", "stiffness", "damping"))
    k_motor = actuator[0] / gear + spring
    d_motor = actuator[1] / gear + drag + float(plant["motor_damping"])
    k_stage, d_stage = guideway[0] + float(plant["flexure"]), guideway[1] + float(plant["flexure_damping"])
    direct, torque = float(plant["direct"]) * float(plant["gain"]) + pull, float(plant["torque_constant"])
    if plant["rigid"]:
        mass = m + inertia / q**2
        a = np.array([[0.0, torque / q / mass, 0.0], [0.0, -(d_motor / q**2 + d_stage) / mass, -(k_motor / q**2 + k_stage) / mass],
                      [0.0, 1.0, 0.0]])
        a[0, 1], a[1, 0] = -float(plant["back_emf"]) / q, a[0, 1]
        b = np.array([[0.0], [direct / q / mass], [0.0]])
    else:
        a = np.array([
            [0.0, -float(plant["back_emf"]), 0.0, 0.0, 0.0],
            [torque / inertia, -(d_motor + q * q * damping) / inertia, -(k_motor + q * q * stiffness) / inertia,
             q * damping / inertia, q * stiffness / inertia],
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [0.0, q * damping / m, q * stiffness / m, -(damping + d_stage) / m, -(stiffness + k_stage) / m],
            [0.0, 0.0, 0.0, 1.0, 0.0],
        ])
        b = np.array([[0.0], [direct / inertia], [0.0], [0.0], [0.0]])
    c = np.zeros((2, len(a)))
    c[0, -1] = c[1, 0] = 1.0
    inductance, entry = float(plant["inductance"]), float(plant["electrical_input"]) * float(plant["gain"])
    if not entry:                      # no state of the drive's own
        return control.ss(a[1:, 1:], b[1:], c[:1, 1:], 0.0)
    a[0] /= inductance
    a[0, 0], b[0, 0] = -float(plant["resistance"]) / inductance, entry / inductance
    return control.ss(a, b, c if kind.measures_current else c[:1], 0.0)


def regimes(axis):
    """Linearised axes: list of (name, plant voltage -> (position, current), (stiffness, damping) at the stage).

    Pre-sliding: all blocks stick. Sliding: at each of `SLIDING_SPEEDS`.
    """
    contacts = {name: packed_contact(axis, name) for name in ("actuator", "guideway")}
    screw = axis.value("transmission.pitch") / (2 * math.pi)
    per_torque = axis.value("transmission.gear_ratio") / screw

    def contact(name, speed):
        packed = contacts[name]
        if packed is None:
            return (0.0, 0.0)
        if speed is None:
            return (stuck_stiffness(packed), float(packed[4]))
        return (0.0, sliding_slope(packed, speed / (screw if name == "actuator" else 1.0)))

    found = []
    for speed in (None, *SLIDING_SPEEDS):
        actuator, guideway = contact("actuator", speed), contact("guideway", speed)
        slopes = tuple(per_torque / screw * a + g for a, g in zip(actuator, guideway))
        name = "pre-sliding" if speed is None else f"sliding, {speed * 1e6:g} um/s"
        found.append((name, linear_axis(axis, actuator, guideway), slopes))
    return found


def pid_transfer(gains, period, delay=0):
    """Discrete transfer function error -> voltage of the PID law, with ``delay`` further periods.

    ``gains``: mapping with the names of `pid.GAINS`.
    """
    kp, share = gains["proportional"], period / (period + gains["filter_time"])
    z = control.tf([1, 0], [1], period)
    integral = kp * period / gains["integral_time"] * z / (z - 1)
    derivative = kp * gains["derivative_time"] / period * share * (z - 1) / (z - (1 - share))
    return (kp + integral + derivative) * control.tf([1], [1] + [0] * delay, period)


def loop_of(plant, controller, period):
    """Open loop (discrete state space): ``plant`` (continuous, first output the position) sampled with hold."""
    return control.ss(controller) * control.sample_system(plant[0, 0], period, "zoh")


def observer_loop(axis, plant, stiffness, damping, parameters):
    """Open loop of the observer law, cut at the amplifier, in a regime of given friction slopes at the stage.

    ``plant``: voltage -> (position, current); ``stiffness`` [N/m] and ``damping`` [N s/m]: what the observer's
    friction law adds in this regime; ``parameters``: record of `controller.controller_parameters`.
    """
    period = float(parameters["period"])
    step = _observer_step(parameters, stiffness, damping)
    size = 8  # x, v, d, current of the period before, integral, force of the stuck blocks, the stage's swing and its rate
    # the law is linear here: its matrices are its answers to unit vectors of (state, position, current, voltage)
    answers = np.array([step(unit) for unit in np.eye(size + 3)]).T
    sampled = control.sample_system(plant, period, "zoh")
    ap, bp, cp = sampled.A, sampled.B, sampled.C
    a, b = answers[:size, :size], answers[:size, size:]
    c, d = answers[size:, :size], answers[size:, size:]
    # states: plant, law, and the law's voltage of the period before
    n = len(ap)
    big = np.zeros((n + size + 1, n + size + 1))
    big[:n, :n] = ap
    big[n : n + size, :n], big[n : n + size, n : n + size], big[n : n + size, -1:] = b[:, :2] @ cp, a, b[:, 2:]
    row = np.hstack([d[:, :2] @ cp, c, d[:, 2:]])
    big[-1:] = row
    inputs = np.vstack([bp, np.zeros((size + 1, 1))])
    return control.ss(big, inputs, -row, 0.0, period)


def _observer_step(parameters, stiffness, damping):
    """One linear period of observer and PID: (state, position, current, last voltage) -> (state, voltage)."""
    o, m, period = parameters["observer"], parameters["feedforward"], float(parameters["period"])
    pid = parameters["pid"]
    kp, ki = float(pid["proportional"]), float(pid["proportional"] / pid["integral_time"])
    kd = float(pid["proportional"] * pid["derivative_time"])
    rest = float(o["transient"])
    part = float(m["settling"]) / period - rest / (1.0 - rest)
    mass, emf = float(m["moving_mass"]), float(m["volts_per_velocity"])
    gain = motion_filter.steady_gain(o, m, period, motion_filter.STIFFNESS_SHARE * stiffness / mass, damping / mass)
    swings, share, time = np.array(o["swing_matrix"]), float(o["swing_share"]), float(o["swing_time"])
    absorbed = min(period / friction_level.ABSORB_TIME, 1.0) if stiffness > 0.0 else 0.0

    def step(values):
        x, v, d, before, integral, spring, swing, rate, position, current, voltage = values
        start = v
        force = float(m["force_per_ampere"]) * (current + part * (before - current))
        pull = period * ((force - spring - damping * v) / mass - d)
        mean, v = v + 0.5 * pull, v + pull
        x = x + period * mean
        # blocks follow the predicted motion, not its corrections
        spring = (spring if stiffness > 0.0 else 0.0) + stiffness * period * mean
        v = v - 0.5 * period * (stiffness * period * mean + damping * 0.5 * pull) / mass
        settled = (current - rest * before) / (1.0 - rest)
        swing, rate = swings @ [swing, rate, (v - start) / period]
        innovation = np.array([position - swing - x, (voltage - float(m["resistance"]) * settled) / emf - v])
        x, v, d = np.array([x, v, d]) + gain @ innovation
        spring, d = spring + absorbed * mass * d, (1.0 - absorbed) * d
        error = x + share * swing + time * rate
        integral = integral - ki * period * error
        return np.array([x, v, d, current, integral, spring, swing, rate, -kp * error - kd * v + integral])

    return step


def frequency_response(loop, omega, period):
    """Response of a discrete state space with one input and output at ``omega`` [rad/s], shape (n,); all frequencies in one solve."""
    shifted = np.exp(1j * omega * period)[:, None, None] * np.eye(len(loop.A)) - loop.A
    return (loop.C @ np.linalg.solve(shifted, loop.B[None].astype(complex)))[:, 0, 0] + loop.D[0, 0]


def loop_margins(loop, period, regime=""):
    """`Margins` of an open loop (discrete state space)."""
    stable = bool(np.all(np.abs(control.feedback(loop, 1).poles()) < 1 - 1e-9))
    omega = np.geomspace(0.1, math.pi / period, 6000)[:-1]
    response = frequency_response(loop, omega, period)
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
    """`Margins` of PID gains on the encoder in every regime of an axis (list)."""
    period = axis.value("period")
    transfer = pid_transfer(gains, period, delay)
    return [loop_margins(loop_of(plant, transfer, period), period, name) for name, plant, _ in regimes(axis)]


def controller_margins(axis, parameters):
    """`Margins` of a controller (its parameter record) in every regime; None for a law without linear form."""
    if parameters["kind"] in (laws.NONE, laws.NCTF, laws.CASCADE):
        return None
    if parameters["kind"] != laws.SELF_TUNING_OBSERVER or not float(parameters["feedforward"]["force_per_ampere"]) > 0.0:
        return pid_margins(axis, {name: float(parameters["pid"][name]) for name in parameters["pid"].dtype.names})
    period = float(parameters["period"])
    return [
        loop_margins(observer_loop(axis, plant, *slopes, parameters), period, name)
        for name, plant, slopes in regimes(axis)
    ]


def margin_rows(margins):
    """Rows of text for a table: regime, stable, phase, gain up and down, crossover, peak sensitivity."""
    def told(value, pattern):
        return "any" if math.isinf(value) else format(value, pattern)

    return [
        [m.regime, "yes" if m.stable else "no", told(m.phase_deg, ".0f"), told(m.gain_db, ".1f"),
         told(m.gain_down_db, ".1f"), f"{m.crossover_hz:.0f}", f"{m.sensitivity:.1f}"]
        for m in margins
    ]


MARGIN_HEADS = ["regime", "stable", "phase (deg)", "gain up (dB)", "gain down (dB)", "crossover (Hz)", "peak sensitivity"]
