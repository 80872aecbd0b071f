"""Hysteretic friction from a prescribed motion: a ladder of laws, each linear in its levels.

Every Maxwell-slip block is a stop operator, z ← clip(z + Δx, ±w), times its stiffness; on a grid of slip
displacements w the force is linear in the stiffnesses, so non-negative least squares finds them and the
number of blocks at once. With lost motion (backlash) a block carries no force in the middle of its
travel: F = g(z) with g monotone and flat where there is no contact, again linear on a grid.

    coulomb_viscous   F = F_c sgn v + σ v
    maxwell_slip      F = Σ k_j z_j                      z_j stop operators of widths w_j
    lost_motion       F = g(z)                           one stop operator, g piecewise linear, g' ≥ 0

Sources: W. D. Iwan, Journal of Applied Mechanics 33 (1966) for the blocks; non-negative least squares: C. L. Lawson,
R. J. Hanson, Solving Least Squares Problems, Prentice-Hall 1974.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar, nnls

from microstage_ros.model.friction.positions import stop_operators
from microstage_ros.quantities.errors import InputError

GRID = 40
CHARACTERISTIC_SEGMENTS = 12


@dataclass(frozen=True)
class HystereticLaw:
    """A fitted law; ``force(position, velocity)`` gives its prediction [N] for another motion.

    ``name`` is one of the ladder; ``widths`` [m] the slip displacements; ``levels`` what multiplies the
    columns of `_columns`: (F_c [N], σ [N s/m]), stiffnesses [N/m], or slopes of g [N/m].
    """

    name: str
    widths: np.ndarray
    levels: np.ndarray

    def force(self, position, velocity):
        """Friction force [N] along a prescribed motion: positions [m] and velocities [m/s], shape (n,)."""
        return _columns(self.name, self.widths, position, velocity) @ self.levels


def _columns(name, widths, position, velocity):
    if name == "coulomb_viscous":
        return np.column_stack([np.sign(velocity), velocity])
    states = stop_operators(position, widths).T
    return states if name == "maxwell_slip" else _characteristic(states[:, 0], widths[0])


def _characteristic(state, width):
    """Hinge columns of a monotone g on ±width, both signs apart, shape (n, 2·segments)."""
    knots = np.linspace(0.0, width, CHARACTERISTIC_SEGMENTS + 1)
    low, high = knots[:-1], knots[1:]
    pushed = np.clip(state[:, None], low, high) - low
    pulled = np.clip(state[:, None], -high, -low) + low
    return np.hstack([pushed, pulled])


def fit_coulomb_viscous(position, velocity, force):
    """Least squares of F_c [N] and σ [N s/m]. Returns `HystereticLaw`.

    ``position`` [m], ``velocity`` [m/s], ``force`` [N], each of shape (n,).
    """
    columns = _columns("coulomb_viscous", (), position, velocity)
    return HystereticLaw("coulomb_viscous", np.empty(0), np.linalg.lstsq(columns, force, rcond=None)[0])


def fit_maxwell_slip(position, velocity, force):
    """Maxwell-slip blocks: stiffnesses ≥ 0 on a grid of slip displacements; blocks that get none are dropped.

    ``position`` [m], ``velocity`` [m/s], ``force`` [N], each of shape (n,).

    The grid runs geometrically from a hundredth of the motion's span to half of it (a wider block never slips).
    Returns `HystereticLaw`; raises InputError if the position does not move.
    """
    span = _span(position)
    widths = np.geomspace(0.01 * span, 0.5 * span, GRID)
    stiffness, _ = nnls(_columns("maxwell_slip", widths, position, velocity), force)
    kept = stiffness > 0.0
    return HystereticLaw("maxwell_slip", widths[kept], stiffness[kept])


def fit_lost_motion(position, velocity, force):
    """One block behind lost motion: width by a scan and a line search, g' ≥ 0 by least squares.

    ``position`` [m], ``velocity`` [m/s], ``force`` [N], each of shape (n,).

    Returns `HystereticLaw`; raises InputError if the position does not move.
    """
    span = _span(position)

    def solve(width):
        return nnls(_columns("lost_motion", (width,), position, velocity), force)

    scan = np.geomspace(0.02 * span, 0.5 * span, 16)
    best = int(np.argmin([solve(width)[1] for width in scan]))
    bracket = scan[max(best - 1, 0)], scan[min(best + 1, len(scan) - 1)]
    width = minimize_scalar(lambda w: solve(w)[1], bounds=bracket, method="bounded", options={"xatol": 1e-3 * span}).x
    return HystereticLaw("lost_motion", np.array([width]), solve(width)[0])


def _span(position):
    span = float(np.ptp(position))
    if not span > 0.0:
        raise InputError("position", f"constant at {float(position[0])!r} m", "a motion that reverses")
    return span


LADDER = {"coulomb_viscous": fit_coulomb_viscous, "maxwell_slip": fit_maxwell_slip, "lost_motion": fit_lost_motion}
"""The hypotheses from the plainest to the richest; all are fitted, held-out motion decides."""
