"""What the observer law has learned of its axis, with standard uncertainties, in SI units.

Read from the law's memory between two periods; what has not been learned yet is the axis file's number with the
uncertainty that it started with. The models are those of `control.observer`: `inertia`, `wind_up`, `drive_learning`,
`lost_motion`, `friction_level`. Uncertainties of quotients: JCGM 100:2008, 5.1. They are those of the filters: what a
wrong model adds is not in them (docs/evidence/control.md, what is learned of a machine).
"""

import math
from typing import NamedTuple

from microstage_ros.control.observer.wind_up import DAMPING, FRICTION, RESONANCE, SPREADS, VARIES

WORTH_SAYING = 0.1  # of the resonance, by which it is known, and by which it differs from the one said before


class Learned(NamedTuple):
    """One number: ``value`` and ``stderr``, its standard uncertainty, in ``unit``; ``file``: the axis file's."""

    value: float
    stderr: float
    unit: str
    file: float


def learned_numbers(parameters, memory):
    """{name: `Learned`} of the records of a law with an observer; {} of a law without.

    ``parameters``, ``memory`` : records of `controller.Controller`.
    """
    model, s = parameters["feedforward"], memory["observer"]
    if not float(model["force_per_ampere"]) > 0.0:
        return {}
    spread = [math.sqrt(max(float(s["learned_covariance"][k, k]), 0.0)) for k in range(3)]
    mass, resistance, emf = (float(model[name]) for name in ("moving_mass", "resistance", "volts_per_velocity"))
    r, zero, constant = (float(value) for value in s["learned"])
    found = {
        "moving_mass": Learned(
            mass * float(s["balance"][0]), mass * math.sqrt(float(s["balance_covariance"][0, 0])), "kg", mass
        ),
        "resistance": Learned(resistance * r, resistance * spread[0], "ohm", resistance),
        "amplifier_zero": Learned(zero, spread[1], "V", 0.0),
        "volts_per_velocity": Learned(emf * constant, emf * spread[2], "V s/m", emf),
        "friction_level": Learned(float(s["level"]), math.sqrt(float(s["variance"])), "1", 1.0),
        "lost_motion": Learned(
            float(s["gap"]), math.sqrt(float(s["gap_variance"])), "m", float(parameters["observer"]["known_gap"])
        ),
    }
    return found | (_drive_train(model, s) if float(model["compliance"]) > 0.0 else {})


def _drive_train(model, s):
    """Resonance, stiffness, stage's mass and damping from m/K, 1/K and D/K. All but the first are as right as the
    guideway's friction in the file, which varies by `VARIES`."""
    swing, softness = (max(float(s["drive_train"][k]), 1e-3) for k in (RESONANCE, FRICTION))
    spreads = [math.sqrt(max(float(s["drive_train_covariance"][k, k]), 0.0)) for k in range(3)]
    stiffness, mass = 1.0 / float(model["compliance"]), float(model["mass"])
    resonance, damping = math.sqrt(stiffness / mass) / (2.0 * math.pi), float(model["drive_damping"])
    # relative variances of quotients; the covariance of numerator and denominator is left out, and would lower them
    soft = math.hypot(spreads[FRICTION] / softness, VARIES)
    own = 0.5 * spreads[RESONANCE] / swing
    heavy = math.hypot(2.0 * own, soft)
    found = resonance / math.sqrt(swing)
    # D/K, which holds L/R beside it; where nothing is learned yet the file's D is reported
    lossy = float(s["drive_train"][DAMPING]) * damping
    lossy -= stiffness * float(model["settling"]) if spreads[DAMPING] < SPREADS[DAMPING] else 0.0
    uncertain = math.hypot(spreads[DAMPING] * damping, lossy * soft) / softness
    return {
        "resonance": Learned(found, own * found, "Hz", resonance),
        "stiffness": Learned(stiffness / softness, soft * stiffness / softness, "N/m", stiffness),
        "stage_mass": Learned(mass * swing / softness, heavy * mass * swing / softness, "kg", mass),
        "damping": Learned(lossy / softness, uncertain, "N s/m", damping),
    }


def resonance_remark(numbers, said):
    """One sentence on a resonance that is known and is not the one that was ``said`` [Hz], 0 if none was; else "".

    ``numbers`` : {name: `Learned`} of `learned_numbers`, SI.
    """
    found = numbers.get("resonance")
    if found is None or found.stderr > WORTH_SAYING * found.value:
        return ""
    if abs(found.value - (said or found.file)) < WORTH_SAYING * found.value:
        return ""
    return f"the drive train's resonance is {found.value:.0f} ± {found.stderr:.0f} Hz, {found.file:.0f} in the file"
