"""A reader of the pages: a folder like a clone, a ROS domain of its own."""

import sys
from pathlib import Path

import pytest
from page_blocks import Reader
from page_material import clone

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "ros"))

from ros_support import own_domain  # noqa: E402


@pytest.fixture
def reader(tmp_path):
    """Someone with a fresh clone, who tries what a page says."""
    with own_domain():
        someone = Reader(clone(tmp_path))
        yield someone
        someone.close()
