"""The same equations solved by others, for the benchmarks: scipy's LSODA and Radau, numpy, plain Python.

Right-hand side of MODEL's nominal axis with every block its own state, z = [i, ω, θ, v, x, F_a…, F_g…]:
a block slips where its force, in the direction of motion, has reached its limit, and sticks otherwise.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp


class Equations:
    """The nominal equations with the numbers of a plant record."""

    def __init__(self, plant):
        self.p = {name: float(plant[name]) for name in (
            "period", "resistance", "inductance", "back_emf", "torque_constant", "inertia", "gear", "ratio",
            "stiffness", "damping", "mass")}
        self.contacts = []
        for name in ("actuator", "guideway"):
            c = plant[name]
            n = int(c["blocks"])
            self.contacts.append({
                "k": (c["kappa"] * c["weight"])[:n].copy(), "alpha": c["weight"][:n].copy(),
                "static": float(c["static"]),
                "coulomb": float(c["coulomb"]), "velocity": float(c["velocity"]), "exponent": float(c["exponent"]),
                "attraction": float(c["attraction"]), "viscous": float(c["viscous"]), "drops": bool(c["drops"])})
        self.size = 5 + sum(len(c["k"]) for c in self.contacts)

    def _block_rates(self, c, force, w):
        s = c["coulomb"]
        if c["drops"]:
            s += (c["static"] - c["coulomb"]) * math.exp(-(abs(w) / c["velocity"]) ** c["exponent"])
        sign = math.copysign(1.0, w)
        slips = force * sign >= c["alpha"] * s * (1.0 - 1e-9)
        slip_rate = 0.0 if math.isinf(c["attraction"]) else c["attraction"] * (sign * c["alpha"] - force / s)
        return np.where(slips, slip_rate, c["k"] * w)

    def rates(self, z, u):
        """dz/dt at state ``z`` and voltage ``u`` [V], with numpy over the blocks; rates and state (size,), SI."""
        p, (a, g) = self.p, self.contacts
        i, omega, theta, v, x = z[:5]
        w = omega / p["gear"]
        n = 5 + len(a["k"])
        fa, fg = z[5:n], z[n:]
        spring = p["stiffness"] * (p["ratio"] * theta - x) + p["damping"] * (p["ratio"] * omega - v)
        return np.concatenate([[
            (u - p["resistance"] * i - p["back_emf"] * omega) / p["inductance"],
            (p["torque_constant"] * i - fa.sum() - a["viscous"] * w - p["ratio"] * spring) / p["inertia"],
            omega,
            (spring - fg.sum() - g["viscous"] * v) / p["mass"],
            v,
        ], self._block_rates(a, fa, w), self._block_rates(g, fg, v)])

    def rates_python(self, z, u):
        """dz/dt at state ``z`` and voltage ``u`` [V], as lists of shape (size,), SI; in plain Python."""
        p, (a, g) = self.p, self.contacts
        n = 5 + len(a["k"])
        w = z[1] / p["gear"]
        spring = p["stiffness"] * (p["ratio"] * z[2] - z[4]) + p["damping"] * (p["ratio"] * z[1] - z[3])
        out = [
            (u - p["resistance"] * z[0] - p["back_emf"] * z[1]) / p["inductance"],
            (p["torque_constant"] * z[0] - sum(z[5:n]) - a["viscous"] * w - p["ratio"] * spring) / p["inertia"],
            z[1], (spring - sum(z[n:]) - g["viscous"] * z[3]) / p["mass"], z[3],
        ]
        for c, forces, speed in ((a, z[5:n], w), (g, z[n:], z[3])):
            s = c["coulomb"]
            if c["drops"]:
                s += (c["static"] - c["coulomb"]) * math.exp(-(abs(speed) / c["velocity"]) ** c["exponent"])
            sign = math.copysign(1.0, speed)
            for f, k, alpha in zip(forces, c["k"], c["alpha"]):
                if f * sign >= alpha * s * (1.0 - 1e-9):
                    out.append(0.0 if math.isinf(c["attraction"]) else c["attraction"] * (sign * alpha - f / s))
                else:
                    out.append(k * speed)
        return out


def sizes(equations):
    """Typical size of each state [A, rad/s, rad, m/s, m, N m…, N…], shape (size,), for absolute tolerances."""
    blocks = [len(contact["k"]) for contact in equations.contacts]
    return np.array([1e-3, 1e-2, 1e-5, 1e-7, 1e-10] + [1e-8] * blocks[0] + [1e-4] * blocks[1])


def solve_with_scipy(equations, voltage, method, rtol):
    """Stage positions (n,) [m] after each period with `scipy.integrate.solve_ivp`, one call per held voltage.

    ``equations``: `Equations`; ``voltage`` (n,) [V]; ``method``: scipy's name of one; ``rtol``: relative tolerance [1].
    """
    period, scale = equations.p["period"], sizes(equations)
    z, x = np.zeros(equations.size), []
    for u in voltage:
        z = solve_ivp(lambda t, y: equations.rates(y, u), (0.0, period), z, method=method, rtol=rtol,
                      atol=scale * rtol).y[:, -1]
        x.append(z[4])
    return np.array(x)


def solve_with_runge_kutta(equations, voltage, substeps, plain_python=False):
    """Stage positions (n,) [m] after each period with fixed-step Runge–Kutta 4, in numpy or in plain Python.

    ``equations``: `Equations`; ``voltage`` (n,) [V]; ``substeps`` per period [1].
    """
    dt = equations.p["period"] / substeps
    z: list[float] | np.ndarray = [0.0] * equations.size if plain_python else np.zeros(equations.size)
    x = []
    for u in voltage:
        for _ in range(substeps):
            z = _python_step(equations, z, u, dt) if plain_python else _numpy_step(equations, z, u, dt)
        x.append(z[4])
    return np.array(x)


def _numpy_step(equations, z, u, dt):
    a = equations.rates(z, u)
    b = equations.rates(z + 0.5 * dt * a, u)
    c = equations.rates(z + 0.5 * dt * b, u)
    return z + dt / 6.0 * (a + 2.0 * b + 2.0 * c + equations.rates(z + dt * c, u))


def _python_step(equations, z, u, dt):
    shifted = lambda slope, f: [q + f * dt * s for q, s in zip(z, slope)]
    a = equations.rates_python(z, u)
    b = equations.rates_python(shifted(a, 0.5), u)
    c = equations.rates_python(shifted(b, 0.5), u)
    d = equations.rates_python(shifted(c, 1.0), u)
    return [q + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4) for q, k1, k2, k3, k4 in zip(z, a, b, c, d)]
