"""No number of the diagnosis is without provenance.

A constant says in its comment where it comes from: ``source:`` (physical), ``derived:`` (the formula) or ``calibrated by:``
(the command that writes it). What says none of these is a judgement. A number inside a function says it on its line or in a comment above it.
"""

import ast
import pathlib
import re

import pytest

import microstage_ros.diagnosis

FOLDER = pathlib.Path(microstage_ros.diagnosis.__file__).parent
SAYS = re.compile(r"\b(source|derived|calibrated by):")
PLAIN = (0, 1, 2, 3, 0.5)      # of formulas: halves, squares, differences
PACKAGES = ("selection", "prerequisites", "residuals", "preprocessing")


def is_number(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and not isinstance(node.value, bool) and node.value not in PLAIN


def said(lines, at):
    """Whether line ``at`` or the comment above it says where a number comes from."""
    above = lines[at - 2].strip() if at > 1 else ""
    return bool(SAYS.search(lines[at - 1]) or above.startswith("#") and SAYS.search(above))


def counts(source):
    """(constants without provenance, unnamed numbers in functions) of a module's source."""
    tree, lines = ast.parse(source), source.splitlines()
    named = unnamed = 0
    for node in tree.body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)):
            first = node.lineno - 1
            while first > 0 and lines[first - 1].startswith("#"):   # the comment above, however many lines it has
                first -= 1
            comment = " ".join(lines[first:node.end_lineno])
            named += any(map(is_number, ast.walk(node))) and not SAYS.search(comment)
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            unnamed += sum(not said(lines, number.lineno) for number in ast.walk(node) if is_number(number))
    return named, unnamed


def test_what_counts():
    source = "A = 5.0   # source: a book\n#: derived: 2 pi\nB = 6.28\nC = 7\nD = 1.0\n\n\ndef f(x):\n    return 2.0 * x + 17.0\n"
    assert counts(source) == (1, 1)
    inside = "def f(x):\n    # derived: a dozen\n    y = 12.0 * x\n    # a guess\n    return y + 17.0  # not y\n\n\ndef g():\n    return 8   # source: a book\n"
    assert counts(inside) == (0, 1)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_number_says_where_it_comes_from(package):
    found = {path.name: counts(path.read_text(encoding="utf-8")) for path in (FOLDER / package).rglob("*.py")}
    without = {name: numbers for name, numbers in found.items() if numbers != (0, 0)}
    assert len(found) > 5 and not without, f"(constants, numbers in functions) without source, derivation or calibration: {without}"
