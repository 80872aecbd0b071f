"""No table of the documentation is older than the code that it is about without saying so."""

import pathlib

import pytest

from microstage_ros.commands.project.figures import TABLES, main
from microstage_ros.quantities.errors import InputError
from microstage_ros.report.stamped import MARK, Table, digest, is_stale, mark_stale, read_stamp, write_table

ROOT = pathlib.Path(__file__).resolve().parents[1]


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.name)
def test_every_table_is_fresh_or_says_that_it_is_not(table):
    stamp = read_stamp(ROOT, table)
    assert stamp.version and stamp.machine
    assert stamp.marked or not is_stale(ROOT, table), (
        f"{table.page}: the code that table {table.name} is about has changed; `./microstage figures {table.name}` makes it anew, "
        f"`./microstage figures --mark {table.name}` tells its reader")


@pytest.fixture
def checkout(tmp_path):
    """A checkout with one module and one page with one table."""
    (tmp_path / "microstage_ros" / "part").mkdir(parents=True)
    (tmp_path / "microstage_ros" / "part" / "a.py").write_text("x = 1\n")
    (tmp_path / "page.md").write_text('before\n<!-- figures: one version=0 code=0 made=never machine="?" -->\nold\n<!-- end of figures: one -->\nafter\n')
    return tmp_path, Table("one", "page.md", "nowhere:nothing", ("part",))


def test_a_table_goes_stale_with_its_code_and_only_with_it(checkout):
    root, table = checkout
    write_table(root, table, "| new |")
    text = (root / "page.md").read_text()
    assert text.startswith("before\n") and text.endswith("<!-- end of figures: one -->\nafter\n") and "old" not in text and "| new |" in text
    assert not is_stale(root, table)
    (root / "microstage_ros" / "other.py").write_text("y = 1\n")
    assert not is_stale(root, table)
    (root / "microstage_ros" / "part" / "a.py").write_text("x = 2\n")
    assert is_stale(root, table) and not read_stamp(root, table).marked
    mark_stale(root, table)
    mark_stale(root, table)
    assert read_stamp(root, table).marked and (root / "page.md").read_text().count(MARK.format(name="one")) == 1
    write_table(root, table, "| newer |")
    assert not read_stamp(root, table).marked and not is_stale(root, table)


def test_a_new_file_in_a_folder_counts(checkout):
    root, table = checkout
    before = digest(root, table.code)
    (root / "microstage_ros" / "part" / "b.py").write_text("")
    assert digest(root, table.code) != before


def test_missing_comments_are_told(checkout):
    root, table = checkout
    with pytest.raises(InputError, match="no figures: two"):
        read_stamp(root, Table("two", "page.md", "m:f", ("part",)))
    (root / "page.md").write_text('<!-- figures: one version=0 code=0 made=never machine="?" -->\n')
    with pytest.raises(InputError, match="has no end"):
        read_stamp(root, table)


def test_an_unknown_table_is_one_line():
    with pytest.raises(InputError, match="one of campaign"):
        main(["no-such-table"])
