"""Parameters of a node from one YAML file, the only source of name, type, unit, range, default and description.

    mode: {type: string, default: lockstep, one_of: [lockstep, paced], description: how time passes}
    seed: {type: integer, default: 1, minimum: 0, maximum: 4294967295, description: of the simulated axis}

`fixed: true`: read once when the node starts; a later change is refused.
"""

import yaml
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.parameter import Parameter

from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.spec import INF, Spec
from microstage_ros.quantities.yaml_text import yaml_tree

LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times as fast where PyYAML was built with it
TYPES = {"string": str, "integer": int, "double": float, "bool": bool, "string_array": list}
KINDS = {"string": Parameter.Type.STRING, "integer": Parameter.Type.INTEGER, "double": Parameter.Type.DOUBLE,
         "bool": Parameter.Type.BOOL, "string_array": Parameter.Type.STRING_ARRAY}


def definitions(node_name):
    """The parameters of a node: name to entry of ``config/<node_name>.yaml``."""
    return yaml.load(config_file(f"{node_name}.yaml").read_text(encoding="utf-8"), LOADER)


def why_refused(name, entry, value):
    """The reason why ``value`` [its own unit] is no good for parameter ``name``, in words; empty where it is good."""
    kind = TYPES[entry["type"]]
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        return f"{name}: got {value!r}, expected {_expected(entry)}"
    if kind in (int, float):
        try:
            Spec(entry.get("unit", "1"), entry.get("minimum", -INF), entry.get("maximum", INF), name).check(value, name)
        except InputError:
            return f"{name}: got {value!r}, expected {_expected(entry)}"
    if "one_of" in entry and value not in entry["one_of"]:
        return f"{name}: got {value!r}, expected {_expected(entry)}"
    return ""


def _expected(entry):
    unit = f" {entry['unit']}" if entry.get("unit", "1") != "1" else ""
    if "one_of" in entry:
        return "one of " + ", ".join(str(choice) or '""' for choice in entry["one_of"])
    if "minimum" in entry:
        return f"{entry['type']} from {entry['minimum']} to {entry['maximum']}{unit}"
    return entry["type"] + unit


def _descriptor(name, entry):
    unit = f" [{entry['unit']}]" if "unit" in entry else ""
    descriptor = ParameterDescriptor(
        name=name,
        description=entry["description"] + unit,
        read_only=False,
        additional_constraints="one of " + ", ".join(str(choice) or '""' for choice in entry["one_of"])
        if "one_of" in entry
        else "",
    )
    if "minimum" in entry and entry["type"] == "double":
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(entry["minimum"]),
                                                              to_value=float(entry["maximum"]))]
    elif "minimum" in entry and entry["type"] == "integer":
        descriptor.integer_range = [IntegerRange(from_value=entry["minimum"], to_value=entry["maximum"])]
    return descriptor


class Parameters:
    """Declared parameters of a node as attributes.

    Parameters
    ----------
    node : rclpy node. name : of the YAML file. changed : called with (name, value) after an accepted change at
        run time; it may raise `InputError` to refuse it with a reason.

    Raises
    ------
    InputError : a bad value given at the start (file or command line).
    """

    def __init__(self, node, name, changed=None):
        self._entries = definitions(name)
        self._values = {}
        self._changed = changed
        for key, entry in self._entries.items():
            try:
                value = node.declare_parameter(key, Parameter(key, KINDS[entry["type"]], entry["default"]).value,
                                               _descriptor(key, entry)).value
            except Exception as error:  # noqa: BLE001 - rclpy has one exception class per way of being wrong
                raise InputError(f"{name}: parameter {key}", _first_line(error), _expected(entry)) from None
            reason = why_refused(key, entry, value)
            if reason:
                raise InputError(f"{name}: parameter {key}", value, _expected(entry))
            self._values[key] = value
        node.add_on_set_parameters_callback(self._on_set)

    def __getattr__(self, key):
        try:
            return self._values[key]
        except KeyError:
            raise AttributeError(key) from None

    def _on_set(self, parameters):
        for parameter in parameters:
            entry = self._entries.get(parameter.name)
            if entry is None:
                continue
            reason = why_refused(parameter.name, entry, parameter.value)
            if not reason and entry.get("fixed"):
                reason = f"{parameter.name}: is read when the node starts; restart the node to change it"
            if not reason and self._changed is not None:
                try:
                    self._changed(parameter.name, parameter.value)
                except InputError as error:
                    reason = str(error)
            if reason:
                return SetParametersResult(successful=False, reason=reason)
            self._values[parameter.name] = parameter.value
        return SetParametersResult(successful=True)


def yaml_mapping(place, text, example):
    """The mapping that a text parameter holds as YAML. Raises `InputError`, which shows ``example``."""
    found = yaml_tree(text, place, f"YAML such as {example}") or {}
    if not isinstance(found, dict):
        raise InputError(place, text, f"YAML such as {example}")
    return found


def _first_line(error):
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
