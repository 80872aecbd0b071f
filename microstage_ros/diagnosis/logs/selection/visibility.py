"""Which effects a log's signals can show: the smallest detectable size of each against the largest usual one.

With the information I that the difference carries on a size (its covariance known to ν degrees of freedom), the
smallest size that is found with probability 1 − β at a level α is (t_ν(1 − α/2) + t_ν(1 − β)) / √I.
Source: ISO 11843-1, capability of detection.
"""

import numpy as np
from scipy.stats import t as t_distribution

#: log p below which an effect is named: of the healthy machines one in sixty may alarm, over the six or seven ways,
#: hardly dependent on one another, in which some twenty effects can show (held by
#: `microstage log --examine N --kind healthy`).
LEVEL = np.log(1.0 / 400.0)
MISSED = 0.1               # share of effects of the detectable size that go unseen (ISO 11843: capability of detection)
ORDERLESS = 0.7            # largest log roughness that counts as visible where the sampling does not resolve the ripple
#: Largest size (of `Size.value`) that counts as visible; beyond it an effect counts as not visible in these signals.
LARGEST = {"level": 0.6, "viscous": 0.8, "quadratic": 0.8, "moving": 0.5, "constant": 0.8, "spring": 0.8, "waves": 0.8,
           "inertia": 1.0, "breakaway": 0.6, **{f"{name} in error": 0.8 for name in (
               "friction", "viscous", "quadratic", "asymmetry", "constant", "spring", "waves", "inertia")},
           "lost motion": 3.0, "speed": 3.0, "acceleration": 3.0, "place": 2.0, "creep": 1.0, "gain": 0.6, "load": 3.0,
           "dead zone": 0.8, "resistive": 0.8, "ripple": 0.6, "ripple high": 0.6, "rough": 1.8}


def visibility(problem, largest_of=None):
    """{id: (visible, smallest detectable size, column name, largest usual size)} of every effect that has columns.

    The size is that which is found nine times of ten. ``largest_of``: usual sizes by column in place of those of
    `LARGEST`, where a quantity of another kind bounds them.
    """
    out = {}
    for name, white in problem.white.items():
        if name.endswith("+"):
            continue
        info = float(np.max((white**2).sum(axis=0)))
        alarm, miss = t_distribution.isf([0.5 * np.exp(LEVEL), MISSED], problem.dof)
        size = float(alarm + miss) / np.sqrt(max(info, 1e-300))
        size *= np.sqrt(max(problem.inflation.get(name, 1.0), 1.0))
        part = problem.parts[name][0]
        largest = (largest_of or {}).get(part, LARGEST.get(part, 0.8))
        if name == "torque_ripple" and "ripple high" not in problem.parts[name]:
            largest = ORDERLESS if part == "rough" else largest
        # fewer than ten rows per turn: most cogging is of higher order and would not show
        unresolved = name == "torque_ripple" and part == "ripple" and "ripple high" not in problem.parts[name]
        out[name] = (bool(size < largest) and not unresolved, size, part, largest)
    return out
