"""Frequency responses from records with a periodic multi-sine added to the voltage.

With the disturbance d known, the joint input-output method gives, whatever feeds back,

    plant  G = Σ X D* / Σ U D*        loop  L = −Σ C D* / Σ U D*        (U = C + D; C: the controller's part)

over all whole periods of d. The position is differenced before it is transformed and divided by e^{jωT} − 1 after: so
the base motion, a ramp, leaves nothing in any line. Coherence γ² = |ΣXD*|²/(Σ|X|²Σ|D|²); over n periods ΣXD* and ΣCD*
have a relative standard deviation of √((1 − γ²)/(2 γ² n)), for magnitude and, in radians, for phase. What disturbs them
disturbs U = C + D too: of L = −C/(C + D) it is dL/L = (1 + L) dC/C, and of G, where a force or the encoder's noise
disturbs the loop, dG/G = (1 + L) dX/X. So the relative standard deviation of both is |1 + L| times that, which below
the crossover is far more, and about it less.
"""

import csv
import math
from dataclasses import dataclass

import numpy as np

from microstage_ros.signals.rows import bridged

LINES = 36
DRAWS = 8  # of the phases; the one with the lowest peak is taken
LEAST_COHERENCE = 0.5  # below, a line says nothing


@dataclass(frozen=True)
class MultiSine:
    """A periodic sum of sines: ``lines`` [multiples of 1/duration], ``period`` rows, ``signal`` [V], shape (rows,)."""

    lines: np.ndarray
    rows: int
    signal: np.ndarray

    def times(self, count):
        """So many periods of it, ``count`` [1]: signal [V] of shape (count·rows,)."""
        return np.tile(self.signal, count)


@dataclass(frozen=True)
class Response:
    """A measured response.

    Attributes
    ----------
    what : "plant" [m/V] or "loop" [1]. condition : "rest" or "sliding". frequency : Hz, shape (n,). value : complex.
    coherence : 0 to 1. amplitude : of the position [m]. relative : relative standard deviation of ``value``.
    """

    what: str
    condition: str
    frequency: np.ndarray
    value: np.ndarray
    coherence: np.ndarray
    amplitude: np.ndarray
    relative: np.ndarray

    def kept(self, least=LEAST_COHERENCE):
        """`Response` of the lines with at least that coherence, ``least`` [1]."""
        return self.at(self.coherence >= least)

    def at(self, good):
        """`Response` of the lines where ``good``, bool of shape (n,), is true."""
        return Response(self.what, self.condition, *(values[good] for values in (
            self.frequency, self.value, self.coherence, self.amplitude, self.relative)))


def multi_sine(period, lowest, highest, amplitude, seed, count=LINES):
    """`MultiSine` whose lines lie evenly on a logarithmic axis.

    Parameters
    ----------
    period : control period [s]. lowest, highest : of the band [Hz]. amplitude : (frequency [Hz]) -> that of one
        line [V]. seed : of the phases [1]. count : of lines [1].
    """
    rows = max(round(1.0 / (lowest * period)), 8)
    base = 1.0 / (rows * period)
    highest = min(highest, 0.45 / period)
    lines = np.unique(np.round(np.geomspace(1, max(highest / base, 2.0), count)).astype(int))
    angles = 2.0 * math.pi * base * np.outer(np.arange(rows) * period, lines)
    size = np.array([amplitude(k * base) for k in lines])
    drawn = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, (DRAWS, len(lines)))
    signals = (np.sin(angles + phases) @ size for phases in drawn)
    return MultiSine(lines, rows, min(signals, key=lambda signal: np.abs(signal).max()))


def responses(parts, sine, period, condition):
    """(plant, loop) `Response` from stretches of rows that each hold whole periods of ``sine``.

    Parameters
    ----------
    parts : list of (encoder [m], voltage [V], disturbance [V]), each of k·rows + 1 rows, in step with the sine.
    sine : `MultiSine`. period : of control [s]. condition : of the machine, rest or sliding.
    """
    sums = {name: np.zeros(len(sine.lines), complex) for name in ("xd", "ud", "cd", "xx", "dd", "cc")}
    shift = np.exp(2j * math.pi * sine.lines / sine.rows) - 1.0
    periods, amplitude = 0, np.zeros(len(sine.lines))
    for read, voltage, disturbance in parts:
        encoder = bridged(read)
        for k in range((len(encoder) - 1) // sine.rows):
            rows = slice(k * sine.rows, (k + 1) * sine.rows)
            x = np.fft.rfft(np.diff(encoder[rows.start:rows.stop + 1]))[sine.lines] / shift
            u, d = (np.fft.rfft(values[rows])[sine.lines] for values in (voltage, disturbance))
            c = u - d
            for name, (a, b) in (
                ("xd", (x, d)),
                ("ud", (u, d)),
                ("cd", (c, d)),
                ("xx", (x, x)),
                ("dd", (d, d)),
                ("cc", (c, c)),
            ):
                sums[name] = sums[name] + a * b.conj()
            amplitude = amplitude + 2.0 * np.abs(x) / sine.rows
            periods += 1
    if not periods:
        return None, None
    frequency, differing = sine.lines / (sine.rows * period), np.abs(sums["dd"] / sums["ud"])  # |1 + L|
    found = []
    for what, value, top, power in (("plant", sums["xd"] / sums["ud"], sums["xd"], sums["xx"]),
                                    ("loop", -sums["cd"] / sums["ud"], sums["cd"], sums["cc"])):
        coherence = np.abs(top) ** 2 / np.maximum(np.real(power * sums["dd"]), 1e-300)
        coherence = np.clip(np.real(coherence), 0.0, 1.0)
        relative = differing * np.sqrt((1.0 - coherence) / np.maximum(2.0 * coherence * periods, 1e-12))
        found.append(Response(what, condition, frequency, value, coherence, amplitude / periods, relative))
    return tuple(found)


@dataclass(frozen=True)
class MeasuredMargins:
    """Margins of a measured loop with standard deviations; infinite where the measured band shows no crossing.

    ``highest_Hz``: up to which the loop was measured. ``modelled``: which of phase and gain are those of the model
    above that (`whole_loop.whole_margins`).
    """

    phase_deg: float
    phase_error_deg: float
    gain_dB: float
    gain_error_dB: float
    crossover_Hz: float
    sensitivity: float
    highest_Hz: float = math.nan
    modelled: tuple = ()


def measured_margins(loop, least=0.3):
    """`MeasuredMargins` of a ``loop``, a `Response`, by interpolation between its lines on logarithmic axes.

    ``least``: coherence [1] of the lines that count.
    """
    loop = loop.kept(least)
    if len(loop.frequency) < 4:
        return MeasuredMargins(*(math.nan,) * 6)
    logs, size = np.log(loop.frequency), np.log(np.abs(loop.value))
    phase = np.unwrap(np.angle(loop.value))
    phase -= 2.0 * math.pi * round((phase[0] + math.pi / 2) / (2.0 * math.pi))
    phase_margin, phase_error, crossover = math.inf, 0.0, 0.0
    for k in np.flatnonzero(np.diff(np.sign(size)) != 0):
        share = size[k] / (size[k] - size[k + 1])
        at = phase[k] + share * (phase[k + 1] - phase[k])
        margin = math.degrees(abs((at + 2.0 * math.pi) % (2.0 * math.pi) - math.pi))
        if margin < phase_margin:
            phase_margin, crossover = margin, math.exp(logs[k] + share * (logs[k + 1] - logs[k]))
            phase_error = math.degrees(math.hypot(loop.relative[k], loop.relative[k + 1]) / math.sqrt(2.0))
    gain_margin, gain_error = _gain_margin(loop, phase, size)
    # no crossing in the coherent band: what the nearest approach to −1 leaves at least
    if not math.isfinite(phase_margin):
        phase_margin = math.degrees(2.0 * math.asin(min(0.5 * float(np.min(np.abs(1.0 + loop.value))), 1.0)))
    return MeasuredMargins(
        phase_margin, phase_error, gain_margin, gain_error, crossover, float(np.max(1.0 / np.abs(1.0 + loop.value))),
        float(loop.frequency[-1]),
    )


def _gain_margin(loop, phase, size):
    """(dB, its standard deviation): least distance from unity where the phase falls through -180 degrees (and each turn
    below).

    Negative: the loop is unstable. A fall through -180 degrees at more than unity that is undone at more than unity
    encircles nothing, and does not count.
    """
    falls, rises = [], []
    for m in (-math.pi, -3.0 * math.pi, math.pi):
        for k in np.flatnonzero((phase[:-1] > m) != (phase[1:] > m)):
            share = (phase[k] - m) / (phase[k] - phase[k + 1])
            margin = -20.0 / math.log(10.0) * float(size[k] + share * (size[k + 1] - size[k]))
            (falls if phase[k] > m else rises).append((m, k, margin))
    least, error = math.inf, 0.0
    for m, k, margin in falls:
        undone = margin < 0.0 and any(level == m and at > k and other < 0.0 for level, at, other in rises)
        if margin < least and not undone:
            least, error = margin, 8.686 * math.hypot(loop.relative[k], loop.relative[k + 1]) / math.sqrt(2.0)
    return least, error


COLUMNS = (
    "frequency_Hz",
    "magnitude",
    "phase_deg",
    "coherence",
    "amplitude_m",
    "magnitude_stderr",
    "phase_stderr_deg",
    "of",
    "condition",
)


def write_responses(found, path):
    """Write ``found``, `Response` each, as CSV: `COLUMNS`; ``of`` is plant [m/V] or loop, ``condition`` rest or
    sliding."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(COLUMNS)
        for r in found:
            for row in zip(r.frequency, np.abs(r.value), np.degrees(np.angle(r.value)), r.coherence, r.amplitude,
                           np.abs(r.value) * r.relative, np.degrees(r.relative)):
                out.writerow([f"{value:.9g}" for value in row] + [r.what, r.condition])
