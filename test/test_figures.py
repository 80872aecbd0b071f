"""No table of the documentation is older than the code that it is about without saying so."""

import json
import pathlib

import pytest

from microstage_ros.commands import tables
from microstage_ros.commands.project import first_day
from microstage_ros.commands.project.figures import CONTROL_PAGES, RUNS, main, state_of
from microstage_ros.commands.tables import CODE, code_of, command_of, update_tables
from microstage_ros.quantities.errors import InputError
from microstage_ros.report.stamped import OPENING, UNKNOWN, Stamp, digest, find_table, is_stale, mark_stale, read_tables, stamp_now, write_table

ROOT = pathlib.Path(__file__).resolve().parents[1]
PAGES = sorted(page.relative_to(ROOT).as_posix() for page in [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"] if OPENING.search(page.read_text()))
TABLES = [(page, table.owner, table.title) for page in PAGES for table in read_tables(ROOT / page)]


@pytest.mark.parametrize("page, owner, title", TABLES, ids=[f"{owner}-{title}" for _, owner, title in TABLES])
def test_every_table_is_fresh_or_says_that_it_is_not(page, owner, title):
    state = state_of(ROOT, find_table(ROOT / page, owner, title))
    assert not state.endswith("does not say so"), (
        f"{page}: the code that this table is about has changed; `{command_of(owner, title)}` measures it anew, `./microstage figures --mark` tells its reader")


def test_every_page_with_tables_is_measured_by_a_run_and_every_owner_has_its_code():
    assert {page for run in RUNS.values() for page in run.pages} == set(PAGES)
    assert all(digest(ROOT, code) for code in {code_of(owner, title) for _, owner, title in TABLES})
    assert all(command_of(owner, title).split()[-1] in RUNS for _, owner, title in TABLES)
    assert set(CONTROL_PAGES) <= set(PAGES) and CODE


PAGE = "before\n<!-- compare: one -->\nold\n<!-- end -->\nbetween\n<!-- compare: two -->\nother\n<!-- end -->\nafter\n"
CODE_ABOUT = ("part",)


@pytest.fixture
def checkout(tmp_path):
    """A checkout with one module and one page of two tables that nobody has stamped."""
    (tmp_path / "microstage_ros" / "part").mkdir(parents=True)
    (tmp_path / "microstage_ros" / "part" / "a.py").write_text("x = 1\n")
    (tmp_path / "page.md").write_text(PAGE)
    return tmp_path


def test_a_table_goes_stale_with_its_code_and_only_with_it(checkout):
    page, module = checkout / "page.md", checkout / "microstage_ros" / "part" / "a.py"

    def one():
        return find_table(page, "compare", "one")

    assert one().stamp == UNKNOWN and is_stale(checkout, one(), CODE_ABOUT)
    write_table(page, "compare", "one", "| new |", stamp_now(checkout, CODE_ABOUT))
    text = page.read_text()
    assert text.startswith("before\n") and text.endswith("<!-- compare: two -->\nother\n<!-- end -->\nafter\n")
    assert one().body == "| new |\n" and not is_stale(checkout, one(), CODE_ABOUT)
    (checkout / "microstage_ros" / "other.py").write_text("y = 1\n")
    assert not is_stale(checkout, one(), CODE_ABOUT)
    module.write_text("x = 2\n")
    assert is_stale(checkout, one(), CODE_ABOUT) and not one().says_that_it_is_stale("make it")
    for _ in range(2):
        mark_stale(checkout, page, one(), CODE_ABOUT, "make it")
    assert one().says_that_it_is_stale("make it") and page.read_text().count("make it") == 1
    mark_stale(checkout, page, one(), CODE_ABOUT, "make it otherwise")
    assert one().says_that_it_is_stale("make it otherwise") and "make it`" not in page.read_text()
    write_table(page, "compare", "one", "| newer |", stamp_now(checkout, CODE_ABOUT))
    assert "make it" not in page.read_text() and not is_stale(checkout, one(), CODE_ABOUT)


def test_only_what_the_code_does_counts(checkout):
    module = checkout / "microstage_ros" / "part" / "a.py"
    before = digest(checkout, CODE_ABOUT)
    module.write_text('"""What it is."""\n\nx = (\n    1\n)  # why\n')
    assert digest(checkout, CODE_ABOUT) == before
    module.write_text('x = 1\n\n\ndef f():\n    """Two."""\n    return 2\n')
    with_function = digest(checkout, CODE_ABOUT)
    module.write_text('x = 1\n\n\ndef f():\n    """Two, that is to say."""\n    return 2\n')
    assert digest(checkout, CODE_ABOUT) == with_function != before
    module.write_text("x = 1\n\n\ndef f():\n    return 3\n")
    assert digest(checkout, CODE_ABOUT) != with_function


def test_a_new_file_in_a_folder_counts(checkout):
    before = digest(checkout, CODE_ABOUT)
    (checkout / "microstage_ros" / "part" / "b.py").write_text("")
    assert digest(checkout, CODE_ABOUT) != before


def test_missing_comments_are_named(checkout):
    page = checkout / "page.md"
    with pytest.raises(InputError, match="no <!-- compare: three -->"):
        find_table(page, "compare", "three")
    page.write_text("<!-- compare: one -->\n")
    with pytest.raises(InputError, match="page.md: .*compare: one.*no <!-- end -->"):
        update_tables([page], [("one", ["a"], [["1"]], "")], "compare")


def test_a_command_replaces_those_of_its_tables_that_stand_in_a_page(checkout):
    page = checkout / "page.md"
    update_tables([page], [("two", ["head"], [["cell"]], "A remark."), ("three", ["head"], [["cell"]], "")], "compare")
    table = find_table(page, "compare", "two")
    assert "| head |\n|---|\n| cell |\n\nA remark.\n" in table.body
    assert table.stamp.code == digest(ROOT, code_of("compare", "two"))
    assert "old" in find_table(page, "compare", "one").body and "three" not in page.read_text()


def test_an_unknown_name_is_one_line():
    with pytest.raises(InputError, match="one of first-world"):
        main(["no-such-table"])


def test_cases_of_another_code_or_world_are_no_figures_of_today(tmp_path):
    cases = tmp_path / "cases.json"
    tree = {"code": "0", "world": "second", "kind": "single", "strength": 1.0, "effect": "", "baseline": True, "cases": []}
    cases.write_text(json.dumps(tree))
    with pytest.raises(InputError, match="cases.json: code: got '?0"):
        main(["second-world", "--from", str(cases)])
    cases.write_text(json.dumps({**tree, "world": "first"}))
    with pytest.raises(InputError, match="cases.json: world"):
        main(["second-world", "--from", str(cases)])
    with pytest.raises(InputError, match="--from"):
        main(["emps", "--from", str(cases)])


def test_what_the_first_day_shows_comes_from_the_pages_own_sketch(tmp_path, monkeypatch):
    """The commission command is replaced: what it prints and draws, and what a refusal says."""
    page, printed = tmp_path / "first_day.md", []

    def commission(arguments):
        out = pathlib.Path(arguments[arguments.index("--out") + 1])
        out.mkdir()
        printed.append(pathlib.Path(arguments[arguments.index("--axis") + 1]).read_text())
        (out / "report.html").write_text('<div aria-label="Gain, phase" x><div class="wide-form"><svg viewBox="0 0 1 1"></svg></div></div>')
        print(f"says so; {out}/report.html")
        return status

    monkeypatch.setattr("microstage_ros.commands.operation.commission.main", commission)
    page.write_text("text\n```yaml\n# sketch.yaml\nformat: 1\n```\n")
    status = 0
    text = first_day.measured(page)
    assert printed == ["format: 1\n"] and "says so; today/report.html" in text and "![Gain, phase](pictures/first_day_gain_phase.svg)" in text
    assert "--ink" in (tmp_path / "pictures" / "first_day_gain_phase.svg").read_text()
    status = 3
    with pytest.raises(InputError, match="says so"):
        first_day.measured(page)
    page.write_text("no sketch")
    with pytest.raises(InputError, match="sketch.yaml"):
        first_day.measured(page)


def test_a_table_bears_the_code_that_it_was_measured_with(tmp_path, monkeypatch):
    """The stamp was made when the table was written: code that changed meanwhile passed for measured."""
    page, code = tmp_path / "page.md", ["first"]
    page.write_text("<!-- compare: one -->\n| a |\n|---|\n| 1 |\n<!-- end -->\n", encoding="utf-8")
    monkeypatch.setattr(tables, "stamp_now", lambda root, files: Stamp("0", code[0], "2026-11-29", "here"))
    tables.stamp_of_code.cache_clear()
    try:
        tables.check_documents([page])
        code[0] = "changed"
        tables.update_tables([page], [("one", ["a"], [["2"]], "")], "compare")
    finally:
        tables.stamp_of_code.cache_clear()
    assert "code=first" in page.read_text(encoding="utf-8") and "| 2 |" in page.read_text(encoding="utf-8")
