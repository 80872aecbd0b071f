"""The glossary is complete in itself: every entry has symbol, unit, meaning and a source that is listed; no term stands twice."""

import collections
import io
import re
import tokenize
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
#: Words of our own that no name may contain any more: the glossary has the field's.
REFUSED = {"seldom", "woven", "glide", "stood", "jolt", "jolted", "desk", "sure", "apart", "room", "many", "give",
           "told"}
#: Where they may stand: an argument of the library `rich`.
REMAINING = {"quiet": 1}


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


def words_of_names():
    """How often each word stands in a name (between underscores) of the package's code."""
    found = collections.Counter()
    for path in (ROOT / "microstage_ros").rglob("*.py"):
        for token in tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline):
            if token.type == tokenize.NAME:
                found.update(token.string.lower().split("_"))
    return found


def test_words_of_our_own_do_not_come_back():
    found = words_of_names()
    assert not {word: found[word] for word in REFUSED if found[word]}
    assert not {word: found[word] for word, most in REMAINING.items() if found[word] > most}
