"""Every code block of README.md runs as printed."""

from page_blocks import ROOT
from test_pages_run import try_page


def test_runs_as_printed(reader):
    try_page(ROOT / "README.md", reader)
