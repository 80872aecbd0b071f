"""The candidates: one file per family, one line per form; an effect may bring forms of its own
(`effects.Effect.forms`)."""

from microstage_ros.diagnosis.catalogue import command, drive, electrical, friction, generic, measuring
from microstage_ros.model.effects import REGISTRY

FORMS = tuple(form for family in (command, friction, drive, electrical, measuring, generic) for form in family.FORMS)
FORMS += tuple(form for effect in REGISTRY.values() for form in effect.forms)


def forms_of(channel):
    """All forms that show in the channel of this name."""
    return tuple(form for form in FORMS if form.channel == channel)


#: Shapes without a name that hold a named one: what they explain beyond it is not that cause.
WIDER = {effect.id: effect.within for effect in REGISTRY.values() if effect.within}

#: A wider effect that contains a simpler one and so always fits as well: no rival of it.
CONTAINS = {effect.id: effect.contained_in for effect in REGISTRY.values() if effect.contained_in}
