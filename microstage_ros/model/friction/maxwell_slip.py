"""Maxwell-slip: elasto-slip blocks in parallel with constant limits, hysteresis with non-local memory.

    dF_i = k_i dx while |F_i| < α_i F_s;     F_i = ± α_i F_s while it slips;     F = Σ F_i + σ w

F_s is the static limit of the direction of motion. Exact for any monotone displacement. Sources:
W. D. Iwan, "A distributed-element model for hysteresis and its steady-state dynamic response", Journal
of Applied Mechanics 33 (1966); V. Lampaert, F. Al-Bender, J. Swevers, "A generalized Maxwell-slip
friction model appropriate for control purposes" (2003); paper Eqs. 3–6.
"""

from microstage_ros.model.friction.blocks import COUNT, block_parameters, blocks_energy, drag_blocks, pack_blocks
from microstage_ros.model.friction.curve import LIMIT
from microstage_ros.numerics.compiled import compiled

TITLE = "Maxwell-slip"
PARAMETERS = {
    **block_parameters(),
}
CURVE = LIMIT
FAMILY = "blocks"


def pack(values):
    """Own entries of the packed law, from a mapping of `PARAMETERS`."""
    return pack_blocks(values["stiffness"], values["weight"])


def state_size(packed):
    """Entries of the state: the force of each block."""
    return int(packed[COUNT])


@compiled
def stretch(parameters, state, direction, speed_start, speed_end, duration, limit_factor):
    """Force without its viscous part at the end of a stretch of motion in one direction."""
    return drag_blocks(parameters, state, direction * 0.5 * (speed_start + speed_end) * duration, limit_factor)


stored_energy = blocks_energy
