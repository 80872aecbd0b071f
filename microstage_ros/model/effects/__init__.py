"""Effects: what a real axis has and the nominal model lacks, each switched on by its id.

An effect is one class (`effect.Effect`) with all that is known of it; its docstring is its equation. A new one is one
file beside these and its name in `FILES`: simulation, checks, diagnosis, reports and campaigns have it from there.
"""

from microstage_ros.model.effects import (
    drive,
    electrical,
    environment,
    friction,
    piezo,
    position_sensors,
    sensing,
    stepper,
    voice_coil,
)
from microstage_ros.model.plant_record import EXTRA, EXTRAS
from microstage_ros.quantities.errors import InputError

FILES = (friction, drive, electrical, sensing, environment, voice_coil, stepper, piezo, position_sensors)
REGISTRY = {effect.id: effect for file in FILES for effect in file.EFFECTS}
WITH_FORCE = tuple(effect for effect in REGISTRY.values() if effect.force is not None)
if len(WITH_FORCE) > EXTRAS:
    raise ImportError(f"{len(WITH_FORCE)} effects with a force of their own; plant_record.EXTRAS has room for {EXTRAS}")


def effects_of(axis):
    """Ids of the effects that an axis with this drive and position sensor can have, sorted."""
    return sorted(name for name, effect in REGISTRY.items() if effect.acts_on(axis))


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
            if effect.force is not None:
                _add_force(plant, effect, effects[name])


def _add_force(plant, effect, given):
    """Switch a force on the stage on: its parameters into the effect's own place of the record."""
    place, values = WITH_FORCE.index(effect), [given[name] for name in effect.parameters]
    if len(values) > EXTRA or any(isinstance(value, list) for value in values):
        raise InputError(f"effects: {effect.id}", values, f"at most {EXTRA} single numbers")
    plant["extra"][place, : len(values)], plant["extra_on"][place] = values, 1
    plant["smooth"] = 1
    plant["base_level"] = max(plant["base_level"], 2)
