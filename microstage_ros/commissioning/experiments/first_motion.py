"""The smallest commands that move anything: polarity, dead encoder, current sensor, delay, breakaway.

Short pulses of alternating sign rise from far below the expected breakaway until the encoder shows motion or the
current shows back-EMF. Below breakaway the stage already gives way elastically in the direction of the force, so the
sign is known before anything slides. Where nothing but the encoder tells motion (`Actuator.tells_turning`) much shorter
pulses (`short_pulses`) show first that it lives and which way it counts; then these tell the breakaway, so long that
the sketched mass, without any friction, goes `FREE_WAY` at most, with the opposite pulse after one that shows nothing.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from microstage_ros.commissioning.estimation.known import breakaway
from microstage_ros.commissioning.experiments.short_pulses import ShortPulses, felt
from microstage_ros.commissioning.findings import Check, refused
from microstage_ros.control.design.rules import volts_per_acceleration
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.model.actuators import actuator_of
from microstage_ros.quantities.command import VOLTAGE, command_of
from microstage_ros.records.record import Record

PULSE, REST = 0.04, 0.04  # s
RISE = 1.2  # from one level to the next
FIRST = 0.04  # of the expected breakaway voltage
# times the expected breakaway: friction, resistance and motor constant each twice what is sketched, and twice that
HIGHEST = 16.0
FREE_WAY, LEAST_PULSE = 1e-5, 5  # m; rows
LEAST_COUNTS, SIGMAS = 4.0, 6.0  # of motion
TURNED = 2e-6  # motion by the back-EMF after which the encoder must have shown some [m]
REPEATS = 2  # in each direction, once something moves
MOST_DELAY = 2.5  # periods beyond the one that the row convention has
LEAST_CURRENT, LEAST_SLOPE = 5.0, 0.02  # of the current on the command: standard errors; share of what is sketched
DRIFT = 2e-5  # m in the rest before anything is driven


@dataclass(frozen=True)
class FirstMotion:
    """What the pulses showed.

    Attributes
    ----------
    breakaway : command that moved the stage visibly [its unit]. resistance, resistance_error : command per ampere at
        rest: ohm of a winding, N m/A of a current-driven motor; NaN without a current.
    delay : periods between command and current beyond the one of the row convention, NaN without a current.
    has_current : there is a current sensor. noise : of the encoder [m]. current_noise : A.
    """

    breakaway: float
    resistance: float
    resistance_error: float
    delay: float
    has_current: bool
    noise: float
    current_noise: float


def expected_breakaway(axis):
    """`breakaway`; a fiftieth of the limit where that is more, as of an axis without friction."""
    return max(breakaway(axis), 0.02 * actuator_of(axis).command_limit(axis))


def look_at_rest(machine):
    """Noise of encoder [m] and current [A], offset of the current [A]; raises `Refused` if the machine moves."""
    record = machine.rest(0.3)
    x = record["encoder_m"]
    x = x[np.isfinite(x)]
    drift = float(np.mean(x[-len(x) // 4:]) - np.mean(x[:len(x) // 4]))
    if abs(drift) > DRIFT:
        raise refused(
            "runaway",
            drift,
            "m",
            f"without voltage the stage moved by {drift * 1e6:.3g} µm in 0.3 s: something else drives it",
        )
    noise = max(float(np.std(np.diff(x))) / math.sqrt(2.0), 0.3 * machine.count)
    current = record.columns.get("current_A")
    if current is None or not actuator_of(machine.axis).measures_current:
        return noise, math.nan, math.nan
    return noise, float(np.nanstd(current)), float(np.nanmean(current))


def first_motion(machine, sketch, keep):
    """Pulses until something moves. Returns (`FirstMotion`, list of `Check`).

    Parameters
    ----------
    machine : `Machine` that has begun. sketch : `Sketch`. keep : (name, record) -> None, stores a record.

    Raises
    ------
    Refused : wrong polarity, no motion, a dead encoder, a current of the wrong sign, a delay.
    """
    noise, current_noise, offset = look_at_rest(machine)
    keep("rest", machine.last)
    pulses = Pulses(machine, noise, current_noise, offset, sketch)
    expected = expected_breakaway(sketch.axis)
    known = any(f"contacts.{key}" in sketch.given for key in ("actuator.static", "guideway.static", "guideway.coulomb"))
    level, highest = FIRST * expected, min(machine.limit, HIGHEST * expected if known else math.inf)
    moved, seen = [], []
    if not actuator_of(sketch.axis).tells_turning:
        short = ShortPulses.of(sketch, expected, noise, machine.limit)
        highest, seen = _encoder_lives(machine, pulses, short, short.highest if known else machine.limit, keep)
    while not moved:
        for sign in (1.0, -1.0):
            found = pulses.one(sign * level)
            if found:
                moved.append(found)
                break
        if not moved and level >= highest:
            if seen:  # no longer pulse moves the stage while it lasts: what the short ones showed stands
                moved = [(each.level, each.way) for each in seen if each.tells_sign]
                break
            _nothing_moves(machine, pulses, level, keep, pulses.rows(level))
        if not moved:
            level = min(RISE * level, highest)
    last = moved[-1][0] if moved else seen[-1].level
    for k in range(2 * REPEATS - 1):  # the same again in both directions
        found = pulses.one(-math.copysign(level * RISE ** (k // 2), last))
        if found:
            moved.append(found)
            last = found[0]
    if not moved:  # nothing that tells the sign: what came back later is the best there is
        moved = [(each.level, each.way) for each in seen]
    _check_polarity(machine, pulses, moved, level, keep)
    record = pulses.record()
    keep("first_motion", record)
    return _judge(machine, sketch, pulses, record, moved, level)


def _encoder_lives(machine, pulses, short, highest, keep):
    """(level, [`Felt`, ...]) of the `ShortPulses` that moved the stage. Raises Refused: none did, or backwards."""
    level, seen = felt(pulses, short, highest)
    if not seen:
        _nothing_moves(machine, pulses, level, keep, short.rows)
    _check_polarity(machine, pulses, [(each.level, each.way) for each in seen if each.tells_sign], level, keep)
    return level, seen


def _check_polarity(machine, pulses, moved, level, keep):
    """Raise Refused where a positive command moved the encoder backwards, in ``moved``: (command, way [m])."""
    if sum(math.copysign(1.0, voltage * way) for voltage, way in moved) < 0.0:
        keep("first_motion", pulses.record())
        farthest, command = max(abs(way) for _, way in moved), machine.command
        raise refused(
            "polarity",
            farthest,
            "m",
            f"a positive {command.quantity} moves the encoder backwards ({len(moved)} pulses up to {level:.3g} "
            f"{command.unit}, {farthest * 1e6:.2g} µm): swap the motor's leads or the encoder's tracks A and B",
        )


def _nothing_moves(machine, pulses, level, keep, rows):
    record = pulses.record()
    keep("first_motion", record)
    _, _, slope, error = current_slope(record, pulses.offset)
    unit, actuator = machine.command.unit, actuator_of(machine.axis)
    flows = "current_A" in record.columns and abs(slope) > LEAST_CURRENT * error
    why = "the current flows, so the motor is held: brake, clamp, jammed or not coupled" if flows else (
        "no current flows either: enable, fuse, cable of the motor" if "current_A" in record.columns else
        "without a current sensor it cannot be determined whether the motor turns: brake, cable, encoder")
    if not actuator.tells_turning and (flows or not actuator.measures_current):
        why = (f"a {machine.command.quantity} does not tell whether the motor turns: brake, clamp, enable, or an "
               "encoder that does not count")
    raise refused("stuck", level, unit, f"nothing moves up to ±{level:.3g} {unit} in pulses of "
                  f"{rows * machine.period * 1e3:.3g} ms; {why}")


@dataclass
class _Seen:
    """What one pulse has shown so far."""

    moved: int = 0
    """Rows in a row with the encoder away from its start [1]."""
    turned: float = 0.0
    """Travel of the motor by its back-EMF [m]."""
    first: list = field(default_factory=list)
    """First currents [A]."""


class Pulses:
    """Pulses and what is kept of them: ``machine``, ``threshold`` of motion [m], ``rest`` after a pulse [s],
    ``records``."""

    rest = REST

    def __init__(self, machine, noise, current_noise, offset, sketch):
        self.machine, self.noise, self.offset = machine, noise, 0.0 if math.isnan(offset) else offset
        self.threshold = max(LEAST_COUNTS * machine.count, SIGMAS * noise)
        self.current_noise, self.records = current_noise, []
        axis = sketch.axis
        actuator = actuator_of(axis)
        emf = actuator.emf_per_speed(axis) if actuator.tells_turning else 0.0
        self._turning = machine.period / emf if emf else None  # metres per volt of drop in one period
        self._inertia = volts_per_acceleration(controller_parameters("pid_feedforward", axis, {})["feedforward"])

    def rows(self, level):
        """Periods of a pulse of ``level`` [unit of the command]."""
        longest = PULSE
        if self._turning is None:
            longest = min(PULSE, math.sqrt(2.0 * FREE_WAY * self._inertia / abs(level)))
        return self.machine.periods(longest, 20 if longest == PULSE else LEAST_PULSE)

    def one(self, voltage):
        """One pulse and a rest. Returns (voltage, displacement [m]) if the stage moved, None otherwise.

        ``voltage`` [V]. Raises `Refused` where the back-EMF shows that the motor turned and the encoder stood still.
        """
        machine = self.machine
        rows, rest = self.rows(voltage), machine.periods(REST, 20)
        start = machine.position
        turning, seen = self._turning, _Seen()
        settle = max(3, machine.periods(1e-3))

        def ends(n, x, i):
            moved = x - start
            seen.moved = seen.moved + 1 if abs(moved) > self.threshold else 0
            if seen.moved >= 3:
                return True
            if turning is not None and math.isfinite(i) and n > settle + 8:
                self._watch(seen, n, abs(turning * voltage), i - self.offset)
                if seen.turned > TURNED and abs(moved) < 0.2 * seen.turned:
                    raise refused(
                        "encoder_dead",
                        moved,
                        "m",
                        f"at {voltage:.3g} {machine.command.unit} the motor turned as for {seen.turned * 1e6:.2g} µm "
                        f"(by its back-EMF), and the encoder showed {moved * 1e6:.2g} µm",
                    )
            return False

        first = machine.run(np.full(rows, start), lambda n, x, i: voltage, until=lambda n, x, i: ends(n, x, i))
        moved, ended = machine.position - start, machine.ended
        brake = rows if turning is None and ended != "until" else 0
        after = machine.run(np.full(brake + rest, start), lambda n, x, i: -voltage if n < brake else 0.0)
        self.records += [first, after]
        return (voltage, moved) if ended == "until" else None

    def _watch(self, seen, n, most, current):
        """Sum up the drop of the current against its first level: volts of back-EMF over the sketch's constant.

        ``most`` [m]: travel in one period at which the back-EMF would be the whole voltage.
        """
        if len(seen.first) < 6:
            seen.first.append(current)
            return
        level = float(np.mean(seen.first))
        if abs(level) < 8.0 * max(self.current_noise, 1e-9):
            return
        seen.turned = max(seen.turned + most * (1.0 - current / level), 0.0)
        noise_level = 4.0 * most * self.current_noise / abs(level) * math.sqrt(n)
        seen.turned = seen.turned if seen.turned > noise_level else seen.turned * 0.999

    def record(self):
        """All pulses as one record."""
        return joined(self.records)


def joined(records):
    """Records that followed each other, as one."""
    sent = command_of(records[0].columns) or VOLTAGE
    known = "encoder_m", "reference_m", sent.column, "current_A", "motor_angle_rad", sent.disturbance
    names = [name for name in known if any(name in r.columns for r in records)]
    columns = {name: np.concatenate([r.columns.get(name, np.full(len(r), 0.0 if name == sent.disturbance else math.nan))
                                     for r in records]) for name in names}
    return Record(records[0].period_s, columns, metadata=dict(records[0].metadata))


def current_slope(record, offset, lag=1):
    """(lag [rows], resistance, slope [A/V], its standard error) of the current on the voltage ``lag`` rows before.

    ``offset``: reading of the current sensor at rest [A].
    """
    u, i = record.command, record.columns.get("current_A")
    if i is None:
        return lag, math.nan, math.nan, math.inf
    u, i = u[:-lag] if lag else u, i[lag:] - offset
    good = np.isfinite(i)
    u, i = u[good], i[good]
    power = float(u @ u)
    if power <= 0.0:
        return lag, math.nan, math.nan, math.inf
    slope = float(u @ i) / power
    left = float(np.std(i - slope * u))
    error = max(left / math.sqrt(power), 1e-12)
    return lag, 1.0 / slope if slope else math.inf, slope, error


def current_delay(record, offset, most=24):
    """Periods between voltage and current beyond one: the lag at which, about the edges of the voltage, the current
    follows it best. In periods [1], of up to ``most`` [1]; ``offset``: reading of the current sensor at rest [A]."""
    u, i = record.command, np.nan_to_num(record["current_A"] - offset)
    edges = np.flatnonzero(np.diff(u) != 0.0) + 1
    rows = np.unique((edges[:, None] + np.arange(-4, most)[None]).ravel())
    rows = rows[(rows >= most) & (rows < len(u))]
    left = []
    for lag in range(most):
        a, b = u[rows - lag], i[rows]
        left.append(float(np.mean((b - a * float(a @ b) / max(float(a @ a), 1e-300)) ** 2)))
    return float(int(np.argmin(left)) - 1)


def _judge(machine, sketch, pulses, record, moved, level):
    farthest, command = max(abs(displacement) for _, displacement in moved), machine.command
    moves = f"a positive {command.quantity} moves the stage forwards ({len(moved)} pulses, {level:.3g} {command.unit})"
    checks = [
        Check("polarity", True, farthest, "m", moves),
        Check("encoder_dead", True, farthest, "m", "the encoder counts when the stage moves"),
        Check("stuck", True, level, command.unit, f"the stage moves from {level:.3g} {command.unit}"),
    ]
    resistance, error, delay = _current(machine, sketch, pulses, record, checks)
    has_current = math.isfinite(resistance)
    return FirstMotion(level, resistance, error, delay, has_current, pulses.noise, pulses.current_noise), checks


def _current(machine, sketch, pulses, record, checks):
    """(command per ampere, its standard error, delay [periods]), all NaN without a current; adds its checks to
    ``checks``."""
    actuator, unit = actuator_of(sketch.axis), "ohm" if machine.command is VOLTAGE else f"{machine.command.unit}/A"
    if not actuator.measures_current:
        checks.append(Check("current_missing", True, math.nan, "A", "not needed: the command is the force"))
        return math.nan, math.nan, math.nan
    slope, error, delay = 0.0, math.inf, 0.0
    if "current_A" in record.columns:
        delay = current_delay(record, pulses.offset)
        _, _, slope, error = current_slope(record, pulses.offset, max(int(delay) + 1, 0))
    if not abs(slope) > max(LEAST_CURRENT * error, LEAST_SLOPE * actuator.amperes_per_command(sketch.axis)):
        missing = ("the resistance stays as sketched, and friction and back-EMF are estimated from the voltage"
                   if actuator.emf_key else f"the {machine.command.quantity} is taken as it is commanded")
        checks.append(Check("current_missing", True, math.nan, "A", f"no current sensor answers: {missing}"))
        return math.nan, math.nan, math.nan
    found = 1.0 / slope
    checks.append(Check("current_missing", True, slope, "A/V" if unit == "ohm" else f"A/({machine.command.unit})",
                        f"the current answers the {machine.command.quantity}"))
    if found < 0.0:
        raise refused(
            "current_polarity",
            found,
            unit,
            f"the current is negative for a positive {machine.command.quantity} that moves the stage "
            "forwards: turn the current sensor round, or the sign of its scale",
        )
    checks.append(Check("current_polarity", True, found, unit,
                        f"{found:.3g} {unit} from {machine.command.quantity} and current at rest"))
    if delay > MOST_DELAY:
        raise refused("delay", delay, "periods", f"the current follows the command {delay:g} periods late "
                      f"({delay * machine.period * 1e3:.3g} ms): buffers of the card, filters, the bus")
    return found, found * error / slope, delay
