"""Effects: what a real axis has and the nominal model lacks, each switched on by its id.

One file per family, one line per effect in `REGISTRY`. An effect's docstring is its equation; its
`parameters` are the keys of its section in an axis file or a run file.
"""

from microstage_ros.model.effects import drive, electrical, environment, friction, sensing
from microstage_ros.quantities.errors import InputError

REGISTRY = {effect.id: effect for family in (friction, drive, electrical, sensing, environment) for effect in family.EFFECTS}


def check_effects(effects, place="effects"):
    """Check a section ``{id: {parameter: value}}`` and fill in defaults.

    Returns a new dict. Raises InputError for an unknown id or parameter, or a value out of range.
    """
    if not isinstance(effects, dict):
        raise InputError(place, effects, "a mapping of effect ids to their parameters")
    checked = {}
    for name, given in effects.items():
        if name not in REGISTRY:
            raise InputError(f"{place}: {name}", "unknown effect", "one of " + ", ".join(sorted(REGISTRY)))
        checked[name] = REGISTRY[name].check(given or {}, f"{place}: {name}")
    return checked


def apply_effects(plant, effects):
    """Write checked effects into a plant record (see `model.plant_record.PLANT`), in the registry's order.

    Raises InputError for an effect on something that the machine does not have.
    """
    for name, effect in REGISTRY.items():
        if name in effects:
            effect.check_machine(plant, effects[name])
            effect.apply(plant, effects[name])
