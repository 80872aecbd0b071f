"""Before any loop is closed: motor constants, inertia and sliding friction from short strokes, the scale of the encoder,
and the frequency response while a constant voltage slides the stage (its back-EMF holds the speed)."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from microstage_ros.commissioning.findings import Check, refused
from microstage_ros.commissioning.experiments.first_motion import joined
from microstage_ros.commissioning.estimation.frequency_response import multi_sine, responses
from microstage_ros.commissioning.estimation.smoothing import SMOOTH, smoothed, window_rows
from microstage_ros.signals.rows import of_row_before
from microstage_ros.model.transmission import motor_ratio

STROKE, SHARE = 1.5e-4, 0.02  # of the first strokes: metres, and share of the travel
SCALES = (0.25, 1.0, 4.0)
DOUBT = 2.0  # chi-square by which a wrong scale must explain the strokes better
LEAST_SPREAD = 0.15
SLIDE_SPEED, SLIDE_SHARE, TOP_SHARE = 3e-3, 0.12, 0.25  # of the base motion: m/s, of the travel, of the speed at the limit
PASSES, LOWEST, HIGHEST = 6, 5.0, 1200.0  # base motions; Hz


@dataclass(frozen=True)
class Strokes:
    """The axis in volts, as short strokes tell it.

    Attributes
    ----------
    resistance : ohm (sketched where there is no current). volts_per_speed : V s/m of back-EMF (with friction's viscous
        part where there is no current). inertia : V s²/m. friction : V of sliding, by the two directions. offset : V.
    viscous : V s/m. has_current : whether the current was used. strokes : their speed [m/s], largest.
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
    """Strokes to and fro by constant voltages. Returns (`Strokes`, `Check` of the scale). Raises Refused."""
    reach = min(STROKE, SHARE * machine.stroke)
    centre, parts = machine.position, []
    level = 1.6 * first.breakaway
    for attempt in range(40):
        record = _stroke(machine, centre, reach, level, 0.25)
        parts.append(record)
        if machine.ended == "until":
            break
        level = min(1.25 * level, machine.limit)
        if level >= machine.limit and attempt > 20:
            raise refused("stuck", level, "V", f"the stage gives way by {abs(machine.position - centre) * 1e6:.3g} µm and does not slide at {level:.3g} V")
    for scale in (1.0, 1.5, 2.0, 1.0, 1.5):
        for sign in (-1.0, 1.0):
            parts.append(_stroke(machine, centre, reach, sign * min(scale * level, machine.limit), 0.25))
    record = joined(parts)
    keep("strokes", record)
    found = fit_strokes(record, sketch, first, machine.period)
    return found, scale_check(found, sketch)


def _stroke(machine, centre, reach, voltage, longest):
    rows = machine.periods(longest)
    sign = math.copysign(1.0, voltage)
    return machine.run(np.full(rows, machine.position), lambda n, x, i: voltage, until=lambda n, x, i: sign * (x - centre) > reach)


def fit_strokes(record, sketch, first, period):
    """`Strokes` by least squares of the voltage balance (and of the torque balance, with a current)."""
    _, v, a = smoothed(record, period)
    u = savgol_filter(of_row_before(record["voltage_V"]), window_rows(period), 3)
    fast = np.abs(v) > 0.15 * np.abs(v).max()
    cut = slice(int(SMOOTH / period) + 1, -int(SMOOTH / period) - 1)
    keep = np.zeros(len(v), bool)
    keep[cut] = fast[cut]
    v, a, u = v[keep], a[keep], u[keep]
    ones, sign = np.ones(len(v)), np.sign(v)
    if not first.has_current:
        inertia, friction, viscous, offset = np.linalg.lstsq(np.column_stack([a, sign, v, ones]), u, rcond=None)[0]
        resistance = sketch.axis.value("drive.resistance") if sketch.axis.has("drive.resistance") else math.nan
        return Strokes(resistance, float(viscous), float(inertia), float(friction), float(offset), 0.0, False, float(np.abs(v).max()))
    i = savgol_filter(np.nan_to_num(record["current_A"]), window_rows(period), 3)[keep]
    resistance, emf, offset = np.linalg.lstsq(np.column_stack([i, v, ones]), u, rcond=None)[0]
    inertia, friction, viscous, zero = np.linalg.lstsq(np.column_stack([a, sign, v, ones]), i, rcond=None)[0]
    return Strokes(float(resistance), float(emf), float(inertia * resistance), float(friction * resistance),
                   float(offset + zero * resistance), float(viscous * resistance), True, float(np.abs(v).max()))


def scale_check(found, sketch):
    """Does the encoder count as the motor turns? With k = K_E and J as sketched, within their tolerances, a scale c of the
    encoder shows in the back-EMF per encoder speed (k c) and in the current per encoder acceleration (J c / k)."""
    axis = sketch.axis
    if axis.choices["drive.type"] != "voltage_motor":
        return Check("encoder_scale", True, math.nan, "1", "not checked: this drive has no back-EMF to hold the encoder against")
    ratio = motor_ratio(axis)
    emf, resistance = axis.value("drive.back_emf"), axis.value("drive.resistance")
    mass = axis.value("stage.mass")
    reflected = axis.value("drive.rotor_inertia") + ratio * ratio * mass
    known = found.resistance if found.has_current else resistance
    back = math.log(max(found.volts_per_speed, 1e-12) / (emf / ratio))
    torque = math.log(max(found.inertia, 1e-12) / (known * reflected / (axis.value("drive.torque_constant") * ratio)))
    spread = {key: max(sketch.spread(key), LEAST_SPREAD) for key in ("drive.back_emf", "drive.rotor_inertia", "drive.resistance")}
    both = math.hypot(spread["drive.rotor_inertia"], 0.0 if found.has_current else spread["drive.resistance"])

    def doubt(scale):
        shift = math.log(scale)
        return ((back - shift) / spread["drive.back_emf"]) ** 2 + ((back + torque - 2.0 * shift) / both) ** 2

    doubts = {scale: doubt(scale) for scale in SCALES}
    best = min(doubts, key=doubts.get)
    seen = math.exp((back / spread["drive.back_emf"] ** 2 + 2.0 * (back + torque) / both**2)
                    / (1.0 / spread["drive.back_emf"] ** 2 + 4.0 / both**2))
    if best != 1.0 and doubts[1.0] - doubts[best] > DOUBT and spread["drive.back_emf"] < 1.0:
        few = "few" if best > 1.0 else "many"
        raise refused("encoder_scale", 1.0 / seen, "1", f"the encoder counts {1.0 / seen:.2g} times what the motor's back-EMF and inertia say: "
                      f"four times too {few} (decoding of the tracks: 1, 2 or 4 edges; resolution, pitch or gear in the sketch)")
    return Check("encoder_scale", True, 1.0 / seen, "1", f"the encoder counts {1.0 / seen:.2g} times what back-EMF and inertia of the sketch say")


def slide_speed(machine, found):
    """Speed of the base motion [m/s]."""
    top = max((machine.limit - found.friction) / max(found.volts_per_speed, 1e-9), 1e-6)
    return min(SLIDE_SPEED, TOP_SHARE * top)


def sliding_response(machine, found, seed, keep):
    """Frequency response at a constant base voltage, to and fro. Returns the plant's `Response`, or None without a stroke long enough."""
    speed = slide_speed(machine, found)
    base = found.friction + (found.volts_per_speed + found.viscous) * speed
    period, length = machine.period, min(SLIDE_SHARE * machine.stroke, 8e-3)
    lowest = max(LOWEST, 4.0 * speed / length)
    highest = min(HIGHEST, 0.4 / period)
    corner = found.volts_per_speed / max(found.inertia, 1e-12) / (2.0 * math.pi)
    per_line = 0.12 * speed * found.volts_per_speed
    sine = multi_sine(period, lowest, highest, lambda f: per_line * math.sqrt(1.0 + (f / corner) ** 2), seed)
    most = 0.45 * (machine.limit - base)
    peak = np.abs(sine.signal).max()
    if peak > most:
        sine = type(sine)(sine.lines, sine.rows, sine.signal * most / peak)
    settle = machine.periods(0.15)
    count = max(int((length / speed / period - settle) / sine.rows), 1)
    centre, parts, records = machine.position, [], []
    for number in range(PASSES):
        sign = 1.0 if number % 2 == 0 else -1.0
        rows = settle + count * sine.rows + 1
        extra = np.concatenate([np.tile(sine.signal, -(-settle // sine.rows) + 1)[-settle:], sine.times(count), sine.signal[:1]])
        place = centre - sign * 0.5 * length
        _creep(machine, place, found, records)
        record = machine.run(np.full(rows, machine.position), lambda n, x, i, b=sign * base + found.offset: b, extra,
                             until=lambda n, x, i, s=sign: s * (x - centre) > 0.75 * length)
        records.append(record)
        whole = (len(record) - 1 - settle) // sine.rows
        if whole >= 1:
            stop = settle + whole * sine.rows + 1
            parts.append(tuple(record[name][settle:stop] for name in ("encoder_m", "voltage_V", "disturbance_V")))
    _creep(machine, centre, found, records)
    keep("sliding_open_loop", joined(records))
    plant, _ = responses(parts, sine, period, "sliding") if parts else (None, None)
    return plant


def _creep(machine, place, found, records):
    """By constant voltages to about a place."""
    for _ in range(4):
        way = place - machine.position
        if abs(way) < 1e-4:
            return
        sign = math.copysign(1.0, way)
        speed = slide_speed(machine, found)
        volts = sign * (found.friction + (found.volts_per_speed + found.viscous) * speed) + found.offset
        rows = machine.periods(abs(way) / speed * 3.0 + 0.05)
        records.append(machine.run(np.full(rows, machine.position), lambda n, x, i, u=volts: u,
                                   until=lambda n, x, i, s=sign: s * (place - x) < 0.0))
