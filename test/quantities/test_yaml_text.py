"""YAML that people write: what means something else than it looks like, and what would stop the program, is refused."""

import time

import pytest

from microstage_ros.quantities.errors import InputError
from microstage_ros.quantities.yaml_text import yaml_tree

ALIASES = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefgh", "bcdefghi"))


def test_plain_data_is_as_ever():
    text = "{a: 1, b: 2.5e-3, c: [x, null, true], d: -0x1F, e: .nan}"
    tree = yaml_tree(text, "here")
    assert tree["a"] == 1 and tree["b"] == 2.5e-3 and tree["c"] == ["x", None, True] and tree["d"] == -31 and tree["e"] != tree["e"]
    assert yaml_tree("base: &b {x: 1}\nmore: {<<: *b, y: 2}", "here")["more"] == {"x": 1, "y": 2}


@pytest.mark.parametrize("text", ["12:30:45", "-1:30", "1:30.5"])
def test_a_number_to_the_base_of_sixty_stays_a_text(text):
    assert yaml_tree(f"cycles: {text}", "here") == {"cycles": text}


@pytest.mark.parametrize("text", [
    "a: 1\na: 2\n", "[" * 100_000, "{a: " * 5000, "- " * 5000 + "x", "".join(f"{' ' * k}k:\n" for k in range(5000)), ALIASES,
    "a: &a [*a]", f"a: {'9' * 5000}", "a: 2020-13-45", "a: !!python/object:os.system {}", "\x00", "a: b: c", "*no",
    "? [1, 2]\n: 3", "{[1]: 2}"])
def test_what_is_refused_is_refused_in_one_line_and_at_once(text):
    began = time.monotonic()
    with pytest.raises(InputError, match="here") as caught:
        yaml_tree(text, "here")
    assert time.monotonic() - began < 5.0 and len(str(caught.value)) < 400
