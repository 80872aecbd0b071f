"""The stage behind a drive train with lost motion, replayed on the motor's measured travel.

    m dv/dt = F_c − F_g(x, v)
    F_c     = K_c (d − sgn(d) b/2) + D_c ḋ where |d| > b/2, else 0,     d = (r/N) θ − x

The motor's travel is prescribed, so nothing drifts apart: wherever the replay starts in the gap, the flanks
bring it to the stage's true place within the first reversal.

Positions and friction blocks stand half a step beside the speed (Störmer and Verlet; E. Hairer, C. Lubich, G. Wanner,
"Geometric numerical integration illustrated by the Störmer–Verlet method", Acta Numerica 12, 2003), what damps is
implicit: second order, no energy from the step itself, and one stretch of friction in one direction per step.
"""

import numpy as np

from microstage_ros.diagnosis.preprocessing.friction_replay import pack
from microstage_ros.model.friction.generalised_maxwell_slip import stretch
from microstage_ros.numerics.compiled import compiled

# derived: (ω h)²/24 of the drive train's oscillation, the scheme's error of its frequency, is 4·10⁻⁴
ANGLE = 0.1     # rad of that oscillation in a step, at most


def stage_behind_gap(travel, gap, drive, period):
    """Stage position [m], shape (n,), for a motor's ``travel`` (n,) [m] through a gap [m], at a ``period`` [s]."""
    contact = drive.guideway
    # derived: a whole number stays whole when it is rounded
    parts = int(np.ceil(period * np.sqrt(drive.stiffness / drive.mass) / ANGLE - 1e-6))
    return _replay(np.ascontiguousarray(travel), gap, drive.stiffness, drive.damping, drive.mass, contact.viscous,
                   pack(contact), len(contact.weight), period, parts)


@compiled
def _replay(travel, gap, stiffness, damping, mass, viscous, law, blocks, period, parts):
    out = np.empty(travel.size)
    state = np.zeros(2 * blocks)
    step = period / parts
    x, v = travel[0], 0.0   # x: in the middle of the step that v goes on to
    out[0] = x
    for i in range(travel.size - 1):
        slope = (travel[i + 1] - travel[i]) / parts
        for part in range(parts):
            x += step * v
            direction = 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0)
            force = -stretch(law, state, direction, abs(v), abs(v), step, 1.0)
            damped = viscous
            d = travel[i] + (part + 0.5) * slope - x
            if abs(d) > 0.5 * gap:
                force += stiffness * (d - np.copysign(0.5 * gap, d)) + damping * slope / step
                damped += damping
            half = 0.5 * step * damped / mass
            v = ((1.0 - half) * v + step * force / mass) / (1.0 + half)
        out[i + 1] = x + 0.5 * step * v
    return out
