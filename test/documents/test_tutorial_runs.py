"""Every code block of docs/tutorial.md runs as printed."""

from page_blocks import ROOT
from test_pages_run import try_page


def test_runs_as_printed(reader):
    try_page(ROOT / "docs/tutorial.md", reader)
