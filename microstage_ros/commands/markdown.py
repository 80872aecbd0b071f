"""Pieces of a Markdown page that a command writes from the sources: docstrings, rows of a table."""

import re


def plain(text):
    """A docstring on one line."""
    return " ".join(text.split())


def without_roles(text):
    """Sphinx roles as Markdown code: the last part of the name they point to."""
    return re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"`\1`", text).replace("``", "`")


def without_blank_runs(text):
    """At most one empty line in a row, one newline at the end."""
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"


def grid(columns, rows):
    """Lines of a Markdown table; ``columns``: heads, shape (n,); ``rows``: cells, each of shape (n,)."""
    return ["| " + " | ".join(line) + " |" for line in (columns, ["---"] * len(columns), *rows)]
