"""The frequency response while a constant voltage slides the stage, before any loop is closed: its back-EMF holds the
speed.

A command that is a torque or a force has no back-EMF: a slow speed loop takes its place (`Slide`), and the response is
that of the plant all the same, by the joint input-output method.
"""

import math

import numpy as np

from microstage_ros.commissioning.estimation.frequency_response import multi_sine, responses
from microstage_ros.commissioning.experiments.first_motion import joined
from microstage_ros.commissioning.findings import refused
from microstage_ros.model.actuators import actuator_of

STANDS = 0.04  # without a count of the encoder at a command that moved it before, or in the midst of a motion [s]
STILL_COUNTS = 1.5  # within which it stands: flickering between two
TURNED = 0.01  # how long the push is turned round where the encoder stands [s]: a dead one is named within 0.05 s
HARDER = 2.0  # so many times the friction as fitted then [1]: it varies by 15 % (1.15/0.85), and the fit of few
# strokes at speed shares friction and viscosity out wrongly by as much again
# of the base motion: m/s, of the travel, of the speed at the limit
SLIDE_SPEED, SLIDE_SHARE, TOP_SHARE = 3e-3, 0.12, 0.25
SPEED_RATE, SPEED_FILTER = 20.0, 5e-3  # of the slow speed loop: 1/s, and the filter of its speed [s]
PASSES, LOWEST, HIGHEST = 6, 5.0, 1200.0  # base motions; Hz


def slide_speed(machine, found):
    """Speed of the base motion [m/s]; ``found``: `open_loop.Strokes`."""
    top = max((machine.limit - found.friction) / max(found.volts_per_speed, 1e-9), 1e-6)
    return min(SLIDE_SPEED, TOP_SHARE * top, machine.safe_speed)


class Slide:
    """The command of a base motion at constant speed: constant against a back-EMF, a slow speed loop without one.

    Parameters
    ----------
    machine : `Machine`. found : `Strokes`. actuator : `Actuator` class of the drive.

    Attributes
    ----------
    held : whether the back-EMF holds the speed. volts_per_speed : command per deviation of the speed from the base's
        [V s/m], by the back-EMF or the speed loop.
    """

    def __init__(self, machine, found, actuator):
        self._machine, self._found, self.held = machine, found, bool(actuator.emf_key)
        self._gain = 0.0 if self.held else SPEED_RATE * max(found.inertia, 0.0)
        self.volts_per_speed = found.volts_per_speed + self._gain

    def base(self, speed):
        """Command [V] of a speed [m/s], with its sign; zero at rest."""
        found = self._found
        if speed == 0.0:
            return 0.0
        return math.copysign(found.friction, speed) + (found.volts_per_speed + found.viscous) * speed + found.offset

    def command(self, speed):
        """(n, encoder, current) -> command [V] that slides at ``speed`` [m/s], with its sign.

        Where the encoder stands the push is turned round for a moment, and is as much larger as friction varies: a
        stage that sticks gives way then, and is pushed so on its way too until it slides. It raises Refused
        (encoder_dead) where the encoder sees nothing of that either: a speed loop would push without end.
        """
        machine, base, gain = self._machine, self.base(speed), self._gain
        friction = math.copysign(max(self._found.friction, 0.0), speed)
        share, same = min(machine.period / SPEED_FILTER, 1.0), STILL_COUNTS * machine.count
        stands = machine.periods(STANDS, 20) if speed else math.inf
        turned_for = machine.periods(TURNED, 10)
        before, seen = machine.position, 0.0
        place, since, turned, more = machine.position, 0, False, 0.0

        def command(n, x, i):
            nonlocal before, seen, place, since, turned, more
            seen, before = seen + share * ((x - before) / machine.period - seen), x
            if abs(x - place) > same:
                place, since, turned = x, n, False
            elif turned and n - since >= turned_for:
                raise refused(
                    "encoder_dead", 0.0, "m",
                    f"the encoder stands for {STANDS * 1e3:.0f} ms at a {machine.command.quantity} that slid the stage "
                    "before, nor moves when that is turned round: its cable or reading head has failed since (or the "
                    "stage was clamped)",
                )
            elif not turned and n - since >= stands:
                since, turned, more = n, True, (HARDER - 1.0) * friction
            if turned:
                return -base - more
            return base + (more if abs(seen) < 0.5 * abs(speed) else 0.0) + gain * (speed - seen)

        return command


def sliding_response(machine, found, seed, keep):
    """Frequency response at a constant base voltage, to and fro. Returns the plant's `Response`, or None without a
    stroke long enough. ``found``: `open_loop.Strokes`; ``seed``: of the phases [1]."""
    speed, slide = slide_speed(machine, found), Slide(machine, found, actuator_of(machine.axis))
    base = found.friction + (found.volts_per_speed + found.viscous) * speed
    period, length = machine.period, min(SLIDE_SHARE * machine.stroke, 8e-3)
    lowest = max(LOWEST, 4.0 * speed / length)
    highest = min(HIGHEST, 0.4 / period)
    corner = slide.volts_per_speed / max(found.inertia, 1e-12) / (2.0 * math.pi)
    per_line = 0.12 * speed * slide.volts_per_speed
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
        extra = np.concatenate(
            [np.tile(sine.signal, -(-settle // sine.rows) + 1)[-settle:], sine.times(count), sine.signal[:1]]
        )
        place = centre - sign * 0.5 * length
        _creep(machine, place, slide, speed, records)
        record = machine.run(
            np.full(rows, machine.position),
            slide.command(sign * speed),
            extra,
            until=lambda n, x, i, s=sign: s * (x - centre) > 0.75 * length,
        )
        records.append(record)
        whole = (len(record) - 1 - settle) // sine.rows
        if whole >= 1:
            stop = settle + whole * sine.rows + 1
            parts.append(tuple(v[settle:stop] for v in (record["encoder_m"], record.command, record.disturbance)))
    _creep(machine, centre, slide, speed, records)
    if not slide.held:
        records.append(machine.run(np.full(machine.periods(0.1), machine.position), slide.command(0.0)))
    keep("sliding_open_loop", joined(records))
    plant, _ = responses(parts, sine, period, "sliding") if parts else (None, None)
    return plant


def _creep(machine, place, slide, speed, records):
    """By sliding at ``speed`` [m/s] to about a place."""
    for _ in range(4):
        way = place - machine.position
        if abs(way) < 1e-4:
            return
        sign = math.copysign(1.0, way)
        rows = machine.periods(abs(way) / speed * 3.0 + 0.05)
        records.append(
            machine.run(
                np.full(rows, machine.position),
                slide.command(sign * speed),
                until=lambda n, x, i, s=sign: s * (place - x) < 0.0,
            )
        )
