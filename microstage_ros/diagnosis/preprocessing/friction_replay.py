"""Friction that the nominal contacts show on a measured motion: the laws of `model.friction`, replayed.

The motion is prescribed (no dynamics, so nothing drifts); each period is one stretch of motion in one
direction, or two where the speed changes sign.
"""

import numpy as np
from scipy.signal import lfilter

from microstage_ros.model.friction import generalised_maxwell_slip
from microstage_ros.model.friction.blocks import STIFFNESS
from microstage_ros.model.friction.curve import DIRECTION_WIDTH, pack_curve, stribeck_curve
from microstage_ros.model.friction.generalised_maxwell_slip import stretch
from microstage_ros.model.friction.registry import advance_law
from microstage_ros.numerics.compiled import compiled

STATES = 16     # derived: entries that hold the state of any law, eight blocks and what is apart from them


def pack(contact, asymmetry=0.0):
    """Flat parameters, shape (n,), of a `drive.Contact` for the law; limits × (1 + asymmetry · sgn w).

    ``asymmetry``: relative [1].
    """
    own = generalised_maxwell_slip.pack(
        {name: getattr(contact, name) for name in ("stiffness", "weight", "attraction")}
    )
    head = []
    for sign in (1.0, -1.0):
        factor = 1.0 + sign * asymmetry
        head += pack_curve(
            {
                "static": contact.static * factor,
                "coulomb": contact.coulomb * factor,
                "viscous": contact.viscous,
                **{name: getattr(contact, name) for name in ("stribeck_velocity", "stribeck_exponent")},
            }
        )
    return np.array(head + own)


def replay(contact, speed, period, asymmetry=0.0, factor=None, flow=None):
    """Friction without its viscous part, and the weight of its sticking blocks; both (n,), start of each period.

    A law that is not made of blocks is replayed itself; its blocks say what sticks, and carry the flow, which only
    ever enters as a difference to the same replay without it.

    Parameters
    ----------
    contact : `drive.Contact`.
    speed : shape (n,), speed of the contact's own coordinate at the start of each period [rad/s or m/s].
    period : [s].
    asymmetry : limits × (1 + asymmetry · sgn w) [1].
    factor : shape (n,), further factor on the limits in each period, or None.
    flow : shape (n,), what a sticking block at its limit flows in each period [rad or m], or None.
    """
    creeps = flow is not None
    factor = np.ones(1) if factor is None else factor
    flow = np.zeros(1) if flow is None else flow
    force, stuck = _replay(pack(contact, asymmetry), len(contact.weight), speed, factor, flow, contact.static, period)
    if contact.law >= 0 and not creeps:
        force = replayed_force(contact, speed, period, asymmetry, factor)
    return force, stuck


def replayed_force(contact, speed, period, asymmetry=0.0, factor=None, flow=None):
    """The friction alone, (n,) [N m or N], of `replay`: a law that is not made of blocks then needs no replay of them.

    ``contact``, ``speed`` (n,) [rad/s or m/s], ``period`` [s], ``asymmetry`` [1], ``factor`` (n,) [1] and ``flow`` (n,)
    [rad or m] as there.
    """
    if contact.law < 0 or flow is not None:
        return replay(contact, speed, period, asymmetry, factor, flow)[0]
    factor = np.ones(1) if factor is None else factor
    return _replay_law(contact.law, _both_ways(contact.packed, asymmetry), np.zeros(STATES), speed, factor, period)


def _both_ways(packed, asymmetry):
    """Packed parameters of a law with its limits × (1 ± asymmetry)."""
    packed = packed.copy()
    for head, sign in ((0, 1.0), (DIRECTION_WIDTH, -1.0)):
        packed[head:head + 2] *= 1.0 + sign * asymmetry     # static and coulomb open each direction's part
    return packed


def sliding_limit(contact, speed):
    """|s(w)| of `solver.contact` [N m or N] at ``speed`` [rad/s or m/s], same shape."""
    return stribeck_curve(speed, contact.static, contact.coulomb, contact.stribeck_velocity, contact.stribeck_exponent)


def lag_factor(contact, speed, period, time):
    """s(w̃)/s(w) for a friction that lags: ``time`` · dw̃/dt = |w| − w̃. Shape (n,).

    ``speed``: w, shape (n,) [rad/s or m/s]; ``period``: of its rows [s]; ``time``: of the lag [s].
    """
    keep = np.exp(-period / time)
    late = lfilter([1.0 - keep], [1.0, -keep], np.abs(speed), zi=[keep * abs(speed[0])])[0]
    return sliding_limit(contact, late) / sliding_limit(contact, speed)


@compiled
def _replay_law(law, parameters, state, speed, factor, period):
    force = np.zeros(speed.size)
    last = factor.size - 1
    for i in range(speed.size - 1):
        force[i + 1] = advance_law(law, parameters, state, speed[i], speed[i + 1], period, factor[min(i, last)])
    if speed.size > 1:
        force[0] = force[1]
    return force


@compiled
def _replay(parameters, blocks, speed, factor, flow, limit, period):
    state = np.zeros(2 * blocks)
    force = np.zeros(speed.size)
    stuck = np.ones(speed.size)
    last, creeps = factor.size - 1, flow.size > 1
    for i in range(speed.size - 1):
        a, b, scale = speed[i], speed[i + 1], factor[min(i, last)]
        if a * b >= 0.0:
            direction = 1.0 if a + b > 0.0 else (-1.0 if a + b < 0.0 else 0.0)
            force[i + 1] = stretch(parameters, state, direction, abs(a), abs(b), period, scale)
        else:
            turn = period * a / (a - b)
            stretch(parameters, state, 1.0 if a > 0.0 else -1.0, abs(a), 0.0, turn, scale)
            force[i + 1] = stretch(parameters, state, 1.0 if b > 0.0 else -1.0, 0.0, abs(b), period - turn, scale)
        if creeps:
            for j in range(blocks):
                if state[blocks + j] == 0.0:
                    share = parameters[STIFFNESS + j] * flow[i] / (parameters[STIFFNESS + blocks + j] * limit)
                    force[i + 1] -= min(share, 0.5) * state[j]
                    state[j] *= 1.0 - min(share, 0.5)
        for j in range(blocks):
            if state[blocks + j] != 0.0:
                stuck[i + 1] -= parameters[STIFFNESS + blocks + j]
    if speed.size > 1:
        force[0] = force[1]
    return force, stuck
