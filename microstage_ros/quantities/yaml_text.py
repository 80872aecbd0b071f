"""YAML that people write, read with care: what means something else than it looks like is refused or left a text.

- a number to the base of sixty (``12:30:45`` is 45045 in YAML 1.1) stays a text, refused where a number is wanted;
- a key that stands twice is refused, where YAML lets the second one win;
- nesting, aliases and length are bounded, so that no file can stop the program or fill its memory.
"""

import re
from typing import Any

import yaml

from microstage_ros.quantities.errors import InputError

LONGEST = 20_000_000
"""Characters of a file."""

DEEPEST, MOST_NODES = 200, 1_000_000
"""Nesting, and entries with every alias written out."""

UNFIT = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)
"""What the loader raises for a value that has the form of a number or a date and is none."""

_BASE_60 = re.compile(r"^[-+]?[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?$")


class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Plain data as YAML's safe loader makes it, but for the exceptions at the top."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict:
        """A mapping whose keys stand once each, else `yaml.constructor.ConstructorError` with the key's place."""
        seen = set()
        for key, _ in getattr(node, "value", ()):
            name = (key.tag, key.value) if isinstance(key, yaml.ScalarNode) else None
            if name in seen and name != ("tag:yaml.org,2002:merge", "<<"):
                problem = f"the key {key.value!r} stands twice"
                raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
            seen |= {name} - {None}
        return super().construct_mapping(node, deep)

    def text_or_number(self, node: Any) -> Any:
        """A number, or the text of one to the base of sixty."""
        text = self.construct_scalar(node)
        if _BASE_60.match(text):
            return text
        return (self.construct_yaml_int if node.tag.endswith(":int") else self.construct_yaml_float)(node)


for _kind in ("int", "float"):
    Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", Loader.text_or_number)


def yaml_tree(text: str, place: str, expected: str = "valid YAML") -> Any:
    """Plain data of a YAML text.

    Parameters
    ----------
    text : str. place : where it stands, for messages. expected : what would be right.

    Raises
    ------
    InputError : no YAML, or beyond the bounds of this module.
    """
    if len(text) > LONGEST:
        raise InputError(place, f"{len(text)} characters", f"at most {LONGEST}")
    if _too_deep(text):
        raise InputError(place, "nested too deeply", f"{expected}, at most {DEEPEST} levels")
    try:
        tree = yaml.load(text, Loader)  # a safe loader
    except (yaml.YAMLError, *UNFIT) as error:
        raise InputError(place, " ".join(str(error).split())[:160] or type(error).__name__, expected) from None
    if not _small(tree):
        raise InputError(place, "aliases that repeat each other", f"{expected}, at most {MOST_NODES} entries")
    return tree


def _too_deep(text: str) -> bool:
    """True if the text nests deeper than `DEEPEST`, or looks so: counted before anything recursive reads it."""
    if text.count("[") + text.count("{") > DEEPEST:
        depth = 0
        for character in re.findall(r"[\[\]{}]", text):
            depth = depth + 1 if character in "[{" else max(depth - 1, 0)
            if depth > DEEPEST:
                return True
    return any(len(line) > DEEPEST and len(line) - len(line.lstrip(" \t-?")) > DEEPEST for line in text.splitlines())


def _small(tree: Any) -> bool:
    """False if the entries, aliases written out, are too many."""
    waiting, count = [tree], 0
    while waiting:
        node = waiting.pop()
        if isinstance(node, (dict, list, tuple, set)):
            entries = node.values() if isinstance(node, dict) else node
            count += len(entries)
            if count > MOST_NODES:
                return False
            waiting.extend(entries)
    return True
