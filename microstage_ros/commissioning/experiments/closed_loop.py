"""Motion in closed loop on a machine that is only roughly known: gentle gains, guarded errors, a reason when it
stops."""

import math

import numpy as np

from microstage_ros.commissioning.findings import Refused, refused
from microstage_ros.commissioning.design.law_choice import slower
from microstage_ros.commissioning.design.programme import FASTEST, segments
from microstage_ros.commissioning.experiments.simulated_periods import LawCommand
from microstage_ros.control.design.rules import volts_per_acceleration
from microstage_ros.control.laws.controller import Controller, controller_parameters
from microstage_ros.control.trajectories.profiles import MotionLimits, jerk_limited_move
from microstage_ros.model.actuators import actuator_of

ERROR, LAG = 6e-5, 0.025  # largest following error: metres, and seconds of the largest speed of a motion; a loop
# that needs more to bring its drive to the command of that speed (`Loop.lag`) has that in place of the metres
LOOSE = 5e-4  # where the way has been gone before, and nothing stands in it [m]
SHARE = 5e-4  # of the travel, where that is more
STANDS = 0.2  # of the reference's speed: slower is standing
SWING, SWING_COUNTS = 4e-7, 12.0  # peak to peak at rest that is no rest: m, counts
SOFTER, SOFTEST = 0.8, 0.3  # of the bandwidth at each swing; least
HOLD = 0.5  # s
HEAVIER = 2.5  # times the sliding friction as found: it varies along the travel, and is larger at a slow start
PUSH = 1.6  # times the voltage that a speed needs, that a motion may use


def there_and_back(x):
    """Way [m] that a position ``x`` [m], shape (n,), went beyond both its first and its last value: nothing for one
    that stands, is wound up against a stop, or runs one way."""
    x = x[np.isfinite(x)]
    return float(max(x.max() - max(x[0], x[-1]), min(x[0], x[-1]) - x.min())) if len(x) else 0.0


class Loop:
    """One controller on one machine.

    Parameters
    ----------
    machine : `Machine`. axis : `Axis` as known. law : type of controller. sliding : friction [V].
    gains : of the law, over those of the rules.
    """

    def __init__(self, machine, axis, law="self_tuning", sliding=0.0, gains=None):
        self.machine, self.axis, self.law, self.share = machine, axis, law, 1.0
        self.sliding, self._gains, self._slowed = sliding, dict(gains or {}), {}
        self._model = controller_parameters("pid_feedforward", axis, {})["feedforward"]
        self.controller = self._made()

    def _made(self, limit=None):
        axis = self.axis if limit is None else actuator_of(self.axis).limited(self.axis, limit)
        parameters = controller_parameters(self.law, axis, self._gains)
        if self.share != 1.0:
            pid = {name: float(parameters["pid"][name]) for name in parameters["pid"].dtype.names}
            self._slowed = slower(pid, self.share)
            parameters = controller_parameters(self.law, axis, {**self._gains, **self._slowed})
        return Controller(self.law, parameters)

    @property
    def gains(self):
        """Gains that are not those of the rules."""
        return {**self._gains, **self._slowed}

    def limits(self, speed):
        """`MotionLimits` of a motion at up to ``speed`` [m/s]: within what the drive can do."""
        machine = self.machine
        acceleration = min(0.15, 0.2 * machine.limit / max(volts_per_acceleration(self._model), 1e-9))
        return MotionLimits(min(speed, self.top_speed), acceleration, 100.0 * acceleration)

    @property
    def top_speed(self):
        """Speed [m/s] that leaves half of the voltage, and is safe should the encoder fail."""
        volts = max(float(self._model["volts_per_velocity"]), 0.0)
        fastest = (
            0.5 * max(self.machine.limit - 2.0 * self.sliding, 0.1 * self.machine.limit) / volts if volts > 0.0 else 0.1
        )
        return min(fastest, self.machine.safe_speed)

    def _need(self, speed):
        """Command [V] of a motion at ``speed`` [m/s], its sliding friction `HEAVIER` times what was found."""
        return HEAVIER * self.sliding + max(float(self._model["volts_per_velocity"]), 0.0) * speed

    def lag(self, speed):
        """Following error [m] with which the proportional part alone makes the command of a ``speed`` [m/s].

        The drive needs u = f + K v, of a proportional gain P: u/P. The integral part and what is fed forward only make
        it less; a gain that was lowered until the stage rests, or that of a long period, makes it more.
        """
        return self._need(speed) / max(float(self.controller.parameters["pid"]["proportional"]), 1e-9)

    def _volts_per_speed(self, seconds):
        """Command per speed [V s/m] that a free stage reaches: against the back-EMF; else within ``seconds``."""
        held = float(self._model["volts_per_velocity"])
        return max(held if held > 0.0 else volts_per_acceleration(self._model) / seconds, 1e-9)

    def follow(self, reference, disturbance=None, error=ERROR, window=None, gentle=False, fresh=True, go_on=False):
        """Play a reference [m] from where the stage stands. Returns the `Record`.

        ``disturbance``: added to the voltage [V], shape (n,).
        ``gentle``: no more voltage than its speed needs (a stop in the way is touched, not rammed). Raises Refused with
        the reason where the error grows beyond ``error`` [m] (or `lag`) and `LAG`. ``fresh``: the law begins anew;
        ``go_on``: the next motion follows at once.
        """
        machine, period = self.machine, self.machine.period
        speed = float(np.abs(np.diff(reference)).max() / period) if len(reference) > 1 else 0.0
        controller = self.controller
        if gentle:
            controller = self._made(min(PUSH * (self._need(speed) + 0.05 * machine.limit), machine.limit))
        if fresh or gentle:
            controller.reset()
        blind = not math.isfinite(self.machine.current_offset)
        command = LawCommand(controller, reference, 0.0 if blind else self.machine.current_offset)
        allowed = max(error, SHARE * machine.stroke, self.lag(speed)) + LAG * speed
        try:
            record = machine.run(reference, command, disturbance, window, allowed, go_on=go_on)
        except Refused as end:
            if end.check.id == "encoder_dead" and math.isfinite(end.check.value):
                self._blocked_or_dead(end)
            raise
        if machine.ended == "error":
            self._explain(record, allowed)
        return record

    def go(self, place, speed=2e-3, gentle=False, dwell=0.15):
        """To a ``place`` [m] at up to ``speed`` [m/s], and rest there for ``dwell`` [s]. Returns the `Record`."""
        move = jerk_limited_move(self.machine.position, place, self.machine.period, self.limits(speed))
        return self.follow(
            np.append(move, np.full(self.machine.periods(dwell), place)),
            gentle=gentle,
            error=ERROR if gentle else LOOSE,
        )

    def settle(self):
        """Hold still; where the stage swings, softer gains, until it rests. Raises Refused (runaway)."""
        machine = self.machine
        while True:
            rows = machine.periods(HOLD)
            try:
                record = self.follow(np.full(rows, machine.position))
                tail = record["encoder_m"][rows // 2:]
                swing = float(np.ptp(tail[np.isfinite(tail)]))
            except Refused as end:  # a wide swing winds the train up: the motor turns while the encoder turns round
                if end.check.id != "runaway":
                    raise
                machine.failed, swing = None, abs(end.check.value)
            if swing < max(SWING, SWING_COUNTS * machine.count, 10.0 * machine.noise):
                return record
            self.share *= SOFTER
            if self.share < SOFTEST:
                raise refused(
                    "runaway",
                    swing,
                    "m",
                    f"at rest in closed loop the stage swings by {swing * 1e6:.3g} µm even at a third of the bandwidth",
                )
            self.controller = self._made()
            machine.rest(0.2)

    def _explain(self, record, allowed):
        """Why the stage did not follow."""
        machine = self.machine
        machine.failed = record
        rows = min(machine.periods(0.02, 10), len(record) - 1)
        x, r = record["encoder_m"][-rows:], record["reference_m"][-rows:]
        asked, moved = float(r[-1] - r[0]), float(x[-1] - x[0])
        place, sign = machine.position, math.copysign(1.0, asked or (r[-1] - x[-1]))
        last = min(machine.periods(0.004, 4), rows)
        volts, unit = float(np.mean(record.command[-last - 1:-1])), machine.command.unit  # the last row is zero
        free = max(abs(volts) - 2.0 * self.sliding, 0.0) / self._volts_per_speed(rows * machine.period)
        speed = abs(float(x[-1] - x[-last])) / (last * machine.period)
        wanted = abs(asked) / (rows * machine.period) if abs(asked) >= 2.0 * machine.count else math.inf
        if speed < STANDS * min(free, wanted):  # one that runs on past a reference that stands is not blocked
            back = self._retreat(-sign)
            if back:
                raise refused(
                    "end_stop",
                    place,
                    "m",
                    f"at {place * 1e3:.4g} mm the stage does not go on in direction {'+' if sign > 0 else '−'} "
                    f"({volts:.3g} {unit}) and goes back freely: an end stop or an obstacle inside the "
                    "travel of the sketch",
                )
            if np.ptp(x) == 0.0 and machine.position == x[-1]:
                raise refused(
                    "encoder_dead",
                    place,
                    "m",
                    f"the encoder stands on one count at {place * 1e3:.4g} mm whatever the voltage "
                    f"({volts:.3g} {unit} and back), where a live one would show the drive train give way",
                )
            raise refused(
                "stuck",
                place,
                "m",
                f"at {place * 1e3:.4g} mm the stage does not follow ({volts:.3g} {unit}), nor does it go back",
            )
        raise refused(
            "runaway",
            float(r[-1] - x[-1]),
            "m",
            f"the stage does not follow: {allowed * 1e6:.3g} µm behind and moving at"
            f" {moved / (rows * machine.period) * 1e3:.3g} mm/s where {asked / (rows * machine.period) * 1e3:.3g} mm/s"
            " is asked",
        )

    def _blocked_or_dead(self, end):
        """Refuse with an end stop where the motor turned against a stage that stands, and the encoder lives.

        A stage at a stop winds the drive train up: for some microns that looks like a motor that turns beside a dead
        encoder.
        """
        self.machine.failed = self.machine.last
        volts = float(np.mean(self.machine.last.command[-self.machine.periods(0.005, 5) - 1:-1]))
        sign, place, unit = math.copysign(1.0, volts), self.machine.position, self.machine.command.unit
        swing = there_and_back(self.machine.last["encoder_m"])
        stands = float(np.ptp(self.machine.last["reference_m"])) == 0.0
        if stands and swing > max(5.0 * SWING, SWING_COUNTS * self.machine.count):
            raise refused("runaway", swing, "m",
                          f"in closed loop the stage swings: {swing * 1e6:.3g} µm there and back") from end
        if self._retreat(-sign):
            raise refused(
                "end_stop",
                place,
                "m",
                f"at {place * 1e3:.4g} mm the stage does not go on in direction {'+' if sign > 0 else '−'} "
                f"({volts:.3g} {unit}), and goes back freely: an end stop or an obstacle inside the travel of the "
                "sketch",
            ) from end

    def _retreat(self, sign):
        """Whether the encoder shows the stage moving back at moderate voltages, for a tenth of a second at most."""
        machine = self.machine
        way, watch, before, braked = max(5e-6, 50.0 * machine.count), machine.watch, machine.last, machine.braked
        usual = watch.unseen if watch is not None else ()
        try:
            start = machine.position
            machine.watch = None  # the motor runs out, and winds the train up where the stage is blocked
            after, machine.watch = machine.rest(0.03), watch
            if watch is not None:  # a drive train that unwinds is no dead encoder; one that has unwound is
                wound = self._wound_up(before, after) + abs(braked)
                watch.unseen = tuple(wound + each for each in usual)
            stage = machine.periods(0.03, 10)
            volts = [
                sign * min(factor * max(self.sliding, 0.01 * machine.limit), machine.limit)
                for factor in (2.0, 3.0, 4.5)
            ]
            machine.run(
                np.full(3 * stage, start),
                lambda n, x, i: volts[n // stage],
                until=lambda n, x, i: sign * (x - start) > way,
            )
            return sign * (machine.position - start) > 0.5 * way
        finally:
            machine.watch = watch
            if watch is not None:
                watch.unseen = usual

    def _wound_up(self, *records):
        """Way [m at the stage] that the drive train is wound up at most at the end of records: what the motor has
        turned while the encoder stood."""
        x, u, i = (
            np.concatenate(parts)
            for parts in zip(*((record["encoder_m"], record.command, record["current_A"]) for record in records))
        )
        gone = np.flatnonzero(np.abs(x - x[-1]) > 4.0 * self.machine.count)
        return self.machine.watch.turned_at_most(u, i, int(gone[-1]) if len(gone) else 0)


def stroke(loop, keep, usual=24.0, longest=60.0):
    """Once along the travel and back to where it began; friction along the way. Returns rows (position, friction force
    in volts forwards, backwards), shape (n, 3), and the range [m] that was travelled. It takes about ``usual`` [s];
    where all of it would take more than ``longest`` [s], a part is travelled.
    """
    machine = loop.machine
    low, high = machine.travel
    inset = min(0.005 * machine.stroke, 3e-4)
    low, high, start = low + inset, high - inset, machine.position
    way = 2.0 * (high - low)
    speed = min(max(way / usual, 1e-4), 0.8 * loop.top_speed, machine.safe_speed)
    if way / speed > longest:  # too slow to see all of it
        half = 0.25 * speed * longest
        low, high = max(low, start - half), min(high, start + half)
    records = []
    for place in (high, low, start):
        records.append(go_gently(loop, place, speed))
    from microstage_ros.commissioning.experiments.first_motion import joined

    record = joined(records)
    keep("stroke", record)
    return _along(record, machine, speed), (low, high), record


def go_gently(loop, place, speed, trials=3):
    """To a ``place`` [m] at up to ``speed`` [m/s]; where the stage lags without being blocked, again at half the speed,
    ``trials`` times in all [1]. Returns the `Record`. Raises Refused: an end stop, a lag at every speed."""
    for trial in range(trials):
        try:
            return loop.go(place, speed / 2**trial, gentle=True)
        except Refused as end:
            if end.check.id != "runaway" or trial == trials - 1:
                raise
            loop.machine.failed = None
            loop.machine.rest(0.2)
    raise AssertionError


def _along(record, machine, speed, cells=50):
    """Mean voltage at constant speed in cells of travel, by direction."""
    v = np.gradient(record["reference_m"], machine.period)
    x, u = record["encoder_m"], record.command
    edges = np.linspace(np.nanmin(x), np.nanmax(x), cells + 1)
    rows = np.full((cells, 3), np.nan)
    rows[:, 0] = 0.5 * (edges[1:] + edges[:-1])
    for column, sign in ((1, 1.0), (2, -1.0)):
        steady = np.abs(v - sign * speed) < 0.01 * speed
        place = np.clip(np.digitize(x[steady], edges) - 1, 0, cells - 1)
        total, count = np.bincount(place, u[steady], cells), np.bincount(place, minlength=cells)
        rows[:, column] = np.where(count > 20, total / np.maximum(count, 1), np.nan)
    return rows


def programme(loop, centre):
    """The reference [m] of a record that tells most of the axis, about ``centre`` [m]: `programme.segments`."""
    from microstage_ros.control.runs.run_file import Run

    machine = loop.machine
    fast = min(FASTEST, 0.8 * loop.top_speed)
    return Run(program=segments(centre, machine.stroke, fast), limits=loop.limits(fast), start_m=centre).tables(
        machine.period
    )["reference"]
