"""A drive train whose stiffness and damping changed: both fitted to the fast part of stage against motor.

The catalogue's grid of stiffnesses keeps the damping; where that leaves much of the resonance, one more form is made
for the pair that fits. And where the stage follows the motor so differently, the motion itself is computed from
that pair.
"""

import dataclasses

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from microstage_ros.diagnosis.catalogue.electrical import STIFFNESS_FACTORS, payload_resonance
from microstage_ros.diagnosis.catalogue.form import Form
from microstage_ros.diagnosis.preprocessing.threads import side_by_side
from microstage_ros.model.effects import REGISTRY

DAMPINGS = (0.25, 1.0, 4.0)
STANDS_OUT = 1.15     # χ² per row over the baseline's from which the search is worth its time
BETTER = 0.08         # share of the resonance's χ² that the damping must take beside the stiffness,
LEAST = 150.0         # and at least this much
MASS_RANGE = (0.3, 30.0)   # of the moving mass
MASS_REACH = 0.7      # of its logarithm, on both sides of the reciprocal of the stiffness that fits
STEP = 0.05           # of the logarithms, for the bend at the best pair
STIFFNESS_ERROR = 0.06
# share of the damping: a loop that swings at its resonance tells it poorly (simulated: factors of 0.6 to 2)
DAMPING_ERROR = 0.4
EXPLAINS = 0.3        # share of what stands out that the pair must take to count


@dataclasses.dataclass(frozen=True)
class Train:
    """Factors on stiffness and damping that fit best, with the χ² without and with them, and with the stiffness
    alone."""

    stiffness: float
    damping: float
    before: float
    after: float
    alone: float

    def drive(self, nominal):
        """`Drive` with these factors."""
        return dataclasses.replace(
            nominal, stiffness=nominal.stiffness * self.stiffness, damping=nominal.damping * self.damping
        )


def fit_train(learn, base):
    """`Train` that the resonance channels of some records tell, or None if nothing stands out there."""
    rows = sum(len(c.residual) for c in learn)
    usual = np.mean([_left(c, 1.0, 1.0) / len(c.residual) for c in base]) if base else 1.0
    before = _energy(learn, 1.0, 1.0)
    if before < STANDS_OUT * usual * rows:
        return None
    table = {(k, d): _energy(learn, k, d) for k in (1.0, *STIFFNESS_FACTORS) for d in DAMPINGS}
    start = min(table, key=table.get)
    fit = minimize(lambda at: _energy(learn, *np.exp(at)), np.log(start), method="Nelder-Mead", bounds=_bounds(),
                   options={"xatol": 2e-3, "fatol": 1.0, "maxiter": 50,
                            "initial_simplex": np.log(start) + np.array([[0.0, 0.0], [0.12, 0.0], [0.0, 0.5]])})
    if before - fit.fun < EXPLAINS * (before - usual * rows):
        return None
    alone = min(value for (_, d), value in table.items() if d == 1.0)
    return Train(*(float(v) for v in np.exp(fit.x)), before, float(fit.fun), alone)


def _bounds():
    """Of the logarithms of stiffness and damping, by the effect's largest factors: where nothing depends on one of them
    the search would go for ever."""
    known = REGISTRY["drive_compliance"].parameters
    return [(-np.log(known[n].maximum), np.log(known[n].maximum)) for n in ("stiffness_factor", "damping_factor")]


def damped_forms(collection):
    """`Form` of ``drive_compliance`` with its own damping and of ``payload_change`` with its own mass, as far as they
    stand out.

    A mass g times as large moves the resonance as a stiffness and a damping of 1/g do, H = (D s + K)/(m s² + D s + K);
    on grids of other fineness the coarser one would lose although it is true.
    """
    if "resonance" not in collection.names:
        return []
    learn, base = (
        [c["resonance"] for c in collection.channels[group] if "resonance" in c] for group in ("learn", "base")
    )
    train = fit_train(learn, base)
    if train is None:
        return []
    forms = [_mass_form(learn, train)]
    if train.alone - train.after >= max(BETTER * (train.before - train.after), LEAST):
        at = np.log([train.stiffness, train.damping])
        forms.append(_form(at, _errors(learn, at, train.after)))
    return forms


def _mass_form(learn, train):
    """`Form` of ``payload_change`` in the resonance at the mass that fits best."""
    def left(log):
        return sum(side_by_side(lambda c: _left_with_mass(c, float(np.exp(log))), learn))

    start = float(np.clip(-np.log(train.stiffness), *np.log(MASS_RANGE)))
    low, high = np.clip([start - MASS_REACH, start + MASS_REACH], *np.log(MASS_RANGE))
    best = minimize_scalar(left, bounds=(low, high), method="bounded", options={"xatol": 2e-3, "maxiter": 18})
    factor = float(np.exp(best.x))
    bend = left(best.x + STEP) + left(best.x - STEP) - 2.0 * best.fun
    error = float(np.hypot(STEP * np.sqrt(2.0 / max(bend, 2.0)), STIFFNESS_ERROR)) * factor

    def sizes(beta, covariance, frame):
        mass = frame.drive.mass
        return {"mass_kg": (mass * (factor - 1.0), mass * error, "kg")}, {"mass_kg": mass * (factor - 1.0)}

    return Form(
        "payload_change",
        "resonance",
        f"{factor:.6g}",
        payload_resonance(factor),
        sizes,
        lambda beta: 0.5 < beta[0] < 1.8,
    )


def _left_with_mass(channel, factor):
    """χ² of one record with the mass, and the guideway's load, times this factor."""
    left = channel.residual - channel.change(mass=factor, load=factor)
    return float((channel.whiten(left[:, None])[0] ** 2).sum())


def compliance_and_damping(stiffness, damping):
    """Wind-up and resonance with K_c and D_c times these factors, minus nominal; β = 1 at these."""
    def columns(channel, frame):
        return channel.change(stiffness, damping)[:, None]
    return columns


def _left(channel, stiffness, damping):
    """χ² of one record with these factors."""
    left = channel.residual - channel.change(stiffness, damping)
    return float((channel.whiten(left[:, None])[0] ** 2).sum())


def _energy(channels, stiffness, damping):
    return sum(side_by_side(lambda c: _left(c, stiffness, damping), channels))


def _errors(channels, at, least):
    """Standard errors of the two logarithms from the bend of χ² along each."""
    found = []
    for axis in np.eye(2) * STEP:
        bend = sum(_energy(channels, *np.exp(at + sign * axis)) for sign in (1.0, -1.0)) - 2.0 * least
        found.append(STEP * np.sqrt(2.0 / max(bend, 2.0)))
    return found


def _form(at, errors):
    stiffness, damping = (float(v) for v in np.exp(at))

    def sizes(beta, covariance, frame):
        return ({"stiffness_factor": (stiffness, stiffness * float(np.hypot(errors[0], STIFFNESS_ERROR)), "1"),
                 "damping_factor": (damping, damping * float(np.hypot(errors[1], DAMPING_ERROR)), "1")},
                {"stiffness_factor": stiffness, "damping_factor": damping})

    return Form(
        "drive_compliance",
        "resonance",
        f"{stiffness:.4g},{damping:.4g}",
        compliance_and_damping(stiffness, damping),
        sizes,
        lambda beta: 0.5 < beta[0] < 1.8,
    )
