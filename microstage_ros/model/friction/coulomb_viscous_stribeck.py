"""Coulomb, viscous and Stribeck friction: a static map of velocity.

F = sgn(w) |s(w)| + σ w, with |s| of `stribeck_curve`; F(0) = 0.

At rest the law itself leaves the force open between ± static; whoever solves for the motion must hold
the body until the load passes that limit. Source: B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit,
"A survey of models, analysis tools and compensation methods for the control of machines with
friction", Automatica 30 (1994); paper Eq. 2.
"""

from microstage_ros.model.friction.curve import SLIDING, STRIBECK, sliding_limit
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.spec import not_negative

TITLE = "Coulomb–Stribeck"
PARAMETERS: dict = {}
CURVE = STRIBECK
FAMILY = "rigid"
BESIDE = {"coulomb_viscous": {"coulomb": not_negative("N m", "Coulomb level F_C"), "viscous": SLIDING["viscous"]}}
SAYS = {
    "Stribeck curve": True,
    "pre-sliding hysteresis": False,
}


def pack(values):
    """Own entries of the packed law, from a mapping of `PARAMETERS`."""
    return []


def state_size(packed):
    """Entries of the state: one that stays zero, since arrays of no length are awkward to store."""
    return 1


@compiled
def stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    """Force without its viscous part at the end of a stretch of motion in one direction."""
    if speed_end == 0.0:
        return 0.0
    return direction * sliding_limit(parameters, direction, speed_end, limit_factor)


def stored_energy(parameters, state):
    """Elastic energy [F q]: none."""
    return 0.0
