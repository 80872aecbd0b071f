"""How validation draws the sizes of an effect at random: helpers of the effects' ``draw``.

Sizes are those that a person would call clearly visible on the paper's axis; ``strength`` scales them.
Where an effect is a function (of position, of time), a random smooth function is drawn and not the one
that the analysis fits.
"""

import numpy as np


def either_sign(generator, low, high):
    """A size between ``low`` and ``high`` [any unit], of either sign; same unit."""
    return float(generator.uniform(low, high) * generator.choice([-1.0, 1.0]))


def smooth_profile(generator, relative):
    """Friction factors over ±6 mm: a smooth random function of standard deviation ``relative`` [1].

    Returns the parameters ``positions_m`` [m] and ``factors`` [1] of `PositionDependentFriction`, 41 numbers each.
    """
    x = np.linspace(-6e-3, 6e-3, 41)
    wave = sum(generator.normal() * np.sin(2 * np.pi * x / length + generator.uniform(0, 2 * np.pi))
               for length in generator.uniform(0.8e-3, 6e-3, 6))
    wave *= relative / wave.std()
    return {"positions_m": x.tolist(), "factors": np.clip(1.0 + wave, 0.3, 2.0).tolist()}
