"""Before any loop is closed: motor constants, inertia and sliding friction from short strokes."""

import math
from dataclasses import dataclass

import numpy as np

from microstage_ros.commissioning.findings import refused
from microstage_ros.commissioning.experiments.dead_encoder import EncoderWatch, standing
from microstage_ros.commissioning.experiments.encoder_scale import scale_check
from microstage_ros.commissioning.experiments.first_motion import joined
from microstage_ros.commissioning.experiments.sliding import STANDS, STILL_COUNTS, TURNED, Slide
from microstage_ros.commissioning.estimation.plant_fit import resonance_of
from microstage_ros.commissioning.estimation.smoothing import SMOOTH, smoothed
from microstage_ros.model.actuators import actuator_of
from microstage_ros.signals.rows import bridged, of_row_before

STROKE, SHARE = 1.5e-4, 0.02  # of the first strokes: metres, and share of the travel
LONGEST_WINDOW = 0.03  # of the low-pass of the strokes [s]


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
            machine.period,
            first.resistance,
            most,
            machine.current_offset,
            machine.count,
            rough=True,
            standing=standing(sketch, machine.count),
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
    return found, scale_check(found, sketch)


def _stroke(machine, centre, reach, voltage, longest, parts):
    """One stroke at constant voltage, and whether it came to its end. Where the encoder stands it is cut short, and
    followed by a rest.

    Raises Refused (encoder_dead) where not one count shows, nor when the voltage is turned round: contacts that are
    loaded already give way no further at a voltage a quarter higher, but they do at a reversal.
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
        if not last[1] and not _gives_way(machine, -voltage, parts):
            raise refused(
                "encoder_dead",
                0.0,
                "m",
                f"{voltage:.3g} {machine.command.unit} for {STANDS * 1e3:.0f} ms do not move the encoder by one count,"
                " nor does the reversal, where less did before: its cable or reading head has failed since (or the"
                " stage was clamped)",
            )
        parts.append(machine.rest(STANDS))
    return arrived


def _gives_way(machine, voltage, parts):
    """Whether the encoder leaves its place at a voltage [V], which is taken away as soon as it does."""
    place, same = machine.position, STILL_COUNTS * machine.count
    reference = np.full(machine.periods(TURNED, 10), place)
    parts.append(machine.run(reference, lambda n, x, i: voltage, until=lambda n, x, i: abs(x - place) > same))
    return machine.ended == "until"


def fit_strokes(record, sketch, first, period):
    """`Strokes` by least squares of the voltage balance (and of the torque balance, with a current).

    All sides of each balance pass the same low-pass, which leaves the balance as it is. It is longer than the drive
    train swings: while it swings, motor and stage have different accelerations, and the inertia would come out up to
    three times too low. Voltage and current are read at the ends of periods, the encoder's way over one is that of the
    mean speed: of what is proportional to the speed at the ends, u − R i = K v, the mean of both ends is taken
    (trapezoidal rule; its error is (T/τ)²/12 of a part of the speed that settles with the time constant τ). Of what
    drives the inertia it is the mean over the period: of a command, which is held, its own value; of a current, which
    jumps with the voltage, what follows from the first balance.

    ``first``: `FirstMotion`; ``period``: of control [s].
    """
    window = np.hanning(_long_rows(sketch.axis, period) + 2)[1:-1]
    window /= window.sum()

    def low(values):
        return np.convolve(values, window, "valid")[1:-1]

    def of_both_ends(values):
        return low(0.5 * (values + of_row_before(values)))

    x = bridged(record["encoder_m"])
    speed = np.diff(x, prepend=x[0]) / period
    v, a, sign = low(speed), low(np.gradient(speed, period)), low(np.sign(smoothed(record, period)[1]))
    fast = np.abs(v) > 0.15 * np.abs(v).max()
    held, top = of_row_before(record.command), float(np.abs(v).max())
    motion = np.column_stack([a, sign, v, np.ones(len(v))])[fast]
    if not actuator_of(sketch.axis).emf_key:
        return _forced(motion, low(held)[fast], first, top)
    if not first.has_current:
        return _balanced(motion, low(held)[fast], None, None, sketch, top)
    voltage, current = (of_both_ends(values)[fast] for values in (held, np.nan_to_num(record["current_A"])))
    return _balanced(motion, low(held)[fast], voltage, current, sketch, top)


def _balanced(motion, held, u, i, sketch, top):
    """`Strokes` by least squares of u = R i + K v + o and R i = J a + F sign(v) + B v + o; without a current of both in
    one.

    Parameters
    ----------
    motion : (n, 4): acceleration, sign of the velocity, velocity [SI], ones. held : voltage over the period (n,) [V].
        u, i : voltage (n,) [V] and current (n,) [A], mean of the readings at the ends, or None.
        top : largest speed [m/s].
    """
    if i is None:
        inertia, friction, viscous, offset = np.linalg.lstsq(motion, held, rcond=None)[0]
        resistance = sketch.axis.value("drive.resistance") if sketch.axis.has("drive.resistance") else math.nan
        return Strokes(resistance, float(viscous), float(inertia), float(friction), float(offset), 0.0, False, top)
    resistance, emf, offset = np.linalg.lstsq(np.column_stack([i, motion[:, 2], motion[:, 3]]), u, rcond=None)[0]
    inertia, friction, viscous, zero = np.linalg.lstsq(motion, i + (held - u) / resistance, rcond=None)[0]
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


def _long_rows(axis, period):
    """Rows of a Hann window whose first zero, 2 over its length, lies at a third of the sketched resonance."""
    expected = resonance_of(axis)
    length = min(max(6.0 / expected, SMOOTH), LONGEST_WINDOW) if math.isfinite(expected) else SMOOTH
    return max(int(length / period) | 1, 7)
