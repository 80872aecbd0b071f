"""Sensor and environment effects in encoder against interferometer; residual = interferometer − encoder."""

import dataclasses

import numpy as np
from scipy.ndimage import uniform_filter1d

from microstage_ros.diagnosis.catalogue.form import Form, one, splines, wave

SIGNAL_PERIODS = (10e-6, 20e-6, 5e-6, 4e-6, 2e-6)  # m
DRIFT_TIMES = (3.0, 10.0, 30.0)                     # s
PER_KELVIN, PER_PASCAL, PER_HUMIDITY = -0.93e-6, 2.7e-9, -0.85e-8  # relative air index; first-order Edlén terms
# of a count q: the largest amplitude that rounding leaves at any of the periods looked for; derived: rounding is worth
# q/√12, N counts passed leave q/√12 √(2/N) in the sine and the cosine of one period, of which the largest of M
# periods is √(2 ln M) times that: 0.039 q with N = 2000 counts of a few records and M = 10⁴ periods and harmonics
LEAST_SHARE = 0.04
LEAST_DRIFT = 1.0e-9                                # m over half a minute: rounding at rest leaves as much
LEAST_LATE = 1.0e-6      # s; derived: a divisor, never nothing, in which a stage of 1 mm/s moves by 1 nm
SMOOTHING = 1.0                                     # s, of the air and temperature columns


def encoder_sde(period, harmonics=2):
    """So many ``harmonics`` [1] of the signal ``period`` [m]; β = −(s₁, c₁, s₂, c₂ …) of the encoder's error."""
    def columns(channel, frame):
        read_at = channel.place + channel.prepared.shake
        angle = 2.0 * np.pi * read_at / period
        return -channel.mean(
            np.stack([f(n * angle) for n in range(1, harmonics + 1) for f in (np.sin, np.cos)], axis=1)
        )
    return columns


def scale_error(channel, frame):
    """Proportional to position."""
    return channel.position[:, None]


def drift(time):
    """1 − exp(−t/τ), from the start of each record; ``time``: τ [s]."""
    def columns(channel, frame):
        return (1.0 - np.exp(-channel.time / time))[:, None]
    return columns


def drift_linear(channel, frame):
    """Proportional to time."""
    return channel.time[:, None]


def drift_expansion(channel, frame):
    """Proportional to the stage's temperature."""
    return _column(channel, "stage_temperature_K")[:, None]


def refractive_index(channel, frame):
    """(path + x) Δn with Δn from the air columns: β = (path, 1)."""
    index = PER_KELVIN * _column(channel, "air_temperature_K") + PER_PASCAL * _column(channel, "air_pressure_Pa")
    index = index + PER_HUMIDITY * 100.0 * _column(channel, "air_humidity")
    return np.stack([index], axis=1)


def lateness(channel, frame):
    """Encoder read late by τ: encoder = x(t + τ), so interferometer − encoder = −v τ: columns −v [m/s]."""
    return -channel.speed[:, None]


def lateness_of(late):
    """The same, (x(t) − x(t + τ))/τ [m/s], of a lateness τ = ``late`` [s] in which the speed changes: behind a gap the
    stage's swing turns round in some milliseconds."""
    def columns(channel, frame):
        p = channel.prepared
        later = np.interp(p.time + late, p.time, p.stage_position)
        return channel.mean((p.stage_position - later) / late)[:, None]
    return columns


def _late_about(beta):
    """`LATE` with the columns of the lateness β [s] that was fitted."""
    late = max(float(beta[0]), LEAST_LATE)
    return dataclasses.replace(LATE, variant=f"about {late:.3g}", columns=lateness_of(late))


def of_position(channel, frame):
    """Any smooth error along the stroke (generic)."""
    return splines(channel.position, frame.low, frame.high, max(int((frame.high - frame.low) / 0.5e-3), 2))


def of_time(channel, frame):
    """Any course in time, the same for all records (generic)."""
    return splines(channel.time, 0.0, frame.duration, 10)


def of_direction(channel, frame):
    """Different in the two directions of motion (generic)."""
    return np.tanh(channel.speed / 20e-6)[:, None]


def _column(channel, name):
    """A slow column, smoothed and without its mean, in blocks; zeros where the record lacks it."""
    values = channel.prepared.air.get(name)
    if values is None:
        return np.zeros(len(channel.residual))
    blocks = channel.mean(values)
    width = max(int(SMOOTHING / (channel.time[1] - channel.time[0])), 1)
    return uniform_filter1d(blocks, width, mode="nearest") - blocks.mean()


def _sde_sizes(period, harmonics=2, stderr=0.0):
    def sizes(beta, covariance, frame):
        parameters, effect = {"period_m": (period, stderr, "m")}, {"period_m": period}
        for n in range(1, harmonics + 1):
            part = slice(2 * n - 2, 2 * n)
            amplitude, sigma, phase, sigma_phase = wave(beta[part], covariance[part, part])
            parameters |= {f"amplitude{n}_m": (amplitude, sigma, "m"), f"phase{n}_rad": (phase, sigma_phase, "rad")}
            effect |= {f"amplitude{n}_m": amplitude, f"phase{n}_rad": phase}
        return parameters, effect
    return sizes


def _exceeds_rounding(beta, frame):
    """Whether an amplitude is more than what the rounding of this axis's encoder leaves in the mean over its counts."""
    return np.hypot(beta[::2], beta[1::2]).max() > LEAST_SHARE * frame.drive.encoder_resolution


def sde_form(period):
    """Form of a signal period that the records showed [m]."""
    return Form(
        "encoder_sde",
        "position",
        f"{period:.7g}",
        encoder_sde(period, 3),
        _sde_sizes(period, 3, 1e-4 * period),
        beyond=_exceeds_rounding,
    )


LATE = Form("sampling_jitter", "position", "", lateness, one("late_s", "s"), lambda b: b[0] > 0, about=_late_about)
FORMS = (
    *(Form("encoder_sde", "position", f"{p:g}", encoder_sde(p), _sde_sizes(p), beyond=_exceeds_rounding)
      for p in SIGNAL_PERIODS),
    Form("scale_error", "position", "", scale_error, one("relative", "1")),
    *(
        Form(
            "thermal_drift",
            "position",
            f"{t:g}",
            drift(t),
            one("amplitude_m", "m", extra={"time_s": t}),
            lambda b: abs(b[0]) > LEAST_DRIFT,
        )
        for t in DRIFT_TIMES
    ),
    Form(
        "thermal_drift",
        "position",
        "linear",
        drift_linear,
        one("rate_m_s", "m/s"),
        lambda b: abs(b[0]) > LEAST_DRIFT / 30.0,
    ),
    Form("thermal_drift", "position", "temperature", drift_expansion, one("expansion_m_K", "m/K")),
    Form("refractive_index", "position", "", refractive_index, one("path_m", "m")),
    LATE,
    Form("generic:position", "position", "", of_position, prior=1.0e-6),
    Form("generic:time", "position", "", of_time, prior=1.0e-6),
    Form("generic:direction", "position", "", of_direction),
)
