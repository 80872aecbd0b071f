"""Effects of motor, drive train and forces on the stage, in the torque balance."""

import numpy as np

from microstage_ros.diagnosis.catalogue.form import Form, one, wave
from microstage_ros.diagnosis.preprocessing.motion import smooth_motion
from microstage_ros.diagnosis.preprocessing.preparation import TRAVEL_NOISE
from microstage_ros.signals.rows import of_row_before

GRAVITY = 9.80665
RIPPLE_CYCLES = tuple(range(1, 13))  # per turn of the motor
# of a force, by which the torque balance may differ from what the rattle tells; derived: midway between all and none
SAME_PULL = 0.5
SIGMAS = 3.0            # derived: a chance of 1.3·10⁻³
#: The stage's inertia alone [N m]: beside a payload, by which mass inertia and load differ.
INERTIA = "generic:inertia"


def gravity_tilt(channel, frame):
    """(r/N) m g sin α [N m], at rest as in motion; β = sin α."""
    return np.full((len(channel.residual), 1), frame.drive.lever * frame.drive.mass * GRAVITY)


def cable_spring(channel, frame):
    """(r/N) c (x − x₀) [N m]: columns x and 1; β = (c, −c x₀)."""
    return frame.drive.lever * np.stack([channel.place, np.ones(len(channel.place))], axis=1)


def cable_windup(channel, frame):
    """The same force on its way through the drive train: the stage hangs back by c x / K_c [m]."""
    return -channel.position[:, None] / frame.drive.stiffness


def payload_change(channel, frame):
    """Guideway friction and inertia grow with the load; β = added mass over m."""
    return (channel.guideway + channel.inertial)[:, None]


def inertia_alone(channel, frame):
    """The inertia of a load without its weight on the guideways; β = added mass over m."""
    return channel.inertial[:, None]


def torque_ripple(numbers):
    """Motor torque −Σ (s sin + c cos)(n · θ) over the cycles n per turn, θ = x N / r; ``numbers``: the n [1]."""
    def columns(channel, frame):
        angle = channel.prepared.position / frame.drive.lever
        return -channel.mean(np.stack([f(n * angle) for n in numbers for f in (np.sin, np.cos)], axis=1))
    return columns


def shaken_by_ripple(numbers):
    """The stage's motion [m] by what a ripple, as in `torque_ripple`, shakes the motor: the current, by which the
    motor's fast motion is known, does not hold its torque. ``numbers``: cycles per turn n [1]."""
    def columns(channel, frame):
        p, drive = channel.prepared, frame.drive
        angle, still = p.position / drive.lever, np.zeros(len(p.time))
        unseen = []
        for n in numbers:
            for wave_of in (np.sin, np.cos):
                torque = wave_of(n * angle)
                current = 0.5 * (torque + of_row_before(torque)) / drive.torque_constant     # over the period before
                unseen.append(smooth_motion(still, current, drive, p.period, TRAVEL_NOISE).position)
        return np.stack([channel.passed_on(travel) for travel in unseen], axis=1)
    return columns


def _cable_sizes(beta, covariance, frame):
    stiffness, force = map(float, beta)
    sigma = np.sqrt(np.diag(covariance))
    anchor = -force / stiffness
    slope = np.array([force / stiffness**2, -1.0 / stiffness])
    return ({"stiffness_N_m": (stiffness, float(sigma[0]), "N/m"),
             "anchor_m": (anchor, float(np.sqrt(slope @ covariance @ slope)), "m")},
            {"stiffness_N_m": stiffness, "anchor_m": float(np.clip(anchor, -10.0, 10.0))})


def _ripple_sizes(numbers):
    def sizes(beta, covariance, frame):
        terms = []
        for place, n in enumerate(numbers):
            part = slice(2 * place, 2 * place + 2)
            terms.append((float(n), *wave(beta[part], covariance[part, part])))
        terms.sort(key=lambda term: -term[1])
        parameters = {}
        for place, (n, amplitude, sigma, phase, sigma_phase) in enumerate(terms, 1):
            end = f"_{place}" if place > 1 else ""
            parameters |= {f"amplitude{end}_Nm": (amplitude, sigma, "N m"), f"cycles_per_turn{end}": (n, 0.0, "1"),
                           f"phase{end}_rad": (phase, sigma_phase, "rad")}
        effect = {name: [term[column] for term in terms] if len(terms) > 1 else terms[0][column]
                  for name, column in (("amplitude_Nm", 1), ("cycles_per_turn", 0), ("phase_rad", 3))}
        return parameters, effect
    return sizes


def _mass_sizes(beta, covariance, frame):
    mass = float(beta[0] * frame.drive.mass)
    return ({"mass_kg": (mass, float(np.sqrt(covariance[0, 0]) * frame.drive.mass), "kg")}, {"mass_kg": mass})


def inertia_form():
    """`Form` of the stage's inertia alone, which no cause is."""
    return Form(INERTIA, "torque", "", inertia_alone)


def ripple_form(numbers):
    """`Form` of a ripple with these ``numbers`` of cycles per turn of the motor [1] together."""
    return Form(
        "torque_ripple", "torque", ",".join(f"{n:g}" for n in numbers), torque_ripple(numbers), _ripple_sizes(numbers)
    )


def shaking_form(numbers):
    """`Form` of what such a ripple (``numbers`` of cycles per turn [1]) does to the stage, whose sizes the torque
    tells."""
    return Form("torque_ripple", "resonance", ",".join(f"{n:g}" for n in numbers), shaken_by_ripple(numbers),
                lambda beta, covariance, frame: ({}, {}))


def _pulls_back(beta):
    """A cable pulls back: one that pushed on would be no spring."""
    return beta[0] > 0.0


def _is_pull(beta, frame):
    """Whether a tilt pulls on the stage as much as a rattle in a gap tells, if one does."""
    if _no_rattle(frame):
        return True
    weight = frame.drive.mass * GRAVITY * beta[0]
    return _holds_pull((weight, weight), frame.drive.pull)


def _is_pull_somewhere(beta, frame):
    """Whether a cable pulls so somewhere on the stroke."""
    ends = () if _no_rattle(frame) else (frame.low, frame.high)
    return not ends or _holds_pull([beta[0] * x + beta[1] for x in ends], frame.drive.pull)


def _no_rattle(frame):
    return frame is None or frame.drive.pull is None


def _holds_pull(forces, pull):
    """Whether ``forces`` [N] at the two ends of the stroke allow a ``pull`` (value, standard error) [N]."""
    value, stderr = pull
    loose = SAME_PULL * max(map(abs, forces)) + SIGMAS * stderr
    return bool(min(forces) - loose < value < max(forces) + loose)


FORMS = (
    Form("gravity_tilt", "torque", "", gravity_tilt,
         one("angle_rad", "rad", value=lambda b: np.arcsin(np.clip(b, -1, 1))), beyond=_is_pull),
    Form("cable_spring", "torque", "", cable_spring, _cable_sizes, _pulls_back, beyond=_is_pull_somewhere),
    Form("cable_spring", "windup", "", cable_windup, one("stiffness_N_m", "N/m"), _pulls_back),
    Form("payload_change", "torque", "", payload_change, _mass_sizes),
    *(ripple_form((n,)) for n in RIPPLE_CYCLES),
)
