"""A force-driven axis from its motion: closed form, bias, and the EMPS benchmark."""

import numpy as np
import pytest

from microstage_ros.identification.estimators.inverse_dynamics import (
    KEYS,
    Bands,
    balance,
    choose_bands,
    identify_force_axis,
)
from microstage_ros.quantities.errors import InputError
from microstage_ros.records import Record

PUBLISHED = {"stage.mass": 95.1089, "contacts.guideway.viscous": 203.5034, "contacts.guideway.coulomb": 20.3935,
             "stage.offset_force": -3.1648}


def synthetic(noise=0.0, seed=0, offset=-3.0, length=20000):
    """A record of M a + F_v v + F_c sgn v + F_0 along a two-tone motion, 1 kHz, counts of 50 nm."""
    t = np.arange(length) * 1e-3
    # commensurable tones with zero mean: the motion reverses often and starts and ends alike
    x = 0.05 * np.sin(2 * np.pi * 0.5 * t) + 0.01 * np.sin(2 * np.pi * 1.7 * t)
    v = np.gradient(x, 1e-3)
    force = 95.0 * np.gradient(v, 1e-3) + 200.0 * v + 20.0 * np.sign(v) + offset
    force += noise * np.random.default_rng(seed).standard_normal(length)
    return Record(1e-3, {"encoder_m": np.round(x / 50e-9) * 50e-9, "reference_m": x, "force_N": force}, "synthetic")


def test_known_parameters_come_back(emps_axis):
    found = identify_force_axis([synthetic()], emps_axis)
    for key, value, tolerance in zip(KEYS, (95.0, 200.0, 20.0, -3.0), (0.003, 0.01, 0.01, 0.01)):
        assert found.estimates[key].determined
        assert found.estimates[key].value == pytest.approx(value, rel=tolerance)


def test_intervals_hold_the_truth_under_noise(emps_axis):
    held = 0
    for seed in range(12):
        found = identify_force_axis([synthetic(noise=5.0, seed=seed)], emps_axis).estimates["stage.mass"]
        held += found.low <= 95.0 <= found.high
    assert held >= 9


def test_an_offset_of_nothing_is_a_result(emps_axis):
    offset = identify_force_axis([synthetic(offset=0.0)], emps_axis).estimates["stage.offset_force"]
    assert offset.determined
    assert abs(offset.value) < 0.05


def test_instruments_remove_the_bias_of_a_noisy_position(emps_axis):
    """White noise of the encoder inside the band shrinks the least-squares mass, not the instrumental one."""
    record = synthetic()
    noisy = record.columns["encoder_m"] + 3e-5 * np.random.default_rng(1).standard_normal(len(record))
    bands = Bands(30.0, 20.0)
    w, z, f = balance(noisy, record["force_N"], record["reference_m"], 1e-3, bands, 50e-9)
    least = np.linalg.lstsq(w, f, rcond=None)[0][0]
    instrumental = np.linalg.solve(z.T @ w, z.T @ f)[0]
    assert abs(instrumental - 95.0) < 0.3 * abs(least - 95.0)


def test_the_band_holds_the_force():
    t = np.arange(8192) * 1e-3
    bands = choose_bands(np.sin(2 * np.pi * 5.0 * t), 1e-3)
    assert 4.0 < bands.fit < 12.0
    assert bands.position == 2.0 * bands.fit


def test_motion_in_one_direction_only_is_refused(emps_axis):
    t = np.arange(5000) * 1e-3
    record = Record(1e-3, {"encoder_m": 0.01 * t, "reference_m": 0.01 * t, "force_N": 22.0 + np.sin(t)}, "one way")
    with pytest.raises(InputError, match="both directions"):
        identify_force_axis([record], emps_axis)


def test_force_of_the_wrong_sign_or_another_motion_is_refused(emps_axis):
    for change, message in ((lambda f: -f, "stage.mass of -95"), (lambda f: np.random.default_rng(0).permutation(f), "left unexplained|of -")):
        record = synthetic()
        record.columns["force_N"] = change(record.columns["force_N"])
        with pytest.raises(InputError, match=message):
            identify_force_axis([record], emps_axis)


def test_a_constant_force_is_refused(emps_axis):
    record = synthetic()
    record.columns["force_N"][:] = 5.0
    with pytest.raises(InputError, match="a force that changes"):
        identify_force_axis([record], emps_axis)


def test_emps_published_parameters_within_one_percent(emps_axis, emps_record):
    found = identify_force_axis([emps_record], emps_axis)
    for key, value in PUBLISHED.items():
        estimate = found.estimates[key]
        assert estimate.determined
        assert estimate.value == pytest.approx(value, rel=0.01)
        assert estimate.low <= value <= estimate.high


def test_emps_closed_loop_force_is_bettered(emps_axis, emps_record):
    from microstage_ros.identification.pipeline import identify

    found = identify([emps_record], emps_axis, refine=True)
    rms = [float(remark.split("rms ")[1].split(" N")[0]) for remark in found.remarks if remark.startswith("Closed-loop")]
    before, inverse, after = rms
    assert before == pytest.approx(2.466, abs=0.02)
    assert inverse == pytest.approx(before, rel=0.005)
    assert after < 0.995 * before
