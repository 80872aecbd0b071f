"""A reader of the pages: a folder like a clone; one ROS domain, and one plain cell, for all pages of a file of tests."""

import sys
from pathlib import Path

import pytest
from page_blocks import Cells, Reader
from page_material import clone

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "ros"))

from ros_support import own_domain  # noqa: E402


@pytest.fixture(scope="module")
def cells():
    """The cell that pages share, in a domain of its own."""
    with own_domain():
        shared = Cells()
        try:
            yield shared
        finally:
            shared.close()


@pytest.fixture
def reader(tmp_path, cells):
    """Someone with a fresh clone, who tries what a page says."""
    someone = Reader(clone(tmp_path), cells)
    try:
        yield someone
    finally:
        someone.close()
