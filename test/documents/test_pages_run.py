"""Every code block of README and docs runs as printed, page by page, in the order of the page."""

import pytest
from page_blocks import LANGUAGES, PAGES, REASONS, ROOT, blocks
from page_material import provide

OWN_FILE = ("README.md", "tutorial.md")
"""Pages whose blocks take longest: files of tests of their own, so that they run beside the others."""


def name(page):
    """How a page is called in the tests' names."""
    return page.relative_to(ROOT).as_posix()


def try_page(page, reader):
    """Run all blocks of a page."""
    found = blocks(page)
    provide(reader.folder, page)
    reader.save_named(found)
    for block in found:
        if block.runs:
            reader.run(block)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=name)
def test_every_block_says_what_it_is(page):
    for block in blocks(page):
        assert block.language in LANGUAGES, f"{name(page)}, line {block.line}: a block of which language?"
        assert set(block.reasons) <= set(REASONS), f"{name(page)}, line {block.line}: {block.reason}"


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page) and page.name not in OWN_FILE], ids=name)
def test_page_runs_as_printed(page, reader):
    try_page(page, reader)
