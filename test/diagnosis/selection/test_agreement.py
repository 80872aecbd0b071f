"""An effect must exceed the scatter of its own size between stretches of the records: made by hand, without a simulation."""

import math
import types

import numpy as np
import pytest
from scipy.stats import t as student

from microstage_ros.diagnosis.catalogue import measuring
from microstage_ros.diagnosis.catalogue.form import Form, one
from microstage_ros.diagnosis.prerequisites.timing import repeat_speed
from microstage_ros.diagnosis.residuals.evidence_set import LOUDNESS_STRETCH, STRETCH, Choice, Evidences
from microstage_ros.diagnosis.residuals.growing import Growing
from microstage_ros.diagnosis.selection import judge, selection
from microstage_ros.diagnosis.selection.agreement import (
    OF_NAMES,
    agrees_with_itself,
    has_two_sizes,
    in_baseline,
    is_the_first,
    log_tail,
    shortfall,
)
from microstage_ros.diagnosis.selection.sizes import CAUTION, sizes_of, stated_sizes

STEP, ROWS = 0.01, 3000     # s, rows of one record of 30 s
EFFECT = Form("gravity_tilt", "torque", "", lambda channel, frame: channel.signal[:, None], one("size", "1"))
OTHER = Form("amplifier_offset", "torque", "", lambda channel, frame: np.cos(channel.time / 3.0)[:, None], one("size", "1"))

COMMON = Form("scale_error", "torque", "", lambda channel, frame: np.sin(channel.time / 0.4)[:, None], one("size", "1"))


class Channel:
    """White noise, and ``size(stretch number)`` times a random signal."""

    def __init__(self, seed, size):
        generator = np.random.default_rng(seed)
        self.time = STEP * np.arange(ROWS)
        self.signal = generator.normal(size=ROWS)
        sizes = np.array([size(k) for k in range(math.ceil(ROWS * STEP / STRETCH))])
        self.residual = sizes[(self.time / STRETCH).astype(int)] * self.signal + generator.normal(size=ROWS)

    def nuisance(self):
        return np.ones((ROWS, 1))

    def whiten(self, matrix):
        return matrix, 0.0


def evidences(learn, held=None, base=None, seed=1):
    """`Evidences` of two records to learn from, one held out and, with ``base``, one of the healthy axis."""
    sizes = {"learn": [learn, learn], "held": [held or learn], "base": [base] if base else []}
    made = {group: Growing([Channel([seed, number, len(group)], size) for number, size in enumerate(each)], [EFFECT, OTHER], None)
            for group, each in sizes.items() if each}
    return Evidences(*({"torque": made[group]} if group in made else {} for group in ("learn", "held", "base")), [EFFECT, OTHER],
                     {"torque": 1.0}, None, lambda channel: made["learn"])


CHOICE = Choice("gravity_tilt", (EFFECT,))


@pytest.mark.parametrize("others", [[], [Choice("amplifier_offset", (OTHER,))]])
def test_the_learned_size_is_one_and_its_error_that_of_least_squares_where_the_noise_is_as_modelled(others):
    case = evidences(lambda k: 0.3)
    a, stderr, freedom = case.agreement(CHOICE, others, "learn")
    keys = case._keys("torque", [*others, CHOICE])
    beta, covariance, _ = case.learn["torque"].fit(keys)
    assert a == pytest.approx(1.0, abs=1e-6)
    assert stderr == pytest.approx(math.sqrt(covariance[-1, -1]) / beta[-1], rel=0.4)
    assert 180.0 < freedom < 239.0     # of 240 stretches of unlike weight, less one


def test_a_size_that_changes_its_sign_from_stretch_to_stretch_is_no_effect_although_chi_square_says_so():
    """As friction of another law leaves it: significant by any noise model, and of no one size."""
    course = 0.15 + np.where(np.arange(120) % 2, 1.0, -1.0)
    case = evidences(lambda k: course[k], base=lambda k: 0.0)
    trial = selection.best_forms(case, "gravity_tilt", [])
    assert trial.log_p < selection.LEVEL and trial.held > 5.0
    assert not agrees_with_itself(case, CHOICE, []) and not selection.acceptable(case, trial, [])
    assert shortfall(case, CHOICE, []) > 1.0


def test_a_steady_size_is_an_effect_with_and_without_a_baseline():
    for base in (None, lambda k: 0.0):
        case = evidences(lambda k: 0.3, base=base)
        assert selection.acceptable(case, selection.best_forms(case, "gravity_tilt", []), [])
        assert shortfall(case, CHOICE, []) < 1.0


@pytest.mark.parametrize("held, base", [(lambda k: 0.0, lambda k: 0.0), (lambda k: 0.3, lambda k: 0.3)])
def test_what_the_held_out_record_lacks_or_the_baseline_shows_as_well_is_none(held, base):
    assert not agrees_with_itself(evidences(lambda k: 0.3, held, base), CHOICE, [])


def test_a_baseline_without_the_column_of_an_effect_says_nothing_of_it():
    """As air temperature, which is recorded only where it varies."""
    silent = Channel(9, lambda k: 0.0)
    silent.signal = np.zeros(ROWS)
    case = evidences(lambda k: 0.3)
    case.base = {"torque": Growing([silent], [EFFECT, OTHER], None)}
    assert math.isinf(case.agreement(CHOICE, [], "base")[1]) and agrees_with_itself(case, CHOICE, [])


def test_an_effect_that_the_held_out_record_hardly_goes_to_needs_to_show_no_more_there_than_it_would():
    case = evidences(lambda k: 1.0)
    quiet = Channel(8, lambda k: 0.0)
    quiet.residual, quiet.signal = quiet.residual + 0.15 * quiet.signal, 0.15 * quiet.signal
    case.held = {"torque": Growing([quiet], [EFFECT, OTHER], None)}
    trial = selection.best_forms(case, "gravity_tilt", [])
    assert case.signal(CHOICE, []) == pytest.approx(ROWS * 0.15**2, rel=0.1)
    assert trial.held < 0.05 * trial.gain and selection.acceptable(case, trial, [])


def test_one_healthy_axis_in_a_hundred_by_all_names_together():
    """The tail is Student's, and white noise passes at no more than its share: none of 100 at some 3·10⁻⁴."""
    assert log_tail((4.0, 1.0, 9.0)) == pytest.approx(math.log(student.sf(4.0, 9.0)))
    learned = [log_tail(evidences(lambda k: 0.0, seed=seed).agreement(CHOICE, [], "learn")) for seed in range(100)]
    assert min(learned) > OF_NAMES and np.mean(np.array(learned) < math.log(0.05)) < 0.2


def test_the_lead_of_a_name_is_half_where_it_is_right_and_sure_if_the_stretches_agree():
    other = Choice("amplifier_offset", (OTHER,))
    case = evidences(lambda k: 0.3)
    lead, stderr, freedom = case.lead(CHOICE, other, [])
    assert lead == pytest.approx(0.5, abs=0.1) and case.lead(other, CHOICE, [])[0] == pytest.approx(-lead)
    # of the learning records and of the one held out
    assert stderr == pytest.approx(1.0 / (0.3 * math.sqrt(3 * ROWS)), rel=0.4) and 270.0 < freedom < 359.0
    assert judge._leads(case, CHOICE, other, []) and not judge._leads(case, other, CHOICE, [])
    once = evidences(lambda k: 6.0 * (k == 17))      # one breakaway, and nothing else
    assert once.gain([CHOICE]) - once.gain([other]) > selection.RIVAL_MARGIN and not judge._leads(once, CHOICE, other, [])


@pytest.mark.parametrize(("size", "second", "first"), [(0.3, 0.0, True), (0.0, 0.3, False), (0.3, 0.15, False)])
def test_a_name_is_the_first_of_two_where_nothing_is_left_of_the_other(size, second, first):
    """Of the difference of the two fits, however small it is beside what both explain; halfway it is neither."""
    other, common = Choice("amplifier_offset", (OTHER,)), Choice("scale_error", (COMMON,))
    case = evidences(lambda k: size)
    for group in (case._in_rows(None), case.held["torque"]):
        for record in group._records:
            channel = record._channel
            channel.residual += second * OTHER.columns(channel, None)[:, 0] + 20.0 * COMMON.columns(channel, None)[:, 0]
    made = [Growing([r._channel for r in group._records], [EFFECT, OTHER, COMMON], None)
            for group in (case._in_rows(None), case.held["torque"])]
    case.learn, case.held, case._in_rows = {"torque": made[0]}, {"torque": made[1]}, lambda channel: made[0]
    assert is_the_first(case, CHOICE, other, [common]) == first


def test_two_sizes_are_those_of_the_learning_and_of_the_held_out_records():
    for held, two in ((0.3, False), (0.34, False), (0.42, False), (0.6, True), (0.0, True)):
        case = evidences(lambda k: 0.3, lambda k, held=held: held)
        assert has_two_sizes(case, CHOICE, []) == two
        if held == 0.42:        # by four of its errors, and by two fifths
            (learned, stderr, _), (size, error, _) = (case.agreement(CHOICE, [], group) for group in ("learn", "held"))
            assert size - learned > 3.5 * math.hypot(stderr, error)
    kept = evidences(lambda k: 0.3)
    kept._in_rows, kept._learn_rows = None, {}
    assert not has_two_sizes(kept, CHOICE, [])          # the rows were not kept


def test_a_lead_in_few_stretches_of_unlike_weight_is_sure_if_each_agrees():
    """An effect that shows at speed only, in seven stretches of a record: χ² of them differs twentyfold."""
    strength = {10: 0.4, 11: 0.6, 40: 0.9, 41: 1.2, 70: 1.5, 71: 1.6, 100: 1.8}
    case = evidences(lambda k: 0.0)
    made = []
    for group in (case._in_rows(None), case.held["torque"]):
        channels = [record._channel for record in group._records]
        for number, channel in enumerate(channels):
            place = (channel.time / STRETCH).astype(int)
            channel.signal *= np.array([strength.get(k, 0.0) for k in range(120)])[place]
            channel.residual = 1.0 * channel.signal + np.random.default_rng([8, number, len(made)]).normal(size=ROWS)
        made.append(Growing(channels, [EFFECT, OTHER], None))
    case.learn, case.held, case._in_rows = {"torque": made[0]}, {"torque": made[1]}, lambda channel: made[0]
    assert judge._leads(case, CHOICE, Choice("amplifier_offset", (OTHER,)), [])


def test_a_lead_no_larger_than_what_the_baselines_law_takes_for_it_is_none():
    """What the machine's own law leaves in the direction from one name to the other, it leaves in the records, too; what
    it leaves elsewhere says nothing of the two, and what it leaves in favour of the other name takes no lead."""
    other = Choice("amplifier_offset", (OTHER,))
    case = evidences(lambda k: 0.3, base=lambda k: 0.0)
    for size, reverse, leads in ((0.0, False, True), (0.02, False, True), (0.2, False, False), (-0.2, False, False),
                                 (-0.1, False, True), (0.6, True, True)):
        channel = Channel(5, lambda k: 0.0)
        channel.residual = channel.residual + size * (channel.signal[::-1] if reverse else channel.signal)
        case.base = {"torque": Growing([channel], [EFFECT, OTHER], None)}
        found, stderr, _ = case.lead_of_baseline(CHOICE, other, [])
        if not reverse:
            assert found == pytest.approx(size / 0.3, abs=3.0 * stderr)
        assert judge._leads(case, CHOICE, other, []) == leads, size
    assert evidences(lambda k: 0.3).lead_of_baseline(CHOICE, other, []) == (0.0, 0.0, 0.0)


def test_the_baseline_has_nothing_of_the_others_to_be_taken_out():
    """What a cause beside it takes from the records is not taken from the baseline, which never had it."""
    other = Choice("amplifier_offset", (OTHER,))
    case = evidences(lambda k: 0.3, base=lambda k: 0.0)
    case._in_rows(None)      # the other one is there in the records, ten times as large
    for record in (row._channel for row in case._in_rows(None)._records):
        record.residual = record.residual + 3.0 * OTHER.columns(record, None)[:, 0]
    made = Growing([row._channel for row in case._in_rows(None)._records], [EFFECT, OTHER], None)
    case.learn, case._in_rows = {"torque": made}, lambda channel: made
    found, stderr, _ = case.agreement(CHOICE, [other], "base")
    assert abs(found) < 3.0 * stderr < 0.3


def test_what_the_healthy_axis_shows_is_counted_for_as_many_rows():
    case = evidences(lambda k: 0.3, base=lambda k: 0.2)
    assert case.usual("torque", EFFECT.key) == pytest.approx(2.0 * case.base["torque"].fit([EFFECT.key])[2], rel=0.01)
    assert evidences(lambda k: 0.3).usual("torque", EFFECT.key) == 0.0


def test_readings_that_repeat_because_the_count_is_coarse_are_not_lost():
    assert repeat_speed(25e-9, 0.0, 1e-4) == pytest.approx(2.5e-4)
    assert repeat_speed(50e-9, 8e-9, 1e-4) == pytest.approx((50e-9 + 3.0 * math.sqrt(2.0) * 8e-9) / 1e-4)


def test_the_least_signal_period_error_follows_the_encoder_of_the_axis():
    form = measuring.sde_form(1.0e-5)
    fine, coarse = (types.SimpleNamespace(drive=types.SimpleNamespace(encoder_resolution=q)) for q in (5e-9, 50e-9))
    size = np.array([6.0e-10, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert form.possible(size, fine) and not form.possible(size, coarse)


def test_a_shape_that_the_baseline_shows_too_is_not_certain_beyond_it():
    assert shortfall(evidences(lambda k: 0.3, base=lambda k: 0.0), CHOICE, []) < 1.0
    assert shortfall(evidences(lambda k: 0.3, base=lambda k: 0.27), CHOICE, []) > 1.0
    assert shortfall(evidences(lambda k: 0.3, base=lambda k: -0.3), CHOICE, []) < 1.0


def loud(pieces, base=None):
    """`Evidences` whose learning record is ``pieces(stretch of 2 s)`` times as loud as white noise."""
    case = evidences(lambda k: 0.0, base=lambda k: 0.0)
    channels = [Channel([4, number], lambda k: 0.0) for number in range(2)]
    for channel in channels:
        channel.residual = channel.residual * np.array([pieces(int(t / LOUDNESS_STRETCH)) for t in channel.time])
    made = Growing(channels, [EFFECT, OTHER], None)
    case.learn, case.held, case._in_rows = {"torque": made}, {"torque": made}, lambda channel: made
    return case


def test_loudness_is_chi_square_per_row_and_its_error_that_of_the_stretches():
    case = evidences(lambda k: 0.3)
    mean, stderr, freedom = case.loudness("torque", [CHOICE], "learn")
    rows, keys = case.learn["torque"], [EFFECT.key]
    left = rows.energy() - rows.reduction(keys, rows.fit(keys)[0])
    assert mean * 2 * ROWS == pytest.approx(left) and freedom == 2 * ROWS * STEP / LOUDNESS_STRETCH - 1
    assert stderr == pytest.approx(math.sqrt(2.0 / (2 * ROWS)), rel=0.4)       # of a mean of squares of unit noise
    assert case.loudness("torque", [], "learn")[0] == pytest.approx(mean + 0.3**2, rel=0.1)


def test_what_is_loud_in_one_stretch_only_does_not_stand_out_of_the_noise():
    """Friction that jumps every few seconds: 1.3 times the noise in every stretch stands out, four times in one does not."""
    assert judge.stands_out(loud(lambda k: 1.3), []) == ["torque"]
    once = loud(lambda k: 4.0 if k == 3 else 1.0)
    assert once.learn["torque"].energy() / (2 * ROWS) > judge.SCATTER and judge.stands_out(once, []) == []


def test_what_is_loud_in_most_stretches_stands_out_however_uneven_it_is():
    """A supply that breathes: one to ten thousand times the noise, whose mean is less than three of its standard errors."""
    uneven = loud(lambda k: 1.0 if k % 3 == 0 else 10.0 ** (4 * (k % 7) / 6.0))
    mean, stderr, _ = uneven.loudness("torque", [], "learn")
    assert mean < 4.0 * stderr and judge.stands_out(uneven, []) == ["torque"]


def test_what_the_baseline_shows_of_an_effect_is_asked_by_the_noise_models_error():
    """Two fifths of the effect on average is there already, also where its sign changes from stretch to stretch."""
    for course, there in ((lambda k: 0.12, True), (lambda k: 0.12 + (1.0 if k % 2 else -1.0), True), (lambda k: 0.0, False)):
        case = evidences(lambda k: 0.3, base=course)
        amplitude, stderr = case.amplitude_in_base(CHOICE, [])
        assert amplitude == pytest.approx(course(0) / 2 / 0.3 + course(1) / 2 / 0.3, abs=0.15) and stderr < 0.07
        assert in_baseline(case, CHOICE, []) == there


def test_a_size_without_scatter_is_no_chance_or_nothing():
    """A law of friction whose records hold no row of an effect gave 0 ± 0, and the diagnosis a division by zero."""
    assert log_tail((0.5, 0.0, 7)) == -math.inf
    assert log_tail((0.0, 0.0, 7)) == log_tail((-0.5, 0.0, 7)) == 0.0


def test_a_stated_size_holds_how_stretches_disagree():
    """A size that is 0.3 ± 0.6 by stretch: its mean of 240 has the standard error 0.6/√240 beside that of the noise, and the noise model's
    alone is too narrow."""
    def swaying(seed):
        generator = np.random.default_rng([77, seed])
        return lambda k: 0.3 + 0.6 * generator.normal()

    wide = narrow = 0
    for seed in range(60):
        case = evidences(swaying(seed), held=lambda k: 0.3, seed=seed)
        value, stderr, _ = stated_sizes(case, CHOICE, [CHOICE], EFFECT)[0]["size"]
        noise = sizes_of(case, CHOICE, [CHOICE], EFFECT)[0]["size"][1] / CAUTION["torque"]
        assert stderr == pytest.approx(math.hypot(0.6 / math.sqrt(240.0), noise), rel=0.5)
        wide, narrow = wide + (abs(value - 0.3) <= 1.96 * stderr), narrow + (abs(value - 0.3) <= 1.96 * noise)
    assert wide >= 49 > narrow      # of 60 at 95 %: fewer come once in 10⁴ runs


def test_a_stated_size_is_that_of_the_noise_where_stretches_agree():
    case = evidences(lambda k: 0.3)
    assert stated_sizes(case, CHOICE, [CHOICE], EFFECT)[0]["size"] == sizes_of(case, CHOICE, [CHOICE], EFFECT)[0]["size"]


def test_an_error_of_the_model_in_the_shape_of_the_effect_is_one_of_its_size():
    """Not marginalised over: of a signal s the factor's error is 1/√Σs², and of each record the model's own, ε/size, too.

    Marginalised, an ε of a tenth of the size took all but a hundredth of a signal of 270 (singles, seed 8704, case 16).
    """
    size, spread, records = 0.3, 0.03, 2
    made = Growing([Channel([1, n], lambda k: size) for n in range(records)], [EFFECT, OTHER], None, {EFFECT.key: spread})
    case = Evidences({"torque": made}, {}, {}, [EFFECT, OTHER], {"torque": 1.0}, None, lambda channel: made)
    a, stderr, _ = case.agreement(CHOICE, [], "learn")
    beta = made.fit([EFFECT.key])[0][0]
    signal = beta**2 * records * ROWS
    assert a * beta == pytest.approx(size, abs=0.05)
    assert stderr == pytest.approx(math.hypot(1.0 / math.sqrt(signal), spread / beta / math.sqrt(records)), rel=0.15)
    other = Choice("amplifier_offset", (OTHER,))       # what is another effect's is still taken out of it
    column = np.stack([OTHER.columns(types.SimpleNamespace(time=STEP * np.arange(ROWS)), None)[:, 0]])
    assert 0.0 < case.agreement(other, [], "learn")[1] < 10.0 / np.abs(made.fit([OTHER.key])[0][0] * np.linalg.norm(column))
