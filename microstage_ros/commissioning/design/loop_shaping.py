"""PID gains shaped on a measured response: margins with bands, the bandwidth it allows, a notch where one is asked for,
and the gains as other controllers write them.

The loop is L = C G with the measured plant G [m/V] and this project's PID (`control.laws.pid`), whose derivative is
filtered.
"""

import csv
import math
import sys
from dataclasses import dataclass

import numpy as np

from microstage_ros.commissioning.estimation.frequency_response import MeasuredMargins, Response, measured_margins
from microstage_ros.commissioning.design.law_choice import slower
from microstage_ros.control.tuning.margins import pid_transfer
from microstage_ros.files import unreadable
from microstage_ros.model.transmission import motor_ratio
from microstage_ros.quantities.errors import InputError

NEEDED = ("frequency_Hz", "magnitude", "phase_deg")
LEAST_PHASE, LEAST_GAIN, MOST_SENSITIVITY = 35.0, 6.0, 2.0
FASTEST, SLOWEST, STEP = 3.0, 0.1, 0.97
SAME = 1.04  # lines nearer than this factor are one
PEAK = 2.0  # a resonance is worth a notch if it stands out of the response of a free mass by so much
DAMPED = 0.7  # damping of the notch's denominator
GAINED = 1.2  # more bandwidth that a notch must give to be proposed


def read_response(path):
    """Plant `Response` from a CSV as ``commission`` writes it: `NEEDED`, and where they are there ``coherence``,
    ``magnitude_stderr``, ``of`` (plant), ``condition`` (sliding before rest). Raises InputError.
    """
    try:
        with open(path, newline="", encoding="utf-8") as file:
            lines = [(number, line) for number, line in enumerate(file, 1) if line.strip() and line[0] != "#"]
        rows = list(csv.DictReader(line for _, line in lines))
    except (OSError, UnicodeDecodeError) as error:
        raise unreadable(path, error, "a CSV of a frequency response") from None
    if not rows or any(name not in rows[0] for name in NEEDED):
        raise InputError(str(path), ", ".join(rows[0]) if rows else "no rows", "columns " + ", ".join(NEEDED))
    for (number, _), row in zip(lines[1:], rows):
        if None in row or None in row.values():  # as the reader marks fields too many and too few
            fields = [value for name, value in row.items() if name is not None and value is not None]
            raise InputError(f"{path}: line {number}", f"{len(fields) + len(row.get(None) or ())} fields",
                             f"{len(lines[0][1].split(','))} fields, as in the header; is the file cut off?")
    if not lines[-1][1].endswith(("\n", "\r")):
        print(f"warning: {path}: line {lines[-1][0]}: the last line is not closed; is the file cut off?",
              file=sys.stderr)
    rows = [row for row in rows if row.get("of", "plant") == "plant"]
    conditions = {row.get("condition", "") for row in rows}
    wanted = "sliding" if "sliding" in conditions else next(iter(conditions), "")
    table = []
    for number, row in enumerate((r for r in rows if r.get("condition", "") == wanted), 1):
        try:
            values = [float(row[name]) for name in NEEDED]
            coherence = float(row.get("coherence") or 1.0)
            relative = float(row.get("magnitude_stderr") or 0.0) / values[1] if values[1] else math.inf
        except (TypeError, ValueError):
            raise InputError(f"{path}: row {number}", row, "numbers") from None
        if not (values[0] > 0.0 and values[1] >= 0.0 and all(map(math.isfinite, values))):
            raise InputError(f"{path}: row {number}", values, "a frequency above 0 and finite numbers")
        table.append((*values, coherence, relative))
    if len(table) < 8:
        raise InputError(str(path), f"{len(table)} lines of the plant", "at least 8")
    best = []  # where two measurements have a line in common, the more coherent one
    for line in sorted(table):
        if best and line[0] < SAME * best[-1][0]:
            best[-1] = max(best[-1], line, key=lambda r: r[3])
        else:
            best.append(line)
    order = np.array(best)
    value = order[:, 1] * np.exp(1j * np.radians(order[:, 2]))
    return Response(
        "plant", wanted or "as measured", order[:, 0], value, order[:, 3], np.zeros(len(order)), order[:, 4]
    ).kept()


@dataclass(frozen=True)
class Notch:
    """A notch (s² + 2 ζ₁ ω s + ω²)/(s² + 2 ζ₂ ω s + ω²): frequency [Hz], ζ₁, ζ₂."""

    frequency: float
    zeta_zero: float
    zeta_pole: float

    def response(self, frequency):
        """Its response at frequencies [Hz]."""
        s, w = 2j * math.pi * frequency, 2.0 * math.pi * self.frequency
        return (s * s + 2.0 * self.zeta_zero * w * s + w * w) / (s * s + 2.0 * self.zeta_pole * w * s + w * w)


@dataclass(frozen=True)
class Shaped:
    """Gains with the margins they have on the measured response."""

    gains: dict
    margins: MeasuredMargins
    bandwidth: float
    notch: Notch | None


def loop_on(response, gains, period, notch=None):
    """`Response` of the loop of PID gains on a measured plant.

    Parameters
    ----------
    response : of the plant, `Response`. gains : {proportional [V/m], integral_time, derivative_time, filter_time [s]}.
    period : of control [s]. notch : `Notch` in the loop, or None.
    """
    z = np.exp(2j * math.pi * response.frequency * period)
    controller = pid_transfer(gains, period)(z)
    if notch is not None:
        controller = controller * notch.response(response.frequency)
    return Response(
        "loop",
        response.condition,
        response.frequency,
        np.asarray(controller * response.value),
        response.coherence,
        response.amplitude,
        response.relative,
    )


def shape(response, gains, period, notch=None):
    """`Shaped`: the widest bandwidth, from `SLOWEST` to `FASTEST` times that of ``gains``, up to which the margins are
    kept; the gains as they are where none keeps them.

    Parameters
    ----------
    response : of the plant, `Response`. gains : {proportional [V/m], integral_time, derivative_time, filter_time [s]}.
    period : of control [s]. notch : `Notch` in the loop, or None.
    """
    share, best = SLOWEST, None
    while share <= FASTEST:
        trial = {**gains, **slower(gains, share)}
        trial["filter_time"] = max(trial["filter_time"], 0.3 * period)
        margins = measured_margins(loop_on(response, trial, period, notch))
        if enough(margins, response):
            best = Shaped(trial, margins, share, notch)
        elif best is not None:
            break
        share /= STEP
    if best is None:
        return Shaped(dict(gains), measured_margins(loop_on(response, gains, period, notch)), 1.0, notch)
    return best


def enough(margins, response):
    """Whether margins are kept with two standard deviations to spare, and lie inside the measured band.

    ``margins``: `MeasuredMargins` of a loop; ``response``: `Response` whose band it is.
    """
    low, high = response.frequency[0], response.frequency[-1]
    if not 1.2 * low < margins.crossover_Hz < 0.6 * high:
        return False
    return (
        margins.phase_deg - 2.0 * margins.phase_error_deg >= LEAST_PHASE
        and margins.gain_dB - 2.0 * margins.gain_error_dB >= LEAST_GAIN
        and margins.sensitivity <= MOST_SENSITIVITY
    )


def resonance_in(response):
    """(frequency [Hz], damping ratio) of the peak that stands highest over a free mass in a
    plant's ``response``, `Response`; None where none stands out."""
    kept = response.kept()
    level = np.abs(kept.value) * kept.frequency**2
    if len(level) < 5:
        return None
    k = int(np.argmax(level[2:-1])) + 2
    below = float(np.median(level[max(k - 8, 0):max(k - 3, 1)]))
    if not level[k] > PEAK * below:
        return None
    half = level[k] / math.sqrt(2.0)
    left = np.interp(half, level[:k + 1][-6:], kept.frequency[:k + 1][-6:])
    right = kept.frequency[k] + (kept.frequency[k] - left)
    return float(kept.frequency[k]), float(np.clip((right - left) / (2.0 * kept.frequency[k]), 0.005, 0.5))


def with_notch(response, gains, period):
    """`Shaped` with a notch at the resonance, where that gives at least `GAINED` times the bandwidth; else None.

    ``response``, ``gains`` and ``period`` [s] as in `shape`.
    """
    plain, found = shape(response, gains, period), resonance_in(response)
    if found is None:
        return None
    frequency, damping = found
    trial = shape(response, gains, period, Notch(frequency, damping, DAMPED))
    return trial if trial.bandwidth >= GAINED * plain.bandwidth else None


def zero_vibration(frequency, damping):
    """Zero-vibration shaper of two impulses: [(time [s], share [1])], for a reference that shall not excite a
    resonance.

    ``frequency`` [Hz] and ``damping`` ratio [1] are the resonance's. Derived: the vibration that the first impulse
    leaves is what the second one, half a damped period later, takes away.
    """
    k = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    half = 0.5 / (frequency * math.sqrt(1.0 - damping**2))
    return [(0.0, 1.0 / (1.0 + k)), (half, k / (1.0 + k))]


def exported(gains, axis):
    """Lines for other controllers: list of (name, lines, convention); ``gains``: PID gains of `loop_on`, SI."""
    kp, ki = gains["proportional"], gains["proportional"] / gains["integral_time"]
    kd = gains["proportional"] * gains["derivative_time"]
    filtered = gains["filter_time"]
    found = [
        (
            "ros2_control pid_controller",
            [
                f"gains: {{{axis.name.replace(' ', '_')}: {{p: {kp:.6g}, i: {ki:.6g}, d: {kd:.6g}, i_clamp_max:"
                f" {axis.value('drive.voltage_limit'):g}, i_clamp_min: {-axis.value('drive.voltage_limit'):g}}}}}"
            ],
            (
                "command = p e + i ∫e dt + d de/dt, e = reference − position in m, command in V; no filter of d there:"
                f" filter the position by {filtered:.3g} s"
            ),
        ),
        (
            "LinuxCNC pid",
            [
                f"setp pid.0.Pgain {kp * 1e-3:.6g}",
                f"setp pid.0.Igain {ki * 1e-3:.6g}",
                f"setp pid.0.Dgain {kd * 1e-3:.6g}",
                f"setp pid.0.maxoutput {axis.value('drive.voltage_limit'):g}",
            ],
            "machine units mm: V per mm, V per mm s, V s per mm; output in V; Dgain on the error's derivative",
        ),
    ]
    if axis.choices["drive.type"] == "voltage_motor":
        ratio = motor_ratio(axis)
        resistance, emf = axis.value("drive.resistance"), axis.value("drive.back_emf")
        damping = kd + emf / ratio  # in volts per stage speed: what a current loop takes away has to be given back
        to = ratio / resistance
        found += [
            (
                "EPOS4 position controller",
                [
                    f"P {kp * to * 1e3:.6g} mA/rad",
                    f"I {ki * to * 1e3:.6g} mA/(rad s)",
                    f"D {damping * to * 1e3:.6g} mA s/rad",
                    (
                        "FF acceleration"
                        f" {axis.value('drive.rotor_inertia') / axis.value('drive.torque_constant') * 1e3:.6g} mA"
                        " s²/rad"
                    ),
                ],
                (
                    "angle of the motor; output is the set value of the current loop, so D holds the damping that the"
                    " back-EMF gave in voltage mode"
                ),
            ),
            (
                "TwinCAT NC, cascade",
                [
                    f"Kv {kp / damping:.6g} 1/s (mm/s per mm)",
                    f"velocity loop: Kp {damping * to:.6g} A s/rad, Tn {damping / kp + gains['integral_time']:.6g} s",
                ],
                "position P over velocity PI in the drive; the torque is that of the current loop",
            ),
        ]
    return found
