"""Periods of position that no list foresees: a signal period of the encoder, cogs of the motor, teeth of a gear.

A residual that repeats along the stroke has a line in its spectrum over position. Directions are looked at
apart, as whitening shifts a wave by the way the stage came, and their powers added; in white noise the sum
over m spectra of unit mean follows a gamma distribution of shape m.
"""

import dataclasses

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import gamma

from microstage_ros.diagnosis.catalogue import drive as ripples
from microstage_ros.diagnosis.catalogue import friction, measuring
from microstage_ros.diagnosis.catalogue.form import Form
from microstage_ros.diagnosis.preprocessing.smoothing import REST_SPEED, triangle
from microstage_ros.diagnosis.residuals.evidence import gather
from microstage_ros.diagnosis.residuals.mechanical import SETTLING_TRAVEL
from microstage_ros.model.plant_record import RIPPLES

CHANCE = 1.0e-6   # that the strongest of all lines is none; derived: as `selection.LEVEL`, over all lines at once
# frequencies from whose median a line must stand out; short scans make lines wide; calibrated by:
# validation.variation --group periods (half and double: the same answers)
BESIDE = 3001
# lines looked for; derived: as many terms of the motor's ripple as a machine may have, one wave of the screw and one of
# the guideways
MOST = RIPPLES + 2
# χ² that a ripple must hold on its own; calibrated by: validation.margins (22 to 85)
REAL = 40.0
# rad: the phase of one direction of one record from the mean of all; calibrated by: validation.margins (0.58 to 0.97)
ONE_PHASE = 0.7
# m, of the encoder's signal periods; derived: it holds those that `EncoderSde.draw` draws, 0.8 to 40 µm
SDE_RANGE = (4.0e-7, 6.0e-5)
# cycles per turn of a ripple; derived: it holds those that `TorqueRipple.draw` draws, 0.5 to 24, with a tenth beyond
RIPPLES_PER_TURN = (0.5 / 1.1, 24.0 * 1.1)
# periods: courses in time slower than this are no matter of the encoder's periods; calibrated by: validation.variation
# --group periods (half and double: the same answers)
SLOW = 2001
# m: speed, and with it the whitening's gain, changes from move to move, so one line has sides this close;
# calibrated by: validation.variation --group stretch --world second (half and double: the same answers)
STRETCH = 1.0e-3
OF_ENCODER = ("encoder_sde", "scale_error", "generic:position")      # errors by place
ALONG_STROKE = ("cable_spring", "direction_asymmetry", "position_dependent_friction", "screw_pitch_error",
                "torque_ripple")
# in one direction of one record, to be looked at; derived: a wave as large as the noise has a power of n/4 = 50 of so
# many, twice what `CHANCE` leaves of 10⁴ frequencies, −ln 10⁻¹⁰
LEAST_VALUES = 200
# relative distance from a whole or half number of cycles per turn that is none; calibrated by:
# validation.margins (3.9e-3 to 4.6e-3)
SNAP = 4.0e-3


@dataclasses.dataclass(frozen=True)
class Way:
    """One direction of one record: positions [m] and the residual there, white or nearly so (in any unit)."""

    position: np.ndarray
    values: np.ndarray

    def spectrum(self, cell, length):
        """Σ values e^{−ikx} over all k at once, in units of its root mean power: shape (k,), complex.

        ``cell``: of the position [m]; ``length``: number of cells [1].
        """
        at = np.floor(self.position / cell).astype(int) % length
        sums = np.bincount(at, self.values, length)
        return np.fft.rfft(sums) / np.sqrt(np.sum(self.values**2))

    def without(self, number):
        """The same without the line of this wave number [rad/m]."""
        wave = np.stack([np.cos(number * self.position), np.sin(number * self.position)], axis=1)
        sizes = np.linalg.lstsq(wave, self.values, rcond=None)[0]
        return Way(self.position, self.values - wave @ sizes)


def periods(ways, shortest, longest):
    """Spatial periods [m] of the lines that stand out, the strongest first.

    ``ways``: list of `Way`; ``shortest``, ``longest``: bounds of the period [m]. The probability that the first
    is chance is at most `CHANCE` over all periods between the bounds.
    """
    ways = [way for way in ways if len(way.values) > LEAST_VALUES]
    if not ways:
        return []
    # derived: a mean over a sixth of the shortest period keeps sinc(1/6) = 0.95 of its amplitude
    cell = shortest / 6.0
    reach = max(np.ptp(way.position) for way in ways)
    if reach < 3.0 * longest:
        longest = reach / 3.0
    # derived: between two of these frequencies a line keeps sinc(1/8) = 0.97 of its amplitude
    length = 2 ** int(np.ceil(np.log2(4.0 * reach / cell)))
    frequency = np.fft.rfftfreq(length, cell)
    inside = (frequency > 1.0 / longest) & (frequency < 1.0 / shortest)
    if not inside.any():    # a travel of less than three of the shortest periods
        return []
    independent = max(int(inside.sum()) * reach / (length * cell), 1.0)
    least = gamma.isf(CHANCE / independent, len(ways))
    middle = gamma.median(len(ways))
    found = []
    while len(found) < MOST:
        power = sum(np.abs(way.spectrum(cell, length)) ** 2 for way in ways)
        usual = np.maximum(median_filter(power[inside], BESIDE, mode="nearest") / middle, 1.0)
        at = int(np.argmax(power[inside] / usual))
        if power[inside][at] < least * usual[at]:
            break
        top = int(np.flatnonzero(inside)[at])
        a, b, c = power[top - 1: top + 2]
        line = frequency[top] + (0.5 * (a - c) / (a - 2.0 * b + c) * frequency[1] if a - 2.0 * b + c < 0.0 else 0.0)
        found.append(float(1.0 / line))
        ways = [way.without(2.0 * np.pi * line) for way in ways]
    return found


def both_ways(position, values, speed):
    """The two `Way`s of one record; ``position`` [m], ``values`` and ``speed`` [m/s] each of shape (n,)."""
    return [Way(position[moving], values[moving]) for moving in (speed > REST_SPEED, speed < -REST_SPEED)]


def within_travel(forms, collection):
    """Those of ``forms`` that the records can show.

    An error of the encoder whose period is longer than the longest travel of a learning or a held-out record is any
    smooth curve; in less than a signal period every error along the stroke is, and the place holds of the reading's own
    noise what shows in the residual. What differs along the stroke, or with the direction, differs by nothing within
    the travel in which the contacts' first state is forgotten.
    """
    travel = min(max(np.ptp(p.stage_position) for p in collection.prepared[name]) for name in ("learn", "held"))
    signal_period = collection.frame.drive.signal_period

    def least(form):
        if form.channel == "position" and form.effect in OF_ENCODER:
            return max(float(form.variant or 0.0), signal_period)
        return SETTLING_TRAVEL if form.effect in ALONG_STROKE else 0.0

    return [form for form in forms if least(form) <= travel]


def periodic_forms(collection):
    """Forms at the periods that the learning records show and the catalogue's grid lacks."""
    return [*_signal_periods(collection), *_ripples(collection)]


def _signal_periods(collection):
    """Of the encoder, from its difference with the interferometer."""
    if "position" not in collection.names:
        return []
    ways = []
    for channels in collection.channels["learn"]:
        p = channels["position"].prepared
        difference = p.interferometer - p.encoder
        ways += both_ways(p.stage_position, difference - triangle(difference, SLOW), p.stage_speed)
    found = [p for p in periods(ways, *SDE_RANGE) if _new(p, measuring.SIGNAL_PERIODS)]
    return [measuring.sde_form(period) for period in found]


def _ripples(collection):
    """Of the motor's torque, and of friction along the stroke."""
    ways, turn = [], 2.0 * np.pi * collection.frame.drive.lever
    for channels in collection.channels["learn"]:
        channel = channels["torque"]
        white = channel.whiten(channel.residual[:, None], collection.spreads)[0][:, 0]
        # derived: 3.4 standard deviations, which noise exceeds once in 1500 rows
        bound = 5.0 * max(np.median(np.abs(white)), 1.0)
        ways += both_ways(channel.position, np.clip(white, -bound, bound), channel.speed)
    found = [_snapped(turn / p) for p in periods(ways, *(turn / n for n in reversed(RIPPLES_PER_TURN)))]
    # a tone of the dither at a steady speed is a line along the stroke, too, but no torque that depends on the place
    real = _bound_to_the_place(collection, found)
    forms = [ripples.ripple_form((n,)) for n in real if _new(n, ripples.RIPPLE_CYCLES)]
    if len(real) > 1:
        forms.append(ripples.ripple_form(tuple(real[:RIPPLES])))
    if real and "resonance" in collection.names:
        forms.append(ripples.shaking_form(tuple(real[:RIPPLES])))
    return [*forms, *(friction.periodic_form(turn / n) for n in found if n not in real)]


def _bound_to_the_place(collection, found):
    """Those cycles per turn whose ripple has one phase in both directions of every learning record, and holds
    enough."""
    kept, sides = [], 2.0 * np.pi * collection.frame.drive.lever / STRETCH
    for n in found:
        if any(abs(n - k) < sides for k in kept):
            continue
        form = _both_directions(n)
        fits = [gather(channels["torque"], [form], collection.frame, spreads=collection.spreads).fit([form.key])
                for channels in collection.channels["learn"]]
        phases = np.concatenate([np.exp(1j * np.arctan2(beta[1::2], beta[::2])) for beta, _, _ in fits])
        phase_deviation = np.abs(np.angle(phases / phases.mean()))
        if sum(gain for *_, gain in fits) > REAL and phase_deviation.max() < ONE_PHASE:
            kept.append(n)
    return kept


def _both_directions(cycles):
    """A ripple with sizes of its own in each direction: (sin, cos) going out, (sin, cos) coming back."""
    one = ripples.torque_ripple((cycles,))

    def columns(channel, frame):
        wave, out = one(channel, frame), channel.speed[:, None] > 0.0
        return np.concatenate([wave * out, wave * ~out], axis=1)

    return Form("torque_ripple", "torque", "out and back", columns)


def _new(value, known):
    """Whether none of these is nearly the same."""
    return all(abs(value / k - 1.0) > SNAP for k in known)


def _snapped(cycles):
    """Cycles per turn, whole or half if that is within what a record tells."""
    near = round(2.0 * cycles) / 2.0
    return near if near > 0.0 and abs(cycles / near - 1.0) < SNAP else cycles
