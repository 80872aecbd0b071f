"""Narrow lines in position while the stage rests: floor vibration.

The residual is stage against motor, which is white once whitened, so that its
periodogram over the resting parts has the same exponential distribution at every frequency; a line
must stand in all learning records together, again in the held-out ones, and not in the baseline.
"""

import dataclasses

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d
from scipy.optimize import minimize_scalar
from scipy.stats import gamma

from microstage_ros.diagnosis.preprocessing.smoothing import MEDIAN_SIZE, REST_SPEED
from microstage_ros.diagnosis.preprocessing.whitening import predicted, whiten_walk
from microstage_ros.diagnosis.residuals.resonance import BLOCK
from microstage_ros.diagnosis.residuals.transmission_deflection import LEAST_NOISE
from microstage_ros.model.plant_record import LINES

# usual sizes of a whitened residual; derived: noise comes so far once in 5·10⁸ rows
CLIPPED = 6.0
# Hz; calibrated by: validation.variation --group lines (half and double: the same answers)
LOWEST = 8.0
# Hz; derived: nine tenths of the Nyquist frequency 1/(2 BLOCK), beyond which a line is an image of another
HIGHEST = 0.45 / BLOCK
# blocks of the mean speed; derived: a period of the slowest line, in which no line moves the stage on
WINDOW = 2 * round(0.5 / (LOWEST * BLOCK)) + 1
# blocks of a rest that lasts; derived: two periods of the slowest line
LASTING = 2 * WINDOW
# of summed periodograms in units of their mean; derived: e⁻³² times 10⁵ frequencies is a chance of 10⁻⁹
LEAST_POWER = 32.0
# power half a hertz or so beside a line, relative to it; calibrated by: validation.margins (0.039 to 0.061)
NARROW = 0.04
# Hz from a peak, which is its skirt; calibrated by: validation.variation --group skirt (half, double and ten times: the
# same answers; a tenth: the line is missed)
SKIRT = (0.3, 1.5)
NEAR = 400           # frequencies to either side, over whose median a peak must stand out; calibrated by: the same
# blocks at the start of a record that are not looked at; derived: what the shipped drive train rang with has died away
# to e⁻²⁰ in 0.2 s, by D_c/2m = 98 /s
STARTS = 400
BESIDE = 2.0       # Hz; derived: a line that swings for half a second now and then is as wide
# standard errors; derived: with so many an amplitude of half the line's is told from all of it
CLEAR = 4.0
SIGMAS = 5.0       # standard errors that the amplitude lies above zero; derived: a chance of 6·10⁻⁷
# relative standard error of the amplitude by how stretches of rest differ: the geometric mean of 0.012, a line of the
# floor, and 0.22, what moves that a record repeats leave beside an amplifier of another gain; calibrated by:
# test/diagnosis/prerequisites/test_lines.py (0.003 and 0.22 there; 0.012 of `microstage campaign --world second --kind
# single --effect floor_vibration --seed 777` of commit d3505cd)
STEADY = 0.05
FAITHFUL = 1.5     # times what white noise makes of that; derived: by chance in one of a hundred of a dozen stretches
# χ² of a line in every held-out record, at the frequency learned; derived: a chance of e⁻¹⁰
AGAIN = 20.0
TINY = np.finfo(float).tiny


@dataclasses.dataclass(frozen=True)
class Line:
    """Frequency [Hz], amplitude [m] with standard error, phase [rad] in the first learning record, and the χ² it holds.

    ``frequency_stderr`` [Hz]: √12/(2π) σ_A/(A T) over the time T at rest (Rife and Boorstyn, IEEE Transactions on
    Information Theory 20 (1974)); ``traces``: x(t) = Re(trace · exp(2πi f t)) in each learning, then each held-out
    record."""

    frequency: float
    amplitude: float
    stderr: float
    phase: float
    learned: float
    held: float
    traces: tuple
    frequency_stderr: float = 0.0


class Spectrum:
    """Whitened resting residual of one record and its periodogram.

    ``left``: of what the drive train's model leaves (`Resonance.residual`), and not of stage against motor."""

    def __init__(self, channel, left=False):
        p = channel.prepared
        self.noise = channel.noise
        self.walk = (
            max(channel.drive.amplifier_noise, LEAST_NOISE)
            * self._period(channel)
            * channel.drive.lever
            / channel.drive.back_emf
        )
        values = channel.residual if left else channel.mean(p.stage - p.angle)
        white = whiten_walk(values[:, None], self.walk, self.noise)[:, 0]
        self.time = channel.time
        self.step = channel.time[1] - channel.time[0]
        # the line itself may move faster than the stage: rest is where the mean speed is small
        mean = uniform_filter1d(channel.speed, WINDOW, mode="nearest")
        self.mask = uniform_filter1d(np.abs(mean), WINDOW, mode="nearest") < REST_SPEED
        self.mask[:STARTS] = False
        usual = np.median(np.abs(white[self.mask])) / MEDIAN_SIZE if self.mask.any() else 1.0
        bound = CLIPPED * max(usual, 1.0)  # a strong line must not be clipped: it would grow harmonics
        self.values = _without_drift(np.where(self.mask, np.clip(white, -bound, bound), 0.0), self.mask)
        self.count = max(int(self.mask.sum()), 1)
        self.off = self.mask & (channel.mean(p.off.astype(float)) == 1.0)
        # and not where the stage only turns round: what a sine repeats there has lines at its harmonics
        # a binary opening, at a fraction of its time; the width is even
        self.lasting = maximum_filter1d(minimum_filter1d(self.mask, LASTING, mode="constant"), LASTING,
                                        mode="constant", origin=-1)
        scale = np.sqrt(np.mean(self.values[self.mask] ** 2)) if self.mask.any() else 1.0
        self.values = self.values / max(scale, TINY)
        self.scale = scale
        self._untouched = self.values     # `remove` takes out of all rows what may be in some only

    @staticmethod
    def _period(channel):
        """Root of (block time × period): turns the amplifier's noise [V] into volt seconds per block."""
        return np.sqrt((channel.time[1] - channel.time[0]) * channel.prepared.period)

    def gain(self, frequency):
        """What one metre of a line at ``frequency`` [Hz] becomes in the whitened values, complex [1/m]."""
        ratio = (self.walk / self.noise) ** 2
        p = predicted(ratio)
        z = np.exp(-2j * np.pi * frequency * self.step)
        return (1.0 - z) / (1.0 - z / (1.0 + p)) / (self.noise * np.sqrt(1.0 + p)) / self.scale

    def power(self, length):
        """Periodogram in units of its mean, and its frequencies [Hz], over ``length`` [1] values, a grid common to all
        records."""
        return np.abs(np.fft.rfft(self.values, length)) ** 2 / self.count, np.fft.rfftfreq(length, self.step)

    def fit(self, frequency):
        """Complex amplitude [m] of a line at ``frequency`` [Hz] and the χ² that it takes out."""
        wave = np.exp(2j * np.pi * frequency * self.time) * self.mask
        z = 2.0 * np.vdot(wave, self.values) / self.count
        return z, np.abs(z) ** 2 * self.count / 2.0

    def size_in(self, rows, frequency):
        """Amplitude [m] of a line at ``frequency`` [Hz] in these ``rows``, a mask (n,) such as `off` or `lasting`, and
        its standard error (infinite where there are none)."""
        count = max(int(rows.sum()), 1)
        wave = np.exp(2j * np.pi * frequency * self.time) * rows
        gain = abs(self.gain(frequency))
        stderr = np.sqrt(2.0 / count) / gain if count > 1 else np.inf
        return 2.0 * abs(np.vdot(wave, self._untouched)) / count / gain, stderr

    def unsteadiness(self, frequency):
        """Relative standard error [1] of the amplitude of a line at ``frequency`` [Hz] by how stretches of rest differ,
        and how many times that is what white noise makes of it."""
        wave, edges = np.exp(2j * np.pi * frequency * self.time), np.diff(self.mask, prepend=0, append=0).nonzero()[0]
        parts = [part for start, stop in edges.reshape(-1, 2)
                 for part in np.array_split(np.arange(start, stop), max(round((stop - start) / LASTING), 1))]
        rows = np.array([len(part) for part in parts], float)
        if len(rows) < 2:
            return 0.0, 0.0
        z = np.array([np.vdot(wave[part], self._untouched[part]) for part in parts])
        along = 2.0 * (z * np.exp(-1j * np.angle(z.sum()))).real / rows
        mean = np.average(along, weights=rows)
        stderr = np.sqrt(((rows * (along - mean)) ** 2).sum() * len(rows) / (len(rows) - 1.0)) / rows.sum()
        return stderr / mean, stderr / np.sqrt(2.0 / rows.sum())

    def remove(self, frequency):
        """Take a line at ``frequency`` [Hz] out of the values."""
        z, _ = self.fit(frequency)
        self.values = self.values - np.where(self.mask, (z * np.exp(2j * np.pi * frequency * self.time)).real, 0.0)


def _without_drift(values, mask):
    """``values`` (n,) [1] without their mean in every stretch of ``mask`` that lasts.

    An amplifier's offset or gain makes the motor seem to drift there; where a programme repeats its rests, such a mean
    has lines at multiples of their frequency.
    """
    values = values.copy()
    for start, stop in np.diff(mask, prepend=0, append=0).nonzero()[0].reshape(-1, 2):
        if stop - start >= LASTING:
            values[start:stop] -= values[start:stop].mean()
    return values


def find_lines(learn, held, base):
    """Lines in the resonance channels of these records: list of `Line`, the strongest first."""
    learn, held, base = ([Spectrum(w) for w in group] for group in (learn, held, base))
    if not learn or min(s.count for s in learn) < LASTING:
        return []
    length = 2 ** int(np.ceil(np.log2(2 * max(len(s.values) for s in [*learn, *held, *base]))))
    rests = sum(np.abs(np.fft.rfft(s.mask, length)) ** 2 / s.count for s in learn)
    skirt = float(np.median(rests[_skirt(learn[0].power(length)[1])]) / rests[0])
    found, none = [], []
    for _ in range(LINES):
        total = sum(s.power(length)[0] for s in learn)
        frequency = learn[0].power(length)[1]
        total[(frequency < LOWEST) | (frequency > HIGHEST)] = 0.0
        at = _narrow_peak(frequency, total, len(learn), skirt)
        if at is None:
            break
        peak = _sharpened(float(_peak(frequency, total, at)), float(frequency[1]), learn)
        # what is left of a line that is none of the floor's lies beside it
        line = None if any(abs(peak - one) < BESIDE for one in none) else _judge(peak, learn, held, base)
        none += [peak] if line is None else []
        for spectrum in (*learn, *held, *base):
            spectrum.remove(float(frequency[at]) if line is None else line.frequency)
        if line is not None:
            found.append(line)
    return found


def remainder_taken(lines, learn, held):
    """``lines`` with the traces corrected by what is left of them in channels prepared without them, `Resonance` lists
    ``learn`` and ``held``.

    A loop answers the floor: it moves the motor, and friction lets the stage follow only in part. Stage against motor
    has that answer, too, a hundredth of the line; what the drive train's model leaves has not, once the friction is
    replayed without the line.
    """
    spectra = [Spectrum(channel, left=True) for channel in (*learn, *held)]
    corrected = []
    for line in lines:
        traces = tuple(trace + s.fit(line.frequency)[0] / s.gain(line.frequency)
                       for trace, s in zip(line.traces, spectra))
        corrected.append(dataclasses.replace(
            line, traces=traces, amplitude=float(np.mean(np.abs(traces[:len(learn)]))),
            phase=float(np.angle(traces[0]) + np.pi / 2.0)))
    return corrected


def _sharpened(frequency, step, learn):
    """The frequency [Hz] within ``step`` [Hz] of this one at which a line takes most χ² from the learning records.

    A parabola through three points of a spectrum misses a thousandth of a hertz where stretches of rest interrupt the
    line; after half a minute that is a tenth of its period's phase.
    """
    found = minimize_scalar(lambda f: -sum(s.fit(f)[1] for s in learn), method="bounded",
                            bounds=(frequency - step, frequency + step))
    return float(found.x)


def _skirt(distance):
    """Where the ``distance`` [Hz] from a peak is that of its skirt, a mask."""
    return (distance > SKIRT[0]) & (distance < SKIRT[1])


def _narrow_peak(frequency, power, count, skirt):
    """Index of the strongest narrow peak in ``power``, of ``count`` [1] periodograms together; None without one.

    A broad one hides no line: what a sine repeats at its turns, or a move at its end, may be stronger than the floor.
    ``skirt``: share [1] of a pure line's power that the few stretches of rest put beside it.
    """
    left = power.copy()
    while True:
        at = int(np.argmax(left))
        near = power[max(at - NEAR, 0): at + NEAR]
        if left[at] < LEAST_POWER * max(np.median(near) / gamma.median(count), 1.0):
            return None
        distance = np.abs(frequency - frequency[at])
        if np.median(power[_skirt(distance)]) <= (NARROW + skirt) * power[at]:
            return at
        left[distance < BESIDE] = 0.0


def _peak(frequency, power, at):
    """Frequency of a peak by a parabola through three points."""
    a, b, c = power[at - 1], power[at], power[at + 1]
    return frequency[at] + 0.5 * (a - c) / (a - 2.0 * b + c) * (frequency[1] - frequency[0])


def _judge(frequency, learn, held, base):
    """A `Line` if held-out records have it too and the baseline has not."""
    fits = [s.fit(frequency) for s in learn]
    sizes = [abs(z / s.gain(frequency)) for (z, _), s in zip(fits, learn)]
    errors = [np.sqrt(2.0 / s.count) / abs(s.gain(frequency)) for s in learn]
    size = float(np.mean(sizes))
    stderr = float(np.hypot(np.mean(errors) / np.sqrt(len(learn)), np.std(sizes) / np.sqrt(len(learn))))
    if size < SIGMAS * stderr:
        return None
    # the floor shakes with the motor off, too; a loop that swings does not
    still = [s.size_in(s.off, frequency) for s in learn]
    if all(size > CLEAR * error and here < 0.5 * size for here, error in still):
        return None
    if all(s.size_in(s.lasting, frequency)[0] < 0.5 * size for s in learn):
        return None
    # nor does it shake more after one move than after another
    if any(error > STEADY and times > FAITHFUL for error, times in (s.unsteadiness(frequency) for s in learn)):
        return None
    if held and sum(s.fit(frequency)[1] for s in held) < AGAIN * len(held):
        return None
    if base and np.mean([abs(s.fit(frequency)[0] / s.gain(frequency)) for s in base]) > 0.5 * size:
        return None
    phase = float(np.angle(fits[0][0] / learn[0].gain(frequency)) + np.pi / 2.0)
    return Line(frequency, size, stderr, phase, float(sum(f[1] for f in fits)),
                float(sum(s.fit(frequency)[1] for s in held)),
                tuple(s.fit(frequency)[0] / s.gain(frequency) for s in (*learn, *held)),
                float(np.sqrt(3.0) / np.pi * stderr / size / max(s.count * s.step for s in learn)))
