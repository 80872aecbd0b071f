"""Writes the pages of the API reference, one for every module, and the table of contents, while mkdocs builds."""

from pathlib import Path

import mkdocs_gen_files

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "microstage_ros"


def modules():
    """(dotted name, path of the page) of every public module that has a docstring of its own, in order."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if parts[-1] == "__init__":
            parts = parts[:-1]
        if any(part.startswith("_") for part in parts) or not path.read_text(encoding="utf-8").lstrip().startswith(
            '"""'
        ):
            continue
        yield ".".join(parts), "/".join(("api", *parts)) + ".md"


def write():
    """The API pages and ``SUMMARY.md``."""
    pages = sorted((ROOT / "docs").glob("*.md"))
    lines = [f"* [{_title(page)}]({page.name})" for page in pages]
    for folder in ("reference", "evidence", "decisions"):
        lines += [
            f"* {folder.capitalize()}",
            *(f"    * [{_title(page)}]({folder}/{page.name})" for page in sorted((ROOT / "docs" / folder).glob("*.md"))),
        ]
    lines.append("* API")
    for name, page in modules():
        with mkdocs_gen_files.open(page, "w") as file:
            file.write(f"::: {name}\n")
        lines.append(f"    * [{name.removeprefix('microstage_ros.')}]({page})")
    with mkdocs_gen_files.open("SUMMARY.md", "w") as file:
        file.write("\n".join(lines) + "\n")


def _title(page):
    """The first heading of a page, else its name."""
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.startswith("# "):
            return line[2:].strip()
    return page.stem.replace("-", " ")


write()
