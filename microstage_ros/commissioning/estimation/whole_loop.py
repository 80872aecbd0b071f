"""The margins of a loop of which only a part was measured: above the coherent band those of the identified axis.

What may be added to the voltage is limited, and at long periods little of it is left at high frequencies. There the
least margins of a loop may lie at crossings that no measurement has seen.
"""

import math
from dataclasses import replace

import numpy as np

from microstage_ros.commissioning.estimation.frequency_response import Response, measured_margins
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import frequency_response, loop_of, observer_loop, pid_transfer, regimes
from microstage_ros.control.tuning.tuning import GUARDED

OBSERVED, SLIDING = "self_tuning_observer", GUARDED[1]
LINES = 2000  # of the model: 0.2 % from one to the next over six octaves


def with_model(measured, axis, drawn, law, gains):
    """`MeasuredMargins` of the whole loop: the lesser of what was measured and what the model has above that band.

    The standard deviation of a modelled margin is that over the draws. A margin that is only the nearest approach to
    −1, as the measured band has no crossing, gives way to that of a crossing above it.

    Parameters
    ----------
    measured : `MeasuredMargins` in sliding. axis : identified `Axis`. drawn : axes from its posterior, `Axis` each.
    law : type of controller. gains : over those of the rules, in the unit of each.
    """
    if not measured.highest_Hz < 0.45 / axis.value("period"):
        return measured
    parameters = controller_parameters(law, axis, gains)
    phase, gain = _above(axis, law, parameters, measured.highest_Hz)
    others = [_above(each, law, parameters, measured.highest_Hz) for each in drawn]
    spread = [float(np.std([v for v in values if math.isfinite(v)] or [0.0])) for values in zip((phase, gain), *others)]
    found, modelled = measured, []
    if phase < measured.phase_deg or (measured.crossover_Hz == 0.0 and math.isfinite(phase)):
        modelled.append("phase")
        found = replace(found, phase_deg=phase, phase_error_deg=spread[0])
    if gain < measured.gain_dB:
        modelled.append("gain")
        found = replace(found, gain_dB=gain, gain_error_dB=spread[1])
    return replace(found, modelled=tuple(modelled))


def modelled_loop(axis, law, parameters, frequency):
    """`Response` of the loop in sliding on the linearised axis, at ``frequency`` [Hz] of shape (n,).

    ``parameters``: of the ``law``, record of `controller.controller_parameters`, in SI units.
    """
    period = axis.value("period")
    _, plant, slopes = next(regime for regime in regimes(axis) if regime[0] == SLIDING)
    if law == OBSERVED:
        loop = observer_loop(axis, plant, *slopes, parameters)
    else:
        pid = {name: float(parameters["pid"][name]) for name in parameters["pid"].dtype.names}
        loop = loop_of(plant, pid_transfer(pid, period), period)
    value = frequency_response(loop, 2.0 * math.pi * frequency, period)
    ones = np.ones(len(frequency))
    return Response("loop", "sliding", frequency, value, ones, np.full(len(frequency), math.nan), 0.0 * ones)


def _above(axis, law, parameters, lowest):
    """(least phase margin [degrees], gain margin [dB]) by the crossings above ``lowest`` [Hz]; infinite without."""
    frequency = np.geomspace(lowest, 0.5 / axis.value("period"), LINES + 1)[:-1]
    found = measured_margins(modelled_loop(axis, law, parameters, frequency))
    return found.phase_deg if found.crossover_Hz > 0.0 else math.inf, found.gain_dB
