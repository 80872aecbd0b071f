"""The margins of a loop that was measured at some lines: between them and above them with the identified axis.

A resonance turns the phase by 100° from one line to the next; and what may be added to the voltage is limited, so that
at long periods the least margins lie at crossings above the lines that are coherent.
"""

import math
from dataclasses import replace

import numpy as np

from microstage_ros.commissioning.estimation.frequency_response import LEAST_COHERENCE, measured_margins
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import frequency_response, loop_of, observer_loop, pid_transfer, regimes
from microstage_ros.control.tuning.tuning import GUARDED

OBSERVED, SLIDING = "self_tuning_observer", GUARDED[1]
POINTS = 3000  # of the whole loop: 0.2 % of the frequency from one to the next over nine octaves
LEAST_LINES = 4
UNITS = math.degrees(1.0), 20.0 / math.log(10.0)  # degrees and dB of a relative deviation of one, in phase and size


def whole_margins(loop, axis, drawn, law, gains):
    """`MeasuredMargins` of the whole loop L(f) = M(f) e^{d(f)}, M that of the model and d = ln(measured/M).

    The deviation d is interpolated between the coherent lines (linearly in ln f), and falls to nothing from the last of
    them to the next line. A margin found above that is called modelled, and its standard deviation is that over the
    draws; below it is that of the lines.

    Parameters
    ----------
    loop : measured `Response` in sliding. axis : identified `Axis`. drawn : axes from its posterior, `Axis` each.
    law : type of controller. gains : over those of the rules, in the unit of each.
    """
    measured, seen, nyquist = measured_margins(loop, LEAST_COHERENCE), loop.kept(), 0.5 / axis.value("period")
    if len(seen.frequency) < LEAST_LINES:
        return measured
    parameters, highest = controller_parameters(law, axis, gains), float(seen.frequency[-1])
    following = float(loop.frequency[loop.frequency > highest].min(initial=nyquist))
    frequency = np.geomspace(seen.frequency[0], nyquist, POINTS + 1)[:-1]
    off = np.log(seen.value / modelled_loop(axis, law, parameters, seen.frequency))
    nodes, at = np.log(np.append(seen.frequency, following)), np.log(frequency)
    size, turned = (np.interp(at, nodes, np.append(part, 0.0)) for part in (off.real, np.unwrap(off.imag)))
    value = modelled_loop(axis, law, parameters, frequency) * np.exp(size + 1j * turned)
    least = _least(frequency, value)
    above = frequency[frequency > highest]
    others = [_least(above, modelled_loop(each, law, parameters, above)) for each in drawn]

    def error(part):
        """Relative standard deviation of a line, or that of the margin over the draws."""
        margin, place = least[part]
        if place <= highest:
            return float(np.interp(math.log(place), nodes[:-1], seen.relative)) * UNITS[part]
        return float(np.std([o[part][0] for o in others if math.isfinite(o[part][0])] or [0.0]))

    (phase, crossing), (gain, turn) = least
    if not math.isfinite(phase):  # no crossing: what the nearest approach to −1 leaves at least
        phase = math.degrees(2.0 * math.asin(min(0.5 * float(np.abs(1.0 + value).min()), 1.0)))
    modelled = tuple(name for name, place in (("phase", crossing), ("gain", turn)) if place > highest)
    return replace(measured, phase_deg=phase, phase_error_deg=error(0), gain_dB=gain, gain_error_dB=error(1),
                   highest_Hz=highest, modelled=modelled)


def modelled_loop(axis, law, parameters, frequency):
    """Open loop [1] in sliding on the linearised axis, at ``frequency`` [Hz]; complex, shape (n,) as that.

    ``parameters``: of the ``law``, record of `controller.controller_parameters`, in SI units.
    """
    period = axis.value("period")
    _, plant, slopes = next(regime for regime in regimes(axis) if regime[0] == SLIDING)
    if law == OBSERVED:
        loop = observer_loop(axis, plant, *slopes, parameters)
    else:
        pid = {name: float(parameters["pid"][name]) for name in parameters["pid"].dtype.names}
        loop = loop_of(plant, pid_transfer(pid, period), period)
    return frequency_response(loop, 2.0 * math.pi * frequency, period)


def _least(frequency, value):
    """((phase margin [degrees], where [Hz]), (gain margin upwards [dB], where [Hz])), least of a loop's ``value`` of
    shape (n,); infinite, at 0 Hz, where there is no crossing."""
    gain, phase = np.abs(value), np.degrees(np.angle(value))
    cross = np.flatnonzero(np.diff(np.sign(gain - 1.0)))
    turn = np.flatnonzero((np.diff(np.sign(value.imag)) != 0) & (value.real[:-1] < 0.0) & (gain[:-1] < 1.0))
    return (
        min(((float(180.0 - abs(phase[k])), float(frequency[k])) for k in cross), default=(math.inf, 0.0)),
        min(((-20.0 * math.log10(gain[k]), float(frequency[k])) for k in turn), default=(math.inf, 0.0)),
    )
