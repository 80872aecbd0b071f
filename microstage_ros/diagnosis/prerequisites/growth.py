"""A viscous friction that grows with a power of the speed: the power fitted to the torque balance.

The catalogue's grid of powers leaves a misfit of up to a thousandth of what it explains, which of a strong growth is
more than any other cause of friction holds; so one more form is made for the power that fits.
"""

import numpy as np
from scipy.optimize import minimize_scalar

from microstage_ros.diagnosis.catalogue.form import Form
from microstage_ros.diagnosis.catalogue.friction import EXPONENTS, nonlinear_viscous

EFFECT = "nonlinear_viscous"
OTHER_POWER = "generic:power"      # nameless: what a growth of a slightly other power is beyond this one
#: χ² of the grid's best power from which the search is worth its time; derived: a thousandth of it, the grid's misfit,
#: is then more than chance takes (e⁻¹⁷ of one size)
LEAST = 3.0e4
REACH = 0.5         # of the power, on both sides of the grid's best; derived: half of its widest step
# of the power: what the speed's own error makes of it; calibrated by: microstage campaign --world second --kind two
# --seed 2211 (0.009 and 0.004 off in cases 3 and 37, doubled)
UNSURE = 0.02
STEP = UNSURE       # of the power, for the bend at the best
LINEAR = 0.1        # so near to 1 a power is a viscous friction, which has a name; derived: five times `UNSURE`
SEARCH = {"xatol": 1e-3, "maxiter": 16}     # of the power; derived: a twentieth of `UNSURE`


def power_forms(collection):
    """[`Form`] of ``nonlinear_viscous`` at the power of the speed that fits best, and of what a slightly other power
    is beyond it; none where it holds little, or is no power but a viscous friction."""
    if "torque" not in collection.names:
        return []
    learn = collection.growing("torque", [], "learn")

    def gain(power):
        form = Form(EFFECT, "torque", f"{power:.5g}", nonlinear_viscous(power))
        return learn.alone(form).fit([form.key])[2]

    grid = {power: gain(power) for power in EXPONENTS}
    start = max(grid, key=lambda power: grid[power])
    if grid[start] < LEAST:
        return []
    found = minimize_scalar(lambda power: -gain(power), bounds=(max(start - REACH, STEP), start + REACH),
                            method="bounded", options=SEARCH)
    power = float(found.x)
    if abs(power - 1.0) < LINEAR:
        return []
    bend = (gain(power) * 2.0 - gain(power - STEP) - gain(power + STEP)) / STEP**2
    stderr = float(np.hypot(np.sqrt(2.0 / max(bend, 2.0)), UNSURE))
    return [_form(power, stderr), Form(OTHER_POWER, "torque", "", _other_power(power))]


def _other_power(power):
    """Columns of ∂|ω|^n sgn ω/∂n [(rad/s)^n] at n = ``power`` [1], by a central difference."""
    def columns(channel, frame):
        more, less = (nonlinear_viscous(power + side)(channel, frame) for side in (STEP, -STEP))
        return (more - less) / (2.0 * STEP)
    return columns


def _form(power, stderr):
    def sizes(beta, covariance, frame):
        value = float(beta[0])
        return ({"coefficient": (value, float(np.sqrt(covariance[0, 0])), "N m/(rad/s)^n"),
                 "exponent": (power, stderr, "1")}, {"coefficient": value, "exponent": power})

    grows = (lambda beta: beta[0] > 0.0) if power < 1.0 else None
    return Form(EFFECT, "torque", f"{power:.5g}", nonlinear_viscous(power), sizes, grows)
