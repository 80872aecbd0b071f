"""Every code block of README and docs runs as printed, page by page, in the order of the page."""

import sys
from pathlib import Path

import pytest
from page_blocks import LANGUAGES, PAGES, REASONS, ROOT, blocks
from page_material import provide

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "report"))

from browser import check_pages  # noqa: E402

FIRST = ("docs/tutorial.md", "docs/watching.md", "docs/howto.md")
"""Pages that share a cell, one after the other."""


SHOWN = {"README.md": {"mine.html", "answer/report.html"}, "docs/tutorial.md": {"demo/report.html"},
         "docs/logs.md": {"first/report.html", "answer/report.html"}}
"""The pages for people that the blocks of a page of the documents make."""


def name(page):
    """How a page is called in the tests' names."""
    return page.relative_to(ROOT).as_posix()


def order(page):
    """The pages that share a cell first."""
    return FIRST.index(name(page)) if name(page) in FIRST else len(FIRST)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=name)
def test_every_block_says_what_it_is(page):
    for block in blocks(page):
        assert block.language in LANGUAGES, f"{name(page)}, line {block.line}: a block of which language?"
        assert set(block.reasons) <= set(REASONS), f"{name(page)}, line {block.line}: {block.reason}"


@pytest.mark.parametrize("page", sorted((page for page in PAGES if blocks(page)), key=order), ids=name)
def test_page_runs_as_printed(page, reader):
    found = blocks(page)
    provide(reader.folder, page)
    reader.save_named(found)
    for block in found:
        if block.runs:
            reader.run(block)
    pages = [path for path in reader.folder.rglob("*.html") if not path.is_relative_to(reader.folder / "docs")]
    assert {path.relative_to(reader.folder).as_posix() for path in pages} == SHOWN.get(name(page), set())
    check_pages(pages)
