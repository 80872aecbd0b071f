"""The stage behind a drive train with lost motion, replayed on the motor's measured travel.

    m dv/dt = F_c − F_g(x, v)
    F_c     = K_c (d − sgn(d) b/2) + D_c ḋ where |d| > b/2, else 0,     d = (r/N) θ − x

The motor's travel is prescribed, so nothing drifts apart: wherever the replay starts in the gap, the flanks
bring it to the stage's true place within the first reversal.
"""

import numpy as np

from microstage_ros.diagnosis.preprocessing.friction_replay import pack
from microstage_ros.model.friction.generalised_maxwell_slip import stretch
from microstage_ros.numerics.compiled import compiled

STEP = 2.5e-5   # s, at most: the drive train rings at some hundred hertz


def stage_behind_gap(travel, gap, drive, period):
    """Stage position [m], shape (n,), for a motor's ``travel`` (n,) [m] through a gap [m], at a ``period`` [s]."""
    contact, parts = drive.guideway, int(np.ceil(period / STEP - 1e-6))
    return _replay(np.ascontiguousarray(travel), gap, drive.stiffness, drive.damping, drive.mass, contact.viscous,
                   pack(contact), len(contact.weight), period, parts)


@compiled
def _replay(travel, gap, stiffness, damping, mass, viscous, law, blocks, period, parts):
    out = np.empty(travel.size)
    state = np.zeros(2 * blocks)
    step = period / parts
    x, v = travel[0], 0.0
    out[0] = x
    for i in range(travel.size - 1):
        slope = (travel[i + 1] - travel[i]) / parts
        for part in range(parts):
            d = travel[i] + part * slope - x
            force = 0.0
            if abs(d) > 0.5 * gap:
                force = stiffness * (d - np.copysign(0.5 * gap, d)) + damping * (slope / step - v)
            held = 0.0
            for j in range(blocks):
                held += state[j]
            faster = v + step * (force - held - viscous * v) / mass
            direction = 1.0 if v + faster > 0.0 else (-1.0 if v + faster < 0.0 else 0.0)
            if v * faster >= 0.0:
                stretch(law, state, direction, abs(v), abs(faster), step, 1.0)
            else:
                turn = step * v / (v - faster)
                stretch(law, state, 1.0 if v > 0.0 else -1.0, abs(v), 0.0, turn, 1.0)
                stretch(law, state, 1.0 if faster > 0.0 else -1.0, 0.0, abs(faster), step - turn, 1.0)
            x += 0.5 * step * (v + faster)
            v = faster
        out[i + 1] = x
    return out
