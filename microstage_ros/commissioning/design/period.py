"""What a control period allows on an axis: how fast a loop may be, how stiff that makes it, what friction leaves then.

Reading, difference and hold cost `rules.SAMPLING_LAG` periods T, so at a frequency f a phase of 360° · 1.5 T f. At
its crossover f_c the loop of a moving mass m lags by 90° beside that. With `PHASE` left, f_c = (90° − 45°)/(360° · 1.5
T) = 1/(12 T). There it is as stiff as m (2π f_c)², and friction F that turns round at once pushes the stage
2 F/(m (2π f_c)²) aside until the integral term carries it. (Franklin, Powell, Workman, Digital Control of Dynamic
Systems, 3rd edition (1998), section 4.3: the phase of a hold.)
"""

import math
from dataclasses import dataclass

from microstage_ros.commissioning.estimation.known import breakaway
from microstage_ros.control.design.rules import SAMPLING_LAG, volts_per_acceleration
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.model.actuators import actuator_of

PHASE = 45.0  # degrees left at the crossover
USUAL = (1e-4, 2.5e-4, 5e-4, 1e-3)  # periods that are set beside the axis's own [s]


@dataclass(frozen=True)
class Allowed:
    """What a period allows.

    Attributes
    ----------
    period : s. crossover : largest, of a loop that keeps `PHASE` [Hz]. stiffness : of the stage then [N/m].
    aside : way that friction pushes the stage aside when it turns round at once [m].
    """

    period: float
    crossover: float
    stiffness: float
    aside: float


def allowed(axis, period):
    """`Allowed` of an axis at a control period [s]."""
    crossover = (90.0 - PHASE) / (360.0 * SAMPLING_LAG * period)
    square = (2.0 * math.pi * crossover) ** 2
    inertia = volts_per_acceleration(controller_parameters("pid_feedforward", axis, {})["feedforward"])
    mass = inertia * actuator_of(axis).force_per_command(axis)
    return Allowed(period, crossover, mass * square, 2.0 * breakaway(axis) / (inertia * square))


def beside_usual(axis):
    """`Allowed` of the axis's own period, and of those of `USUAL` that are another one, in rising order."""
    own = axis.value("period")
    others = [period for period in USUAL if abs(period - own) > 0.1 * own]
    return [allowed(axis, period) for period in sorted([own, *others])]
