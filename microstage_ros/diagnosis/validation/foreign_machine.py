"""Machines of nobody's make, simulated for the examination of `diagnose --log`: an axis apart from the project's own
model.

    m dv/dt = u − F_friction(v, x, z) − F_const − k_s (x − x_mid) − F_ripple sin(2π n x / lead + φ)

the force u late by the lag of an amplifier where it has one, with one of four friction laws (Coulomb with Stribeck drop
and viscosity; LuGre; Dahl; a power law of the speed), one of three controllers (P position with PI speed; PID; P
position with P speed and friction feed-forward), one of four profiles (trapezoid, S-curve, sine, steps of random
targets). It shares no code with `solver`, so that no figure rests on one simulator alone.
"""

import math

import numpy as np
from numba import njit

LAWS = ("coulomb", "lugre", "dahl", "power")
CONTROLLERS = ("cascade", "pid", "feedforward")
PROFILES = ("trapezoid", "s_curve", "sine", "random")
DT = 2e-4                  # s


@njit(cache=True)
def run(reference, dt, p, law, controller, noise_seed):
    """Position, speed, force command, and stage position behind the gap, each of shape (n,).

    ``p``: array of parameters, see `Machine.vector`.
    """
    np.random.seed(noise_seed)  # noqa: NPY002  numba knows this generator alone
    n = len(reference)
    x, v, z, integral = reference[0], 0.0, 0.0, 0.0
    out = np.zeros((n, 4))
    (
        m,
        level,
        stribeck,
        vs,
        viscous,
        asym,
        const,
        spring,
        middle,
        half,
        wave1,
        wave2,
        bump,
        bump_at,
        bump_width,
        ripple,
        order,
        phase,
        ripple2,
        order2,
        lead,
        rise,
        kp,
        kv,
        ki,
        ff,
        gain,
        gap,
        delay,
        jitter_level,
        walk,
        quad,
        lag,
        memory,
    ) = (
        p[0],
        p[1],
        p[2],
        p[3],
        p[4],
        p[5],
        p[6],
        p[7],
        p[8],
        p[9],
        p[10],
        p[11],
        p[12],
        p[13],
        p[14],
        p[15],
        p[16],
        p[17],
        p[18],
        p[19],
        p[20],
        p[21],
        p[22],
        p[23],
        p[24],
        p[25],
        p[26],
        p[27],
        p[28],
        p[29],
        p[30],
        p[31],
        p[32],
        p[33],
    )
    stage, last_ref, rest, random_level, extra = x, reference[0], 0.0, 0.0, 0.0
    late = int(round(delay / dt))
    previous, acting, slow = 0.0, 0.0, 0.0
    for k in range(n):
        r = reference[k]
        seen = r if late == 0 else reference[max(k - late, 0)]
        vr = (seen - last_ref) / dt
        last_ref = seen
        ar = (vr - previous) / dt
        previous = vr
        e = seen - x
        if controller == 0:
            ev = vr + kp * e - v
            integral += ki * ev * dt
            u = kv * (ev + integral)
        elif controller == 1:
            integral += ki * e * dt * kp
            u = kv * (kp * (e + integral / max(kp, 1e-9)) + (vr - v))
        else:
            s_ref = math.tanh(vr / max(vs, 1e-9))
            u = kv * (kp * e + vr - v) + ff * level * s_ref + ff * m * min(max(ar, -50.0), 50.0)
        acting = u if lag <= 0.0 else acting + (u - acting) * dt / (lag + dt)
        slow = v if memory <= 0.0 else slow + (v - slow) * dt / (memory + dt)
        w = (x - middle) / half
        profile = 1.0 + wave1 * math.cos(math.pi * (w + 1.0) * 0.5) + wave2 * math.sin(math.pi * w)
        profile += bump * math.exp(-0.5 * ((x - bump_at) / bump_width) ** 2)
        if walk > 0.0:
            random_level += (
                -random_level * min(abs(v) * dt / (0.1 * half), 1.0)
                + walk * math.sqrt(2.0 * abs(v) * dt / (0.1 * half)) * np.random.randn()  # noqa: NPY002
            )
        profile += random_level + jitter_level
        if abs(v) < 0.02 * vs:
            rest += dt
        elif rest > 0.0 and abs(v) > vs:
            rest = 0.0
        extra = rise * math.log10(1.0 + rest / 0.05)
        side = 1.0 + asym * (1.0 if v > 0 else -1.0)
        top = level * profile * side * (1.0 + (stribeck + extra) * math.exp(-(slow / vs) ** 2))
        if law == 1 or law == 2:
            stiff = level / 2e-5
            g = top if law == 1 else level * profile * side * (1.0 + extra * math.exp(-(v / vs) ** 2))
            zdot = v - abs(v) * stiff * z / max(g, 1e-9)
            z += zdot * dt
            z = min(max(z, -g / stiff), g / stiff)
            friction = stiff * z + (2.0 * math.sqrt(stiff * m) * 0.3) * zdot * math.exp(-(v / vs) ** 2) + viscous * slow
        elif law == 3:
            friction = top * math.tanh(v / (0.05 * vs)) + viscous * v * (abs(v) / (10.0 * vs) + 1e-9) ** -0.3
        else:
            friction = top * math.tanh(v / (0.05 * vs)) + viscous * slow
        friction += quad * v * abs(v)
        force = gain * acting - const - spring * (x - middle)
        force -= ripple * math.sin(2 * math.pi * order * x / lead + phase) + ripple2 * math.sin(
            2 * math.pi * order2 * x / lead + 1.7 * phase
        )
        v_new = v + (force - friction) / m * dt
        if law == 0 or law == 3:
            if v * v_new < 0.0 and abs(force) < abs(top):
                v_new = 0.0
        v = v_new
        x += v * dt
        stage = min(max(stage, x - 0.5 * gap), x + 0.5 * gap)
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = x, v, u, stage
    return out


def reference_of(profile, low, high, top, sharp, dwell, cycles, rng, dt=DT):
    """Set point over ``cycles`` there and back, shape (n,) [m], every ``dt`` [s].

    It goes from ``low`` to ``high`` [m] at up to ``top`` [m/s], ``sharp`` [m/s^2], and rests for ``dwell`` [s].
    """
    pieces = []
    if profile == "sine":
        period = math.pi * (high - low) / top
        t = np.arange(0.0, cycles * period, dt)
        return 0.5 * (low + high) - 0.5 * (high - low) * np.cos(2.0 * math.pi * t / period)
    at = low
    targets = [high, low] * cycles
    if profile == "random":
        targets = []
        for _ in range(cycles):
            targets += [
                float(rng.uniform(low + 0.6 * (high - low), high)),
                float(rng.uniform(low, low + 0.4 * (high - low))),
            ]
    for target in targets:
        pieces.append(_move(at, target, top, sharp, dt, profile == "s_curve"))
        pieces.append(np.full(int(dwell / dt), target))
        at = target
    return np.concatenate(pieces)


def _move(start, end, top, sharp, dt, rounded):
    """Trapezoid of speed between two places; rounded by a moving average where asked."""
    distance = abs(end - start)
    ramp = min(top / sharp, math.sqrt(distance / sharp))
    speed = sharp * ramp
    cruise = max((distance - speed * ramp) / speed, 0.0)
    t = np.arange(0.0, cruise + 2 * ramp + dt, dt)
    v = np.clip(np.minimum(t, cruise + 2 * ramp - t) * sharp, 0.0, speed)
    if rounded:
        window = max(int(0.5 * ramp / dt), 1)
        v = np.convolve(np.concatenate([np.zeros(window), v, np.zeros(window)]), np.ones(window) / window, mode="same")
    x = np.cumsum(v) * dt
    return start + (end - start) * x / x[-1]
