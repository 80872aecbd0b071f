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
from microstage_ros.diagnosis.prerequisites.amplifier import LEAST_GAIN
from microstage_ros.model.effects import REGISTRY

# factors where the search begins; derived: one of them is within a factor of two of any between an eighth and eight
DAMPINGS = (0.25, 1.0, 4.0)
# χ² per row over the baseline's from which the search is worth its time; calibrated by: validation.margins
# (1.10 to 1.16)
STANDS_OUT = 1.15
# share of the resonance's χ² that the damping must take beside the stiffness; calibrated by: validation.margins
# (0.038 to 0.18)
BETTER = 0.08
# of the mass's logarithm, on both sides of the reciprocal of the stiffness that fits; derived: a factor of two, as
# between the `DAMPINGS`
MASS_REACH = float(np.log(2.0))
# of logarithms; derived: a thirtieth of `STIFFNESS_ERROR`; halving a simplex a dozen times in each direction
SEARCH = {"xatol": 2e-3, "maxiter": 50}
# of the stiffness's logarithm, the search's first step; derived: half way to the next of the catalogue, ln(1/0.8)/2
FIRST_STEP = 0.12
# of a form's own size, between which it is the right one; calibrated by: validation.variation --group drawn (half and
# double: the same answers)
DRAWN = (0.5, 1.8)
GRID = 9             # masses tried before the search; derived: steps of a sixth in a range of a factor of four
MOST_LOAD = 1.5      # of the mass's factor; derived: the guideways carry the stage, by a mass known to a half
# share of the stiffness; calibrated by: microstage campaign --form-errors (0.020 to 0.058, stated to a hundredth)
STIFFNESS_ERROR = 0.06
STEP = STIFFNESS_ERROR    # of the logarithms, for the bend at the best pair; derived: the error that is stated anyway
# share of the damping, which a loop that swings at its resonance tells poorly; calibrated by: the same (0.050 to 0.20)
DAMPING_ERROR = 0.2
# factor on the stiffness beyond which the motion is computed with it; calibrated by: validation.margins (1.001 and
# more), and with --known --kind single --world second --effect drive_compliance payload_change --seed 9814 --cases 9
# (up to 1.84)
FAR = 1.5
# share of what stands out that the pair must take to count; calibrated by: validation.margins (0.20 to 1.1)
EXPLAINS = 0.3
TINY = np.finfo(float).tiny


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
        """`Drive` with these factors on ``nominal``, a `Drive`."""
        return dataclasses.replace(
            nominal, stiffness=nominal.stiffness * self.stiffness, damping=nominal.damping * self.damping
        )


def fit_train(learn, base, near=None):
    """`Train` that the resonance channels of some records tell, or None if nothing stands out there.

    ``near``: a `Train` to start from, which spares the search over the grid. The motion is computed with it by then,
    and the load is fitted along as in `_drive_form`.
    """
    left = (lambda k, d: _left_with_load(learn, stiffness=k, damping=d)[0]) if near else (
        lambda k, d: _energy(learn, k, d))
    rows = sum(len(c.residual) for c in learn)
    usual = np.mean([_left(c, 1.0, 1.0) / len(c.residual) for c in base]) if base else 1.0
    before = _energy(learn, 1.0, 1.0)
    if before < STANDS_OUT * usual * rows:
        return None
    dampings = (1.0,) if near else DAMPINGS
    table = {(k, d): left(k, d) for k in (1.0, *STIFFNESS_FACTORS) for d in dampings}
    start = (near.stiffness, near.damping) if near else min(table, key=lambda at: table[at])
    fit = minimize(lambda at: left(*map(float, np.exp(at))), np.log(start), method="Nelder-Mead", bounds=_bounds(),
                   options={**SEARCH, "fatol": 1.0,
                            "initial_simplex": np.log(start) + np.array([[0.0, 0.0], [FIRST_STEP, 0.0], [0.0, 0.5]])})
    if before - fit.fun < EXPLAINS * (before - usual * rows):
        return None
    alone = min(value for (_, d), value in table.items() if d == 1.0)
    stiffness, damping = (float(v) for v in np.exp(fit.x))
    return Train(stiffness, damping, before, float(fit.fun), alone)


def with_likelier_damping(learn, stiffness):
    """`Train` of a factor ``stiffness`` [1] that the wind-up told, with the model's damping, or with that of a mass,
    which falls by the same factor, whichever leaves less in the resonance channels ``learn``."""
    left = {damping: _left_with_load(learn, stiffness=stiffness, damping=damping)[0] for damping in (1.0, stiffness)}
    damping = min(left, key=lambda factor: left[factor])
    return Train(stiffness, damping, _energy(learn, 1.0, 1.0), left[damping], left[1.0])


def _bounds():
    """Of the logarithms of stiffness and damping, by the effect's largest factors: where nothing depends on one of them
    the search would go for ever."""
    known = REGISTRY["drive_compliance"].parameters
    return [(-np.log(known[n].maximum), np.log(known[n].maximum)) for n in ("stiffness_factor", "damping_factor")]


def damped_forms(collection, known=None):
    """`Form` of ``drive_compliance`` with its own damping and of ``payload_change`` with its own mass, as far as they
    stand out.

    A mass g times as large moves the resonance as a stiffness and a damping of 1/g do, H = (D s + K)/(m s² + D s + K);
    on grids of other fineness the coarser one would lose although it is true. ``known``: the `Train` of
    before, if there is one.
    """
    if "resonance" not in collection.names:
        return []
    learn, base = (
        [c["resonance"] for c in collection.channels[group] if "resonance" in c] for group in ("learn", "base")
    )
    train = fit_train(learn, base, known)
    if train is None:
        return []
    return [_mass_form(learn, train), _drive_form(learn, train)]


def _drive_form(learn, train):
    """`Form` of ``drive_compliance`` in the resonance at the stiffness, and the damping if it tells, that fit best.

    The load is fitted along as in `_mass_form`: a mass is a stiffness and a damping of its reciprocal, and the two
    names are only to be compared on the same footing.
    """
    damped = train.alone - train.after >= max(BETTER * (train.before - train.after), LEAST_GAIN)

    def left(at):
        damping = float(np.exp(at[1])) if damped else 1.0
        return _left_with_load(learn, stiffness=float(np.exp(at[0])), damping=damping)[0]

    start = np.log([train.stiffness, train.damping])[: 2 if damped else 1]
    simplex = start + 2.0 * STEP * np.eye(len(start) + 1, len(start), -1)
    fit = minimize(left, start, method="Nelder-Mead", bounds=_bounds()[: len(start)],
                   options={**SEARCH, "fatol": 1.0, "initial_simplex": simplex})
    at = np.append(fit.x, [] if damped else [0.0])
    load = _left_with_load(learn, **dict(zip(("stiffness", "damping"), map(float, np.exp(at)))))[1]
    errors = [_error(left, fit.x, step, fit.fun) for step in np.eye(len(start)) * STEP]
    return _form(at, errors, load)


def _error(left, at, step, least):
    """Standard error along a step of the logarithms, from the bend of χ² there."""
    bend = left(at + step) + left(at - step) - 2.0 * least
    return STEP * np.sqrt(2.0 / max(bend, 2.0))


def _as_drawn(beta):
    """Whether a form made at one size is near enough to it to be the right one."""
    return DRAWN[0] < beta[0] < DRAWN[1]


def _mass_form(learn, train):
    """`Form` of ``payload_change`` in the resonance at the mass that fits best.

    The load on the guideways is fitted along: their force is replayed from the stage's noisy reading, which takes from
    it what it does within a resonance's cycle.
    """
    def left(log):
        return _left_with_load(learn, mass=float(np.exp(log)))[0]

    start = -float(np.log(train.stiffness))
    low, high = start - MASS_REACH, start + MASS_REACH
    grid = np.linspace(low, high, GRID)     # a resonance that meets another frequency makes more than one valley
    best = grid[int(np.argmin([left(log) for log in grid]))]
    step = (high - low) / (GRID - 1)
    best = minimize_scalar(left, bounds=(best - step, best + step), method="bounded", options=SEARCH)
    factor = float(np.exp(best.x))
    load = _left_with_load(learn, mass=factor)[1]
    error = float(np.hypot(_error(left, best.x, STEP, best.fun), STIFFNESS_ERROR)) * factor

    def sizes(beta, covariance, frame):
        mass = frame.drive.mass
        return {"mass_kg": (mass * (factor - 1.0), mass * error, "kg")}, {"mass_kg": mass * (factor - 1.0)}

    return Form(
        "payload_change",
        "resonance",
        f"{factor:.6g},{load:.3g}",
        payload_resonance(factor, load),
        sizes,
        _as_drawn,
    )


def _left_with_load(channels, mass=1.0, **factors):
    """χ² that these factors of the drive train leave, and the factor on the guideways' force that goes best with them,
    from none to `MOST_LOAD` times the mass's."""
    def parts(channel):
        free = channel.change(mass=mass, load=0.0, **factors)
        columns = np.stack([channel.residual - free, channel.change(mass=mass, **factors) - free], axis=1)
        white = channel.whiten(columns)[0]
        return white.T @ white

    (rest, cross), (_, own) = sum(side_by_side(parts, channels))
    load = float(np.clip(cross / max(own, TINY), 0.0, MOST_LOAD * mass))
    return float(rest - 2.0 * load * cross + load**2 * own), load


def compliance_and_damping(stiffness, damping, load=1.0):
    """Wind-up and resonance with K_c, D_c and the guideways' force times these factors [1], minus nominal; β = 1 at
    these. ``stiffness``, ``damping`` and ``load``: the factors [1]."""
    def columns(channel, frame):
        return channel.change(stiffness, damping, load=load)[:, None]
    return columns


def _left(channel, stiffness, damping):
    """χ² of one record with these factors."""
    left = channel.residual - channel.change(stiffness, damping)
    return float((channel.whiten(left[:, None])[0] ** 2).sum())


def _energy(channels, stiffness, damping):
    return sum(side_by_side(lambda c: _left(c, stiffness, damping), channels))


def _form(at, errors, load):
    """`Form` at these logarithms of stiffness and damping, with their standard errors; one error: the stiffness's
    alone."""
    stiffness, damping = (float(v) for v in np.exp(at))

    def sizes(beta, covariance, frame):
        fitted = {"stiffness_factor": (stiffness, stiffness * float(np.hypot(errors[0], STIFFNESS_ERROR)), "1")}
        if len(errors) > 1:
            fitted["damping_factor"] = (damping, damping * float(np.hypot(errors[1], DAMPING_ERROR)), "1")
        return fitted, {name: value for name, (value, *_) in fitted.items()}

    return Form(
        "drive_compliance",
        "resonance",
        f"{stiffness:.4g},{damping:.4g}",
        compliance_and_damping(stiffness, damping, load),
        sizes,
        _as_drawn,
    )
