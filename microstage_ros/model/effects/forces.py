"""Forces on the stage that effects bring, each compiled from the effect's own file (`model.effects.WITH_FORCE`)."""

from microstage_ros.model.effects import WITH_FORCE
from microstage_ros.numerics.compiled import internal


@internal
def _none(plant, x, v, t):
    return 0.0


def _and(before, force, place):
    """The sum of what ``before`` gives and of one effect's force, where it is switched on."""
    @internal
    def total(plant, x, v, t):
        found = before(plant, x, v, t)
        if plant.extra_on[place] == 1:
            found += force(plant.extra[place], x, v, t)
        return found

    return total


effect_force = _none
"""``effect_force(plant, x, v, t)`` → N on the stage, at position x [m], velocity v [m/s], time t [s]."""
for _place, _effect in enumerate(WITH_FORCE):
    effect_force = _and(effect_force, _effect.force, _place)
