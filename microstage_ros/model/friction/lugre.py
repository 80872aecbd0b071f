"""LuGre: bristles whose mean deflection z follows the sliding curve.

    dz/dt = w − σ₀ |w| z / |s(w)|,     F = σ₀ z + σ₁ dz/dt + σ w

The state kept is the bristle force σ₀ z. Along the way q of a stretch it relaxes onto sgn(w) |s| with
the exponent σ₀ ∫ dq / |s|, which is exact for a constant curve and second order otherwise. σ₁ is
capped where it would make the law return energy it never stored
(:func:`~microstage_ros.model.friction.curve.passive_damping`). Sources: C. Canudas de Wit, H. Olsson,
K. J. Åström, P. Lischinsky, "A new model for control of systems with friction", IEEE Transactions on
Automatic Control 40 (1995).
"""

from microstage_ros.model.friction.curve import OWN, STRIBECK, passive_damping, relax, sliding_limit
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.spec import not_negative, positive

TITLE = "LuGre"
STIFFNESS, DAMPING = OWN, OWN + 1
PARAMETERS = {
    "stiffness": positive("N m/rad", "σ₀ of the bristles"),
    "damping": not_negative("N m s/rad", "σ₁, micro-damping", default=0.0),
}
CURVE = STRIBECK
FAMILY = "own"
EXAMPLE = {"damping": 1e-4}   # on the contact of the properties, estimates
SAYS = {
    "Stribeck curve": True,
    "frictional lag": True,
    "rising static friction": True,
    "stick-slip": True,
    "memory: return point": False,
    "memory: wipe-out": False,
}


def pack(values):
    """Own entries of the packed law, from a mapping of `PARAMETERS`."""
    return [values["stiffness"], values["damping"]]


def state_size(packed):
    """Entries of the state: the bristle force σ₀ z."""
    return 1


@compiled
def stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    """Force without its viscous part at the end of a stretch of motion in one direction."""
    if direction == 0.0:
        return state[0]
    s_start = sliding_limit(parameters, direction, speed_start, limit_factor)
    s_end = sliding_limit(parameters, direction, speed_end, limit_factor)
    reach = 0.5 * parameters[STIFFNESS] * duration * (speed_start / s_start + speed_end / s_end)
    bristle = relax(direction * state[0], s_start, s_end, reach)
    state[0] = direction * bristle
    damping = passive_damping(parameters[DAMPING], s_end, speed_end, 4.0)
    return direction * (bristle + damping * speed_end * (1.0 - bristle / s_end))


def stored_energy(parameters, state):
    """Elastic energy (σ₀ z)² / 2σ₀ [F q]."""
    return float(state[0] ** 2 / (2.0 * parameters[STIFFNESS]))
