"""Axis files: the numbers of one machine, each with its unit and where it comes from.

A leaf is ``{value, unit, source, stderr?, tolerance?}`` (`quantities.quantity`); ``type``, ``law``, ``reading`` and
``name`` are words; ``effects`` and ``controller`` are sections of their own (see `model.effects` and `control`).
Everything is SI. Unknown keys, missing units and values out of range are refused with the file,
the key and the value.
"""

import copy
import pathlib

import yaml

from microstage_ros.files import read_yaml, write_text
from microstage_ros.model import schema
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.quantity import Quantity, quantity_from

FORMAT = 1
WORDS = ("type", "law", "reading")
FREE_SECTIONS = ("format", "name", "effects", "controller", "provenance")


class Axis:
    """One machine: choices (types, laws), quantities by dotted key, effects, controller.

    Immutable in use: `with_values` and `with_effects` return new axes.
    """

    machine = None
    """The `Axis` that simulations for this one run on where it is another one (`simulated_on`)."""

    def __init__(self, name, choices, quantities, effects=None, controller=None, provenance=None, place="axis"):
        self.name = name
        self.choices = dict(choices)
        self.quantities = dict(quantities)
        self.effects = copy.deepcopy(effects or {})
        self.controller = copy.deepcopy(controller or {})
        self.provenance = copy.deepcopy(provenance or {})
        self.place = place
        specs = schema.leaf_specs(self.choices, place)
        for key, spec in specs.items():
            if key not in self.quantities:
                if spec.default is None:
                    raise InputError(f"{place}: {key}", None, f"a value in {spec.unit} ({spec.meaning})")
                self.quantities[key] = Quantity(spec.default, spec.unit, "estimate")
        _check_lists(self)

    def quantity(self, key):
        """The quantity at a dotted key such as ``drive.resistance``; InputError if there is none."""
        if key not in self.quantities:
            raise InputError(f"{self.place}: {key}", None, "one of " + ", ".join(sorted(self.quantities)))
        return self.quantities[key]

    def value(self, key):
        """SI value (float, or list of floats) at a dotted key."""
        return self.quantity(key).value

    def has(self, key):
        """Whether this machine has the quantity."""
        return key in self.quantities

    def law(self, contact):
        """Friction law of a contact: ``actuator`` or ``guideway``."""
        return self.choices.get(f"contacts.{contact}.law", "none")

    def with_values(self, values, source="identified", stderr=None):
        """A copy with other ``values`` {dotted key: number or list, SI}; units stay.

        ``stderr``: standard uncertainties by the same keys, SI.
        """
        quantities = dict(self.quantities)
        specs = schema.leaf_specs(self.choices, self.place)
        for key, value in values.items():
            old = self.quantity(key)
            value = value.tolist() if hasattr(value, "tolist") else value
            value = specs[key].check(value, f"{self.place}: {key}")
            spread = (stderr or {}).get(key)
            if spread is not None:
                spread = [float(v) for v in spread] if hasattr(spread, "__len__") else float(spread)
            quantities[key] = Quantity(value, old.unit, source, spread)
        return Axis(self.name, self.choices, quantities, self.effects, self.controller, self.provenance, self.place)

    def with_effects(self, effects):
        """A copy whose ``effects`` section is exactly ``effects`` ({id: {parameter: value}})."""
        from microstage_ros.model.effects import check_effects

        checked = check_effects(effects, f"{self.place}: effects")
        return Axis(self.name, self.choices, self.quantities, checked, self.controller, self.provenance, self.place)

    def with_controller(self, controller):
        """A copy with another shipped tuning ({type: ..., gains})."""
        return Axis(self.name, self.choices, self.quantities, self.effects, controller, self.provenance, self.place)

    def simulated_on(self, machine):
        """A copy for a controller whose simulated machine is the `Axis` ``machine``."""
        copied = Axis(self.name, self.choices, self.quantities, self.effects, self.controller, self.provenance,
                      self.place)
        copied.machine = machine
        return copied

    def as_dict(self):
        """The whole file as plain Python data."""
        tree = {"format": FORMAT, "name": self.name}
        for key, word in self.choices.items():
            _put(tree, key, word)
        for key, quantity in self.quantities.items():
            _put(tree, key, quantity.as_dict())
        tree["controller"] = copy.deepcopy(self.controller)
        tree["effects"] = copy.deepcopy(self.effects)
        if self.provenance:
            tree["provenance"] = copy.deepcopy(self.provenance)
        return tree

    def save(self, path, provenance=None):
        """Write the axis file; ``provenance`` (version, records, seed) is stored beside the numbers."""
        tree = self.as_dict()
        if provenance:
            tree["provenance"] = provenance
        write_text(path, yaml.safe_dump(tree, sort_keys=False, allow_unicode=True))


def load_axis(path):
    """Read and check an axis file. Returns `Axis`; raises InputError (file: key, value, expected)."""
    path = pathlib.Path(path)
    tree = read_yaml(path, "an axis file")
    return axis_from_dict(tree, str(path))


def axis_from_dict(tree, place="axis"):
    """`Axis` from plain data as `Axis.as_dict` gives it; same checks as `load_axis`.

    Raises InputError: an unknown key, a missing or impossible value; place, value and what would be right.
    """
    if not isinstance(tree, dict):
        raise InputError(place, tree, "a mapping of sections")
    if tree.get("format") != FORMAT:
        raise InputError(f"{place}: format", tree.get("format"), f"{FORMAT}")
    if "components" in tree:
        raise InputError(f"{place}: components", ", ".join(map(str, tree["components"])),
                         "an axis of one component; simulate, identify and diagnose take two; else give one of them")
    choices, leaves = {}, {}
    for section, body in tree.items():
        if section not in FREE_SECTIONS:
            _collect(body, str(section), choices, leaves, place)
    specs = schema.leaf_specs(choices, place)
    quantities = {key: quantity_from(leaf, _known(key, specs, place), f"{place}: {key}")
                  for key, leaf in leaves.items()}
    for key in choices:
        if key.split(".")[-1] not in WORDS:
            raise InputError(f"{place}: {key}", choices[key], "a leaf {value, unit, source}")
    from microstage_ros.model.effects import check_effects

    effects = check_effects(tree.get("effects") or {}, f"{place}: effects")
    controller = tree.get("controller") or {}
    if not isinstance(controller, dict):
        raise InputError(f"{place}: controller", controller, "a mapping with a type and its gains")
    return Axis(str(tree.get("name", place)), choices, quantities, effects, controller, tree.get("provenance"), place)


def _collect(node, key, choices, leaves, place):
    if not isinstance(node, dict):
        choices[key] = node
    elif "value" in node or "unit" in node:
        leaves[key] = node
    else:
        for name, child in node.items():
            _collect(child, f"{key}.{name}", choices, leaves, place)


def _known(key, specs, place):
    if key not in specs:
        prefix = key.rsplit(".", 1)[0]
        near = [k for k in specs if k.startswith(prefix.split(".")[0])]
        raise InputError(f"{place}: {key}", "unknown key", "one of " + ", ".join(sorted(near or specs)))
    return specs[key]


def _check_lists(axis):
    for contact in schema.ANGULAR:
        key = f"contacts.{contact}"
        if f"{key}.weight" not in axis.quantities:
            continue
        k, alpha = axis.value(f"{key}.stiffness"), axis.value(f"{key}.weight")
        if len(k) != len(alpha) or not 1 <= len(k) <= 8:
            raise InputError(f"{axis.place}: {key}.weight", len(alpha),
                             f"as many weights as stiffnesses ({len(k)}), 1 … 8")
        reading = axis.choices.get(f"{key}.reading", "blocks")
        if reading not in schema.READINGS:
            raise InputError(f"{axis.place}: {key}.reading", reading, "one of " + ", ".join(schema.READINGS))
        if reading == "segment_slopes" and any(a <= b for a, b in zip(k, k[1:])):
            raise InputError(f"{axis.place}: {key}.stiffness", k, "falling segment slopes K_1 > K_2 > …")
    low, high = axis.value("travel.minimum"), axis.value("travel.maximum")
    if not low < high:
        raise InputError(f"{axis.place}: travel.maximum", high, f"more than travel.minimum = {low} m")


def _put(tree, key, leaf):
    *sections, last = key.split(".")
    for section in sections:
        tree = tree.setdefault(section, {})
    tree[last] = leaf
