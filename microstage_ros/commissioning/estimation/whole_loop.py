"""The margins of a loop that was measured at some lines: between them and above them with the identified axis.

A resonance turns the phase by 100° from one line to the next; and what may be added to the voltage is limited, so that
at long periods the least margins lie at crossings above the lines that are coherent.
"""

import math

import numpy as np

from microstage_ros.commissioning.estimation.frequency_response import (
    LEAST_COHERENCE,
    MeasuredMargins,
    measured_margins,
)
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import (
    crossings,
    frequency_response,
    loop_of,
    observer_loop,
    pid_transfer,
    regimes,
)
from microstage_ros.control.tuning.tuning import GUARDED

OBSERVED, SLIDING = "self_tuning_observer", GUARDED[1]
POINTS = 3000  # of the whole loop: 0.2 % of the frequency from one to the next over nine octaves
LEAST_LINES = 4
LEAST_DOUBT, MOST_DOUBT = 1e-4, 0.3
"""Relative standard deviation [1] of a line, at least (noise is never nothing), and from which it says nothing: up to
there ln(1 + error) is near the error."""
WIDTHS = tuple(octaves * math.log(2.0) for octaves in (0.5, 1.0, 2.0))
SIZES = (1e-4, *(1e-3 * 2.0**k for k in range(10)))
"""Widths [of ln f] and standard deviations [1] among which the records choose those of what the identified axis does
not say of its loop: from nothing to half of it."""
SAMPLES = 100  # of the loop, for the standard deviations of its margins: known within 7 %


def whole_margins(loop, axis, drawn, law, gains):
    """`MeasuredMargins` of the whole loop L(f) = M(f) e^{d(f)}, M that of the model.

    The deviation d = ln(measured/M) is what the lines, each with its standard deviation, leave of what is possible:

        d(f) = Σ_j a_j ln(M_j/M)/√J + Σ_k b_k φ_k(ln f)

    with the loops M_j of the J draws, φ_k bumps of one width and distance, a_j normal of variance 1, b_k (complex)
    normal of one variance. Width and variance are those with which the lines are likeliest. So a line of a large doubt
    moves the loop little, a resonance between two lines is where the model has it, and above the last line the model
    fades in. Margins are of the mean, their standard deviations over `SAMPLES` draws of d. A margin found above the
    last line is called modelled. Bishop, "Pattern Recognition and Machine Learning", Springer 2006, ch. 3.3 and 3.5.

    Parameters
    ----------
    loop : measured `Response` in sliding. axis : identified `Axis`. drawn : axes from its posterior, `Axis` each.
    law : type of controller. gains : over those of the rules, in the unit of each.
    """
    seen = loop.at(loop.relative < MOST_DOUBT)
    if len(seen.frequency) < LEAST_LINES:
        return measured_margins(loop, LEAST_COHERENCE)
    parameters, highest = controller_parameters(law, axis, gains), float(seen.frequency[-1])
    lines, whole = seen.frequency, np.geomspace(loop.frequency[0], 0.5 / axis.value("period"), POINTS + 1)[:-1]
    points = np.append(lines, whole)
    every = modelled_loop(axis, law, parameters, points)
    model, off = every[len(lines) :], np.log(seen.value / every[: len(lines)])
    others = [np.log(modelled_loop(each, law, parameters, points, axis) / every) for each in drawn]
    ways = np.column_stack([np.empty((len(points), 0)), *others]) / math.sqrt(max(len(drawn), 1))
    found = max(
        (_fitted(seen, off, _basis(points, ways, width, size)) for width in WIDTHS for size in SIZES),
        key=lambda fit: fit[0],
    )
    least = [_least(whole, model * np.exp(d)) for d in found[1:]]
    (phase, crossing), (gain, turn) = least[0]
    errors = [float(np.std([o[part][0] for o in least[1:] if math.isfinite(o[part][0])] or [0.0])) for part in (0, 1)]
    near = float(np.abs(1.0 + model * np.exp(found[1])).min())
    if not math.isfinite(phase):  # no crossing: what the nearest approach to −1 leaves at least
        phase = math.degrees(2.0 * math.asin(min(0.5 * near, 1.0)))
    modelled = tuple(name for name, place in (("phase", crossing), ("gain", turn)) if place > highest)
    return MeasuredMargins(phase, errors[0], gain, errors[1], crossing, 1.0 / near, highest, modelled)


def _basis(points, ways, width, size):
    """Deviations at ``points`` (n,) [Hz], complex, (n, c), each times the standard deviation of its real factor: those
    of the draws, ``ways``, complex, (n, J), and bumps of a ``width`` [of ln f] and a ``size`` [1]."""
    places = np.log(points)
    centres = np.arange(places.min() - width, places.max() + 2.0 * width, width)
    bumps = np.exp(-0.5 * ((places[:, None] - centres) / width) ** 2) * size / math.pi**0.25
    return np.hstack([ways, bumps, 1j * bumps])


def _fitted(seen, off, basis):
    """(ln of the evidence [1], mean deviation (m,), `SAMPLES` of it, (m,) each): regression of ``off``, complex, the
    deviation at the lines ``seen``, on the first rows of the ``basis``; of all its rows after them."""
    count = len(off)
    doubt = np.tile(np.maximum(seen.relative, LEAST_DOUBT), 2)
    rows = np.vstack([basis[:count].real, basis[:count].imag]) / doubt[:, None]
    values = np.append(off.real, np.unwrap(off.imag)) / doubt
    information = np.eye(rows.shape[1]) + rows.T @ rows
    mean = np.linalg.solve(information, rows.T @ values)
    evidence = 0.5 * (values @ rows @ mean - np.linalg.slogdet(information)[1])
    normal = np.random.default_rng(0).standard_normal((len(mean), SAMPLES))
    others = np.linalg.solve(np.linalg.cholesky(information).T, normal)
    return (evidence, *(basis[count:] @ np.column_stack([mean, mean[:, None] + others])).T)


def modelled_loop(axis, law, parameters, frequency, believed=None):
    """Open loop [1] in sliding on the linearised axis, at ``frequency`` [Hz]; complex, shape (n,) as that.

    ``parameters``: of the ``law``, record of `controller.controller_parameters`, in SI units; ``believed``: `Axis`
    whose friction the law counts with (default: this one).
    """
    period = axis.value("period")
    plant = _sliding(axis)[1]
    if law == OBSERVED:
        stiffness, damping = _sliding(believed or axis)[2]
        loop = observer_loop(axis, plant, stiffness, damping, parameters)
    else:
        pid = {name: float(parameters["pid"][name]) for name in parameters["pid"].dtype.names}
        loop = loop_of(plant, pid_transfer(pid, period), period)
    return frequency_response(loop, 2.0 * math.pi * frequency, period)


def _sliding(axis):
    """(name, plant, slopes) of `margins.regimes` in sliding."""
    return next(regime for regime in regimes(axis) if regime[0] == SLIDING)


def _least(frequency, value):
    """((phase margin [degrees], where [Hz]), (gain margin upwards [dB], where [Hz])), least of a loop's ``value`` of
    shape (n,); infinite, at 0 Hz, where there is no crossing."""
    phases, (gains, turns) = crossings(frequency, value)
    up = gains > 0.0
    return tuple(
        min(zip(each.tolist(), places.tolist()), default=(math.inf, 0.0))
        for each, places in (phases, (gains[up], turns[up]))
    )
