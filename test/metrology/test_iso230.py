"""ISO 230-2 against the figures that the owners of four real stages printed, and against hand computation."""

import json
from pathlib import Path

import numpy as np
import pytest

from microstage_ros.metrology.iso230 import iso230
from microstage_ros.quantities.errors import InputError

TABLES = Path(__file__).parents[2].parent / "shared/data/iso230/tables.json"


@pytest.mark.skipif(not TABLES.exists(), reason="the ISO 230-2 tables (../shared/data/iso230) are not here")
@pytest.mark.parametrize("stage", ["mcu1025", "b02_y", "b02_z", "week42_back_z"])
def test_reversal_and_accuracy_as_their_owners_printed_them(stage):
    table = json.loads(TABLES.read_text())[stage]
    figures = iso230(table["target_mm"], table["forward_mm"], table["backward_mm"])
    assert round(figures.reversal, 5) == table["reported_B_mm"]
    assert round(figures.accuracy, 5) == table["reported_A_mm"]


def test_all_figures_by_hand():
    """Two targets, three cycles, deviations chosen so that every figure differs."""
    targets = [0.0, 10.0]
    up = [[1.0, 2.0, 3.0], [14.0, 14.0, 17.0]]          # means 2, 5; s 1, √3
    down = [[0.0, 0.0, 0.0], [12.0, 12.5, 13.0]]        # means 0, 2.5; s 0, 0.5
    figures = iso230(targets, up, down)
    root3 = np.sqrt(3.0)
    np.testing.assert_allclose(figures.reversals, [2.0, 2.5])
    np.testing.assert_allclose(figures.mean, [1.0, 3.75])
    expected = {
        "reversal": 2.5, "mean_reversal": 2.25, "repeatability_up": 4 * root3, "repeatability_down": 2.0,
        "repeatability": max(2 * root3 + 1 + 2.5, 4 * root3), "systematic_up": 3.0, "systematic_down": 2.5,
        "systematic": 5.0, "mean_deviation": 2.75, "accuracy_up": 5 + 2 * root3 - min(0.0, 5 - 2 * root3),
        "accuracy_down": 3.5, "accuracy": 5 + 2 * root3}
    for name, value in expected.items():
        assert getattr(figures, name) == pytest.approx(value), name


def test_shift_of_the_scale_changes_no_figure_but_means():
    generator = np.random.default_rng(2)
    targets = np.linspace(0, 0.04, 5)
    up, down = (targets[:, None] + generator.normal(0, 1e-7, (5, 5)) for _ in range(2))
    one, other = iso230(targets, up, down), iso230(targets, up + 1e-3, down + 1e-3)
    for name in ("reversal", "repeatability", "systematic", "accuracy", "mean_deviation"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-15)


@pytest.mark.parametrize("up", [[[1.0, 2.0]], [[1.0], [2.0]], [[1.0, 2.0], [1.0]], [[1.0, np.nan], [1.0, 2.0]]])
def test_incomplete_tables_are_refused(up):
    with pytest.raises(InputError, match="positions up"):
        iso230([0.0, 1.0], up, [[1.0, 2.0], [1.0, 2.0]])
