"""The axis and the laws as matrices, without the library for transfer functions, which takes a second to load.

Linearised, every sticking block of a contact is a spring and every slipping one nothing, see `margins`.
"""


import numpy as np

from microstage_ros.control.feedforward.axis import packed_contact
from microstage_ros.control.observer import friction_level, motion_filter
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.friction.curve import stribeck_slope
from microstage_ros.model.transmission import screw_ratio
from microstage_ros.solver.plant import NoiseSpec, make_plant

#: Speeds [m/s] at which sliding is linearised: creeping (steepest fall of the Stribeck curve) and moving.
SLIDING_SPEEDS = (1e-6, 1e-3)
# x, v, d, current of the period before, integral, force of the stuck blocks, the stage's swing and its rate,
# acceleration of the period before
OBSERVER_STATES = 9
QUADRATIC_STATES = 4
PID_STATES = 3  # integral, filtered velocity, position of the period before


def sliding_slope(packed, speed):
    """dF/dw of a ``packed`` contact's (p,) sliding curve at ``speed`` >= 0 [q/s], viscous part included [F s/q]."""
    static, coulomb, velocity, exponent, viscous = packed[:5]
    return viscous + stribeck_slope(speed, static, coulomb, velocity, exponent)


def stuck_stiffness(packed):
    """Sum of the block stiffnesses of a ``packed`` contact (p,) [F/q]."""
    count = int(packed[10])
    return float(np.sum(packed[11 : 11 + count]))


def linear_matrices(axis, actuator=(0.0, 0.0), guideway=(0.0, 0.0)):
    """Matrices (A, B, C) of the axis, command -> (position, current), from the numbers of the compiled step.

    ``actuator``, ``guideway``: (stiffness, damping) of the contacts, at the screw angle (torque at the motor
    shaft) [N m/rad, N m s/rad] and at the stage [N/m, N s/m]. States: current (of drives that have one), motor speed
    and angle (of transmissions that are not rigid), stage speed, position. A drive without a current has the position
    as its only output.
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
        a = np.array(
            [
                [0.0, torque / q / mass, 0.0],
                [0.0, -(d_motor / q**2 + d_stage) / mass, -(k_motor / q**2 + k_stage) / mass],
                [0.0, 1.0, 0.0],
            ]
        )
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
        return a[1:, 1:], b[1:], c[:1, 1:]
    a[0] /= inductance
    a[0, 0], b[0, 0] = -float(plant["resistance"]) / inductance, entry / inductance
    return a, b, c if kind.measures_current else c[:1]


def regime_slopes(axis):
    """Where the axis is linearised: list of (name, slopes of the actuator, of the guideway, of both at the stage).

    Slopes are (stiffness, damping). Pre-sliding: all blocks stick. Sliding: at each of `SLIDING_SPEEDS`.
    """
    contacts = {name: packed_contact(axis, name) for name in ("actuator", "guideway")}
    screw = screw_ratio(axis)
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
        found.append((name, actuator, guideway, slopes))
    return found


def cut_loop(ap, bp, cp, step, size):
    """Loop of a sampled plant (ap, bp, cp) and a law, cut at the command: matrices (A, B, row that gives the command).

    ``ap`` (n, n), ``bp`` (n, 1), ``cp`` (readings, n): over a period, SI; ``size`` [1].
    ``step`` : one linear period of the law, (state, readings, last command) -> (state, command), of ``size`` states and
    as many readings as ``cp`` has rows. States of the result: plant, law, and the law's command of the period before.
    """
    reads = len(cp)
    # the law is linear here: its matrices are its answers to unit vectors of (state, readings, last command)
    answers = np.array([step(unit) for unit in np.eye(size + reads + 1)]).T
    a, b = answers[:size, :size], answers[:size, size:]
    c, d = answers[size:, :size], answers[size:, size:]
    n = len(ap)
    big = np.zeros((n + size + 1, n + size + 1))
    big[:n, :n] = ap
    big[n : n + size, :n], big[n : n + size, n : n + size], big[n : n + size, -1:] = b[:, :reads] @ cp, a, b[:, reads:]
    row = np.hstack([d[:, :reads] @ cp, c, d[:, reads:]])
    big[-1:] = row
    return big, np.vstack([bp, np.zeros((size + 1, 1))]), row


def pid_step(gains, period):
    """One linear ``period`` [s] of the PID law on the encoder, for `cut_loop`: function (5,) -> (4,).

    ``gains``: mapping with the names of `pid.GAINS`, SI.
    """
    kp, ki, kd = (
        gains["proportional"],
        gains["proportional"] / gains["integral_time"],
        gains["proportional"] * gains["derivative_time"],
    )
    share = period / (period + gains["filter_time"])

    def step(values):
        integral, velocity, before, position, _ = values
        velocity = share * (position - before) / period + (1.0 - share) * velocity
        integral = integral - ki * period * position
        return np.array([integral, velocity, position, integral - kp * position - kd * velocity])

    return step


def observer_step(parameters, stiffness, damping):
    """One linear period of observer and PID: (state, position, current, last voltage) -> (state, voltage), SI.

    ``stiffness`` [N/m] and ``damping`` [N s/m]: of the friction at the stage, as the observer's laws have it.
    """
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
    per_ampere, resistance = float(m["force_per_ampere"]), float(m["resistance"])
    fall = per_ampere * emf / resistance  # within a period the current falls as the back-EMF rises
    parts = motion_filter.parts_of(period)
    h = period / parts

    def step(values):
        x, v, d, before, integral, spring, swing, rate, acceleration, position, current, voltage = values
        start = v
        force = per_ampere * (current + part * (before - current))
        spring = spring if stiffness > 0.0 else 0.0
        for k in range(parts):
            push = force + fall * acceleration * h * (parts - k - 0.5)
            pull = h * ((push - spring - damping * v) / mass - d)
            mean = v + 0.5 * pull
            x = x + h * mean
            # blocks follow the predicted motion, not its corrections
            spring = spring + stiffness * h * mean
            change = pull - 0.5 * h * (stiffness * h * mean + damping * 0.5 * pull) / mass
            v, acceleration = v + change, change / h
        acceleration = (v - start) / period
        swing, rate = swings @ [swing, rate, acceleration]
        settled = (current - rest * before) / (1.0 - rest)
        innovation = np.array([position - swing - x, (voltage - resistance * settled) / emf - v])
        x, v, d = np.array([x, v, d]) + gain @ innovation
        spring, d = spring + absorbed * mass * d, (1.0 - absorbed) * d
        error = x + share * swing + time * rate
        integral = integral - ki * period * error
        voltage = -kp * error - kd * v + integral
        return np.array([x, v, d, current, integral, spring, swing, rate, acceleration, voltage])

    return step


def quadratic_step(parameters):
    """One linear period of the linear quadratic law: (x, v, d, current, position, current, last voltage) -> (state,
    voltage), function (7,) -> (5,), SI."""
    own, model, period = parameters["quadratic"], parameters["feedforward"], float(parameters["period"])
    gain, rest = np.array(own["gain"]), float(own["transient"])
    inertia, emf, rate = (float(own[name]) for name in ("inertia", "emf", "regulator_rate"))
    push = float(model["force_per_ampere"] / model["moving_mass"])

    def step(values):
        x, v, d, before, position, current, voltage = values
        v = v + period * (0.5 * push * (current + before) - d)
        x = x + period * v
        settled = (current - rest * before) / (1.0 - rest)
        innovation = np.array([position - x, (voltage - float(model["resistance"]) * settled) / emf - v])
        x, v, d = np.array([x, v, d]) + gain @ innovation
        return np.array([x, v, d, current, emf * v - inertia * (rate * (rate * x + np.sqrt(2.0) * v) - d)])

    return step
