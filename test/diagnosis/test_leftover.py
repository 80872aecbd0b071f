"""On what the size of the residual depends that is left: against SciPy's analysis of variance, and on a record made by hand."""

import types

import numpy as np
import pytest
from scipy.stats import f as fisher
from scipy.stats import f_oneway

from microstage_ros.diagnosis.catalogue.form import Form, one
from microstage_ros.diagnosis.residuals.evidence import gather
from microstage_ros.diagnosis.residuals.evidence_set import Choice, Evidences
from microstage_ros.diagnosis.selection.leftover import (
    CHANCE,
    CLASSES,
    LEAST_PIECES,
    PIECE,
    Line,
    _line,
    _pieces,
    _since_motion,
    _variance_ratio,
    scatter_findings,
    swings_in_time,
)

STEP, ROWS = 0.01, 3000
FORM = Form("gravity_tilt", "torque", "", lambda channel, frame: channel.signal[:, None], one("size", "1"))


class Balance:
    """Unit noise times ``size``(the record) and twice a known signal; `Mechanical`'s face."""

    def __init__(self, seed, size, rows=ROWS):
        generator = np.random.default_rng(seed)
        self.time = STEP * np.arange(rows)
        self.position = np.sin(2.0 * np.pi * self.time / 7.3)
        self.speed = np.gradient(self.position, STEP) * (np.abs(self.position) < 0.98)
        self.signal = generator.normal(size=rows)
        self.residual = 2.0 * self.signal + size(self) * generator.normal(size=rows)

    def whiten(self, matrix, spreads=None):
        return matrix, 0.0


def looked_at(size, rows=ROWS, seed=1, kind=Balance):
    """`scatter_findings` of held-out records whose residual has this size."""
    learn, *held = (kind([seed, number], size, rows) for number in range(3))
    collection = types.SimpleNamespace(channels={"held": [{"torque": one_} for one_ in held]}, frame=None, spreads=None)
    evidence = {"torque": gather(learn, [FORM], None)}
    case = Evidences(evidence, evidence, {}, [FORM], {"torque": 1.0}, None)
    elsewhere = Form("gravity_tilt", "windup", "", None)     # the causes' forms of other channels are not theirs
    return scatter_findings(collection, case, [Choice("gravity_tilt", (FORM, elsewhere))], ["torque"])


@pytest.mark.parametrize(("coordinate", "size"), [
    ("position", lambda r: 1.0 + 1.5 * (r.position > 0.5)),
    ("time", lambda r: 1.0 + 1.5 * (r.time > 20.0)),
    ("velocity", lambda r: 1.0 + 2.0 * (np.abs(r.speed) > 0.75)),
    ("direction", lambda r: 1.0 + 1.0 * (r.speed > 0.0)),
    ("dwell", lambda r: 1.0 + 3.0 * (r.speed == 0.0)),
])
def test_what_is_left_depends_on_the_coordinate_by_which_its_size_was_made(coordinate, size):
    found, words = looked_at(size)
    assert found[0].coordinate == coordinate and found[0].significant, [(f.coordinate, f.statistic / f.threshold) for f in found]
    assert words["torque"] == f"what is left in torque depends most on {coordinate}"
    ratios = [finding.statistic / finding.threshold for finding in found]
    assert ratios == sorted(ratios, reverse=True) and {f.channel for f in found} == {"torque"}


def test_noise_depends_on_nothing():
    """One coordinate in a thousand stands out by chance: none of five in each of six records."""
    for seed in range(6):
        found, words = looked_at(lambda r: 1.0, seed=seed)
        assert not any(finding.significant for finding in found), seed
        assert words["torque"] == "what is left in torque depends on none of the coordinates looked at"


def test_a_force_that_swings_is_reported_with_its_frequency():
    """It averages out over a class of any coordinate, and its size is the same everywhere."""
    class Swinging(Balance):
        def __init__(self, *how):
            super().__init__(*how)
            self.residual = self.residual + 1.5 * np.sin(2.0 * np.pi * 1.3 * self.time)

    found, words = looked_at(lambda r: 1.0, kind=Swinging)
    assert found[0].coordinate == "time" and words["torque"] == "what is left in torque depends most on time (1.3 Hz)"


def swings(**frequencies):
    """What `swings_in_time` finds where each group of records swings at a frequency [Hz], 0 for not at all."""
    def group(name, number):
        one_ = Balance([7, number], lambda r: 1.0)
        frequency = frequencies.get(name, 0.0)
        one_.residual = one_.residual + 0.8 * np.sin(2.0 * np.pi * frequency * one_.time + number)
        return one_

    made = {"learn": [group("learn", 0), group("second", 1)], "held": [group("held", 2)], "base": [group("base", 3)]}
    collection = types.SimpleNamespace(channels={name: [{"torque": one_} for one_ in ones] for name, ones in made.items()},
                                       frame=None, spreads=None)
    evidence = {"torque": gather(made["learn"][0], [FORM], None)}
    case = Evidences(evidence, evidence, {}, [FORM], {"torque": 1.0}, None)
    return swings_in_time(collection, case, [Choice("gravity_tilt", (FORM,))])


def test_what_swings_in_time_does_so_in_every_record_at_one_frequency_and_not_in_the_baseline():
    found = swings(learn=1.3, second=1.3, held=1.3)
    assert list(found) == ["torque"] and found["torque"] == pytest.approx(1.3, abs=0.02)
    assert swings(learn=1.3, second=1.3, held=1.3, base=2.1)      # the baseline swings, but not so
    assert swings() == swings(learn=1.3, second=1.3) == swings(held=1.3) == swings(learn=1.3, held=1.3) == {}
    assert swings(learn=1.3, second=1.3, held=1.5) == swings(learn=1.3, second=1.3, held=1.3, base=1.3) == {}


@pytest.mark.parametrize(("other", "same"), [(1.0, True), (1.065, True), (0.935, True), (1.07, False), (0.93, False)])
def test_lines_of_one_frequency_are_at_most_two_widths_apart(other, same):
    one_, another = Line(1.0, 9.0, 8.0, 1.0 / 30.0), Line(other, 9.0, 8.0, 1.0 / 60.0)
    assert one_.is_at(another) == another.is_at(one_) == same


def test_the_width_of_a_line_is_one_over_the_length_of_the_record():
    assert _line(np.random.default_rng(4).normal(size=600), PIECE).width == pytest.approx(1.0 / 60.0)


def test_what_is_beyond_five_standard_deviations_is_a_spike():
    record = Balance([1, 1], lambda r: 3.0, rows=30000)
    record.residual[::100] += 1.0e3         # the median does not see them
    z, time, piece, limit = _pieces(record, types.SimpleNamespace(frame=None, spreads=None), "torque", [FORM], np.array([2.0]))
    assert limit == pytest.approx((5.0 * 3.0) ** 2, rel=0.03) and z.max() > 900.0 and time is record.time
    assert piece(record.time) == pytest.approx(0.045 + PIECE * np.arange(3000)) and len(piece(np.arange(30005.0))) == 3000


def test_what_changes_slowly_is_no_line():
    """A random walk is loudest at the lowest frequency, and the whole of its spectrum is falling."""
    generator = np.random.default_rng(9)
    lines = [_line(np.cumsum(generator.normal(size=300)), PIECE) for _ in range(300)]
    assert sum(line.stands for line in lines) <= 6


@pytest.mark.parametrize("frequency, found", [(0.15, False), (1.0, True), (4.4, True), (4.7, False)])
def test_a_line_is_looked_for_between_slow_changes_and_the_means_own_limit(frequency, found):
    values = 3.0 * np.sin(2.0 * np.pi * frequency * PIECE * np.arange(600)) + np.random.default_rng(5).normal(size=600)
    assert (abs(_line(values, PIECE)[0] - frequency) < 0.02) == found


def test_the_threshold_of_a_line_is_one_chance_in_a_thousand_for_all_frequencies_together():
    generator, above = np.random.default_rng(6), 0
    for _ in range(300):
        _, strength, threshold, _ = _line(generator.normal(size=300), PIECE)
        above += strength > threshold
    inside = np.fft.rfftfreq(300, PIECE)
    inside = ((inside > 0.2) & (inside < 4.5)).sum()
    assert threshold == pytest.approx(np.log(inside / CHANCE)) and above <= 3
    assert _line(generator.normal(size=12), PIECE) == (0.0, 0.0, 1.0, 0.0)


def test_the_ratio_of_variances_is_that_of_the_analysis_of_variance():
    generator = np.random.default_rng(7)
    values, z2 = generator.normal(size=400), generator.chisquare(1, size=400)
    z2 = z2 * (1.0 + (values > 1.0))
    ratio, threshold = _variance_ratio(values, z2)
    edges = np.quantile(values, np.linspace(0.0, 1.0, CLASSES + 1)[1:-1])
    groups = [z2[np.searchsorted(edges, values, side="right") == k] for k in range(CLASSES)]
    assert ratio == pytest.approx(f_oneway(*groups).statistic)
    assert threshold == pytest.approx(fisher.isf(CHANCE, CLASSES - 1, 400 - CLASSES))
    assert _variance_ratio(np.zeros(400), z2) == (0.0, 1.0)      # one class


def test_a_class_of_one_piece_says_nothing():
    values = np.array([0.0] * 50 + [1.0])
    assert _variance_ratio(values, np.ones(51)) == (0.0, 1.0)


def test_the_time_since_the_last_motion():
    assert list(_since_motion(np.array([0.0, 3e-5, 1e-5, 2e-5, 0.0, 5.0]), 0.1)) == pytest.approx([0.1, 0.0, 0.1, 0.2, 0.3, 0.0])


@pytest.mark.parametrize(("pieces", "enough"), [(LEAST_PIECES // 2 - 1, False), (LEAST_PIECES // 2, True)])
def test_short_records_are_not_asked(pieces, enough):
    """Two records of so many pieces each."""
    found, words = looked_at(lambda r: 1.0, rows=int(pieces * PIECE / STEP))
    assert bool(found) == enough == bool(words)
