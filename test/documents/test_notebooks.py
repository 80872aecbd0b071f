"""Every notebook runs from its first cell to its last in a folder of its own, and stores no output."""

import os
import re

import nbformat
import pytest
from nbclient import NotebookClient
from page_blocks import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def run(path, folder):
    """The notebook after a run, and all that its cells printed."""
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    NotebookClient(notebook, timeout=600, startup_timeout=300, kernel_name="python3", resources={"metadata": {"path": str(folder)}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    return outputs, "".join(output.get("text", "") for output in outputs)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_no_output_is_stored(path):
    for cell in nbformat.read(path, as_version=4).cells:
        assert cell.cell_type != "code" or not cell.outputs and cell.execution_count is None


def test_identify_and_diagnose(tmp_path, monkeypatch):
    """It identifies the healthy axis, and names the gap with its size."""
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    outputs, said = run(ROOT / "docs" / "notebooks" / "identify_diagnose.ipynb", tmp_path)
    assert "drive.resistance: 3.4" in said and "backlash" in said
    width, spread = map(float, re.search(r"gap: ([\d.]+) ± ([\d.]+) mrad", said).groups())
    assert abs(width - 10.0) < max(4.0 * spread, 0.5)
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert (tmp_path / "answer" / "report.html").exists() and (tmp_path / "mine.yaml").exists()
