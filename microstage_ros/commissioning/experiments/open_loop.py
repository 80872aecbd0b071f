"""Before any loop is closed: motor constants, inertia and sliding friction from short strokes, the scale of the
encoder."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from microstage_ros.commissioning.findings import Check, refused
from microstage_ros.commissioning.experiments.dead_encoder import EncoderWatch
from microstage_ros.commissioning.experiments.first_motion import joined
from microstage_ros.commissioning.experiments.sliding import STANDS, STILL_COUNTS, Slide
from microstage_ros.commissioning.estimation.plant_fit import resonance_of
from microstage_ros.commissioning.estimation.smoothing import SMOOTH, smoothed, window_rows
from microstage_ros.control.design.rules import volts_per_acceleration
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.model.actuators import actuator_of
from microstage_ros.signals.rows import of_row_before
from microstage_ros.model.transmission import motor_ratio

STROKE, SHARE = 1.5e-4, 0.02  # of the first strokes: metres, and share of the travel
LONGEST_WINDOW = 0.03  # of the low-pass of the strokes [s]
EMF_DOUBT = 0.05  # of the logarithm: a magnet loses 0.2 % per kelvin, and the strokes tell the back-EMF within 1 %
LEAST_SCALE = 0.5 * math.log(2.0)  # of the logarithm: edges are counted wrong by two or four
INERTIA_DOUBT = 0.3  # of the logarithm: friction that changes as the stage gathers speed counts as inertia


@dataclass(frozen=True)
class Strokes:
    """The axis in volts, as short strokes tell it; in the command's own unit where that is another one.

    Attributes
    ----------
    resistance : command per ampere: ohm (sketched where there is no current), N m/A of a current-driven motor.
    volts_per_speed : V s/m of back-EMF (with friction's viscous part where there is no current, and that alone without
        a back-EMF). inertia : V s²/m. friction : V of sliding, by the two directions. offset : V.
    viscous : V s/m. has_current : whether the current was used. speed : largest of the strokes [m/s].
    """

    resistance: float
    volts_per_speed: float
    inertia: float
    friction: float
    offset: float
    viscous: float
    has_current: bool
    speed: float


def strokes(machine, sketch, first, keep):
    """Strokes to and fro by constant voltages. Returns (`Strokes`, `Check` of the scale). Raises Refused.

    ``first``: `FirstMotion` of this machine.
    """
    actuator = actuator_of(sketch.axis)
    if first.has_current and actuator.tells_turning:
        most = actuator.emf_per_speed(sketch.axis) * (1.0 + sketch.tolerance[actuator.emf_key])
        machine.watch = EncoderWatch(
            machine.period, first.resistance, most, machine.current_offset, machine.count, rough=True
        )
    reach = min(STROKE, SHARE * machine.stroke)
    centre, parts = machine.position, []
    level = 1.6 * first.breakaway
    for attempt in range(40):
        if _stroke(machine, centre, reach, level, 0.25, parts):
            break
        level = min(1.25 * level, machine.limit)
        if level >= machine.limit and attempt > 20:
            raise refused(
                "stuck",
                level,
                "V",
                f"the stage gives way by {abs(machine.position - centre) * 1e6:.3g} µm and does not slide at"
                f" {level:.3g} {machine.command.unit}",
            )
    for scale in (1.0, 1.5, 2.0, 1.0, 1.5):
        for sign in (-1.0, 1.0):
            _stroke(machine, centre, reach, sign * min(scale * level, machine.limit), 0.25, parts)
    record = joined(parts)
    keep("strokes", record)
    found = fit_strokes(record, sketch, first, machine.period)
    slide = Slide(machine, found, actuator)
    if not slide.held:
        machine.run(np.full(machine.periods(0.1), machine.position), slide.command(0.0))
    return found, scale_check(strokes_below_swing(record, sketch, first, machine.period), sketch)


def _stroke(machine, centre, reach, voltage, longest, parts):
    """One stroke at constant voltage, and whether it came to its end. Where the encoder stands it is cut short, and
    followed by a rest.

    Raises Refused (encoder_dead) where not one count shows at a voltage beyond the one that moved the encoder before.
    """
    rows, stands = machine.periods(longest), machine.periods(STANDS, 20)
    sign, same, last = math.copysign(1.0, voltage), STILL_COUNTS * machine.count, [machine.position, 0]

    def ends(n, x, i):
        if abs(x - last[0]) > same:
            last[:] = x, n
        return sign * (x - centre) > reach or n - last[1] >= stands

    parts.append(machine.run(np.full(rows, machine.position), lambda n, x, i: voltage, until=ends))
    arrived = sign * (machine.position - centre) > reach
    if machine.ended == "until" and not arrived:
        if not last[1]:
            raise refused(
                "encoder_dead",
                0.0,
                "m",
                f"{voltage:.3g} {machine.command.unit} for {STANDS * 1e3:.0f} ms do not move the encoder by one count,"
                " where less did before: its cable or reading head has failed since (or the stage was clamped)",
            )
        parts.append(machine.rest(STANDS))
    return arrived


def fit_strokes(record, sketch, first, period):
    """`Strokes` by least squares of the voltage balance (and of the torque balance, with a current).

    ``first``: `FirstMotion`; ``period``: of control [s].
    """
    _, v, a = smoothed(record, period)
    u = savgol_filter(of_row_before(record.command), window_rows(period), 3)
    fast = np.abs(v) > 0.15 * np.abs(v).max()
    cut = slice(int(SMOOTH / period) + 1, -int(SMOOTH / period) - 1)
    keep = np.zeros(len(v), bool)
    keep[cut] = fast[cut]
    v, a, u = v[keep], a[keep], u[keep]
    motion = np.column_stack([a, np.sign(v), v, np.ones(len(v))])
    i = None
    if not actuator_of(sketch.axis).emf_key:
        return _forced(motion, u, first, float(np.abs(v).max()))
    if first.has_current:
        i = savgol_filter(np.nan_to_num(record["current_A"]), window_rows(period), 3)[keep]
    return _balanced(motion, u, i, sketch, float(np.abs(v).max()))


def _balanced(motion, u, i, sketch, top):
    """`Strokes` by least squares of u = R i + K v + o and R i = J a + F sign(v) + B v + o; without a current of both in
    one.

    Parameters
    ----------
    motion : (n, 4): acceleration, sign of the velocity, velocity [SI], ones. u : voltage (n,) [V].
        i : current (n,) [A], or None. top : largest speed [m/s].
    """
    if i is None:
        inertia, friction, viscous, offset = np.linalg.lstsq(motion, u, rcond=None)[0]
        resistance = sketch.axis.value("drive.resistance") if sketch.axis.has("drive.resistance") else math.nan
        return Strokes(resistance, float(viscous), float(inertia), float(friction), float(offset), 0.0, False, top)
    resistance, emf, offset = np.linalg.lstsq(np.column_stack([i, motion[:, 2], motion[:, 3]]), u, rcond=None)[0]
    inertia, friction, viscous, zero = np.linalg.lstsq(motion, i, rcond=None)[0]
    return Strokes(
        float(resistance),
        float(emf),
        float(inertia * resistance),
        float(friction * resistance),
        float(offset + zero * resistance),
        float(viscous * resistance),
        True,
        top,
    )


def _forced(motion, command, first, top):
    """`Strokes` by least squares of a command that is a torque or a force: u = J a + F sign(v) + B v + o; see
    `_balanced`."""
    inertia, friction, viscous, offset = np.linalg.lstsq(motion, command, rcond=None)[0]
    return Strokes(first.resistance, max(float(viscous), 0.0), float(inertia), float(friction), float(offset), 0.0,
                   first.has_current, top)


def strokes_below_swing(record, sketch, first, period):
    """`Strokes` as `fit_strokes` has them, from below the swing of the drive train: for the scale of the encoder.

    Both sides of each balance pass the same low-pass, which leaves the balance as it is. It is longer than the drive
    train swings: while it swings, motor and stage have different accelerations, and the inertia would come out up to
    three times too low. ``first``: `FirstMotion`; ``period``: of control [s].
    """
    x, v, _ = smoothed(record, period)
    window = np.hanning(_long_rows(sketch.axis, period) + 2)[1:-1]
    window /= window.sum()

    def low(values):
        return np.convolve(values, window, "valid")

    rows = np.gradient(x, period)
    speed = low(rows)
    fast = np.abs(speed) > 0.15 * np.abs(speed).max()
    u = low(of_row_before(record.command))[fast]
    motion = np.column_stack([low(c)[fast] for c in (np.gradient(rows, period), np.sign(v), rows, np.ones(len(v)))])
    if not actuator_of(sketch.axis).emf_key:
        return _forced(motion, u, first, float(np.abs(speed).max()))
    i = low(np.nan_to_num(record["current_A"]))[fast] if first.has_current else None
    return _balanced(motion, u, i, sketch, float(np.abs(speed).max()))


def _long_rows(axis, period):
    """Rows of a Hann window whose first zero, 2 over its length, lies at a third of the sketched resonance."""
    expected = resonance_of(axis)
    length = min(max(6.0 / expected, SMOOTH), LONGEST_WINDOW) if math.isfinite(expected) else SMOOTH
    return max(int(length / period) | 1, 7)


def scale_check(found, sketch):
    """Check that the encoder counts as the motor turns; raises `Refused` where it surely does not.

    ``found``: `Strokes` of the machine.

    A scale c of the encoder divides the back-EMF per encoder speed, k/c, and twice what is left of the inertia when
    that is multiplied in, J/c²; a command that is a torque or a force tells the inertia alone, J/c. Each gives an
    interval of ln c: the sketch's tolerances as bounds, and the doubt of the measurement. Refused is what lies in both,
    where all of it is nearer to a factor of two than to one.
    """
    if sketch.axis.choices["drive.type"] != "voltage_motor":
        return _judged_scale(*_scale_by_inertia(found, sketch), "the sketched mass and force")
    low, high, alone = _scale_of_motor(found, sketch)
    if low > high:
        return Check(
            "encoder_scale",
            True,
            alone[0],
            "1",
            f"the encoder counts {alone[0]:.2g} times what the sketched back-EMF says, and {alone[1]:.2g}"
            " times what the sketched inertia says: no scale explains both, one of them is beyond its tolerance",
        )
    return _judged_scale(low, high, "the motor's back-EMF and inertia")


def _scale_by_inertia(found, sketch):
    """(lowest, highest) ln c by the inertia alone."""
    axis, actuator = sketch.axis, actuator_of(sketch.axis)
    gains = ("drive.gain", "drive.torque_constant", actuator.emf_key, "drive.resistance")
    doubt = sum(math.log1p(sketch.tolerance[key]) for key in gains if key in axis.quantities and axis.value(key) > 0.0)
    known = volts_per_acceleration(controller_parameters("pid_feedforward", axis, {})["feedforward"])
    rotor, load = actuator.reflected_mass(axis), axis.value("stage.mass")
    tolerance = sketch.tolerance
    parts = (rotor, 1.0 + tolerance.get("drive.rotor_inertia", 0.0)), (load, 1.0 + tolerance["stage.mass"])
    least, most = (sum(part * factor**power for part, factor in parts) / (rotor + load) for power in (-1.0, 1.0))
    seen = math.log(max(found.inertia, 1e-12) / known)
    return math.log(least) - doubt - INERTIA_DOUBT - seen, math.log(most) + doubt + INERTIA_DOUBT - seen


def _scale_of_motor(found, sketch):
    """(lowest, highest) ln c by back-EMF and inertia, and the scales that each alone says."""
    axis, ratio = sketch.axis, motor_ratio(sketch.axis)
    emf, resistance = axis.value("drive.back_emf") / ratio, axis.value("drive.resistance")
    rotor, load = axis.value("drive.rotor_inertia"), ratio * ratio * axis.value("stage.mass")
    known = found.resistance if found.has_current else resistance
    back = math.log(max(found.volts_per_speed, 1e-12) / emf)
    turned = back + math.log(
        max(found.inertia, 1e-12) * axis.value("drive.torque_constant") * ratio / (known * (rotor + load))
    )
    factor = {
        key: 1.0 + sketch.tolerance[key]
        for key in ("drive.back_emf", "drive.rotor_inertia", "stage.mass", "drive.resistance")
    }
    viscous = blind = 0.0
    if (
        not found.has_current
    ):  # what is seen as back-EMF has the viscous friction in it, the inertia the sketched resistance
        all_volts = float(controller_parameters("pid_feedforward", axis, {})["feedforward"]["volts_per_velocity"])
        viscous, blind = max(all_volts / emf - 1.0, 0.0), math.log(factor["drive.resistance"])
        viscous *= (
            factor["drive.back_emf"]
            * factor["drive.resistance"]
            * (1.0 + sketch.tolerance.get("contacts.actuator.viscous", 1.0))
        )
    k = -math.log(factor["drive.back_emf"]) - EMF_DOUBT, math.log(factor["drive.back_emf"] + viscous) + EMF_DOUBT
    inertia = (
        math.log((rotor / factor["drive.rotor_inertia"] + load / factor["stage.mass"]) / (rotor + load))
        - INERTIA_DOUBT
        - blind,
        math.log((rotor * factor["drive.rotor_inertia"] + load * factor["stage.mass"]) / (rotor + load))
        + INERTIA_DOUBT
        + blind
        + viscous,
    )
    low, high = max(k[0] - back, 0.5 * (inertia[0] - turned)), min(k[1] - back, 0.5 * (inertia[1] - turned))
    return low, high, (math.exp(-back), math.exp(-0.5 * turned))


def _judged_scale(low, high, by):
    """`Check` of ln c between ``low`` and ``high``, ``by`` what says so. Raises Refused."""
    seen = math.exp(0.5 * (low + high))
    if low > LEAST_SCALE or high < -LEAST_SCALE:
        held = next(
            (
                f"four times too {word}"
                for scale, word in ((4.0, "many"), (0.25, "few"))
                if low <= math.log(scale) <= high
            ),
            "a wrong scale",
        )
        raise refused(
            "encoder_scale",
            seen,
            "1",
            f"the encoder counts {seen:.2g} times ({math.exp(low):.2g} to {math.exp(high):.2g}) what {by} say: {held}"
            " (decoding of the tracks: 1, 2 or 4 edges; resolution, pitch or gear in the sketch)",
        )
    return Check(
        "encoder_scale",
        True,
        seen,
        "1",
        f"the encoder counts {math.exp(low):.2g} to {math.exp(high):.2g} times what {by} say",
    )
