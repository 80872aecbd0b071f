"""The glossary is complete in itself: every entry has symbol, unit, meaning and a source that is listed; no term stands twice."""

import re
from pathlib import Path

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "glossary.md").read_text(encoding="utf-8")


def rows():
    for line in PAGE.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 5 and cells[0] != "term" and not set(cells[0]) <= {"-"}:
            yield cells


def test_every_entry_has_all_columns_and_a_listed_source():
    sources = set(re.findall(r"\*\*([^*]+)\*\*", PAGE))
    assert len(list(rows())) > 50
    for term, symbol, unit, meaning, source in rows():
        assert symbol and unit and meaning, term
        named = {part.strip() for part in source.split(",")}
        assert any(part.startswith(tuple(sources)) for part in named), (term, source)


def test_no_term_stands_twice():
    terms = [row[0] for row in rows()]
    assert len(terms) == len(set(terms))
