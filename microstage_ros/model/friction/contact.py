"""The friction contact of an axis file, as what is built on it needs it: limit, blocks, parameters of the law.

The only place that reads a contact's section: solver, feed-forward, observer, identification and diagnosis ask here.
"""

import math

import numpy as np

from microstage_ros.model.friction.blocks import blocks_from_segment_slopes
from microstage_ros.model.friction.equivalent import equivalent_blocks
from microstage_ros.model.friction.registry import LAWS, law_named

# m of travel within which the one block of Coulomb friction gives way: a twenty-fifth of a count
RIGID_SLIP = 1.0e-9
OTHER_LAWS = tuple(law.name for law in LAWS if law.family == "own")
RIGID_LAWS = tuple(name for law in LAWS if law.family == "rigid"
                   for name in (law.name, *getattr(law.file, "BESIDE", {})))
BLOCK_LAWS = tuple(law.name for law in LAWS if "weight" in law.file.PARAMETERS)    # a virgin curve tells their blocks


def blocks_of(axis, name):
    """Maxwell-slip blocks of a contact: k_j [N m/rad, guideway: N/m], α_j [1], both (n,), Σα = 1, whatever its law.

    Of a law that is not made of blocks: those that follow its first loading (`model.friction.equivalent`); of Coulomb
    friction: one that gives way within `RIGID_SLIP`.

    A file's ``segment_slopes`` are turned into blocks (`blocks.blocks_from_segment_slopes`).
    """
    key, law = f"contacts.{name}", axis.law(name)
    if law in RIGID_LAWS:
        way = RIGID_SLIP if name == "guideway" else RIGID_SLIP * 2.0 * math.pi / axis.value("transmission.pitch")
        return np.array([limit_of(axis, name) / way]), np.ones(1)
    if law in OTHER_LAWS:
        return equivalent_blocks(law, law_values(axis, name))
    k, alpha = (np.array(axis.value(f"{key}.{leaf}"), float) for leaf in ("stiffness", "weight"))
    if axis.choices.get(f"{key}.reading", "blocks") == "segment_slopes":
        return blocks_from_segment_slopes(k, alpha, axis.value(f"{key}.static"))
    return k, alpha / alpha.sum()


def limit_of(axis, name):
    """Largest friction of a contact at the start of sliding, F_s.

    The Coulomb level where a law has no other [N m or N].
    """
    static = f"contacts.{name}.static"
    return axis.value(static if axis.has(static) else f"contacts.{name}.coulomb")


def law_values(axis, name):
    """Parameters of a contact with a law of `OTHER_LAWS`, as `model.friction.registry.FrictionLaw.pack` takes them."""
    key = f"contacts.{name}"
    return {leaf: axis.value(f"{key}.{leaf}") for leaf in law_named(axis.law(name)).keys() if axis.has(f"{key}.{leaf}")}
