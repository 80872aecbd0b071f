"""The machine in hand: control periods through the backend's `read` and `write`, recorded and guarded.

Every period passes `Machine.run`; nothing else writes a command, but for `simulated_periods`, which it calls. It clips
commands, ends with zero on every way out, and ends when the encoder leaves the window, jumps, stops counting while the
motor turns, or loses its number.
What is called voltage here is the drive's command in its own unit: volts, or newton metres of a current-driven motor.
"""

import math
import time

import numpy as np

from microstage_ros.commissioning.experiments.dead_encoder import BRAKE, BRAKED
from microstage_ros.commissioning.experiments.simulated_periods import LawCommand, law_periods
from microstage_ros.commissioning.findings import Refused, Stopped, refused
from microstage_ros.hardware.protocol import HardwareError, instruments, safety_members
from microstage_ros.model.actuators import actuator_of
from microstage_ros.records.record import Record

LOOK = 0.01  # time between two looks at the last stretch of the run [s]
MOST_SILENT = 5  # readings in a row without a number
BRAKES, LONGEST_BRAKE, AFTER_BRAKE = (
    4,
    0.03,
    8,
)  # pulses against the motion, their length [s], rows without voltage after each
SLOWEST_BRAKED = 1e-4  # m/s
LONGEST = 290.0  # of machine time [s]
SILENCE = 0.1
"""Longest time [s] without a voltage in a run before the card's own watchdog cuts the output, where it has one: longer
than the pause between two runs of which the second goes on. Between others, while something is computed at zero volts,
it is disarmed."""
JUMP = 3.0  # times the speed at the voltage limit that no encoder can show
SPIN = 2e-4  # the last part of a wait that is spun [s]


class Machine:
    """A backend that is open.

    Parameters
    ----------
    backend : of `hardware.make_hardware`, open. axis : `Axis` of the sketch. clock : paced by the wall clock.

    Attributes
    ----------
    command : `quantities.command.Command`, what the drive is commanded with. limit : largest command [its unit].
    travel : window [m] that the encoder may not leave. position : last reading [m]. rows : periods so far.
    watch : `EncoderWatch` once there are motor constants: the current tells a dead encoder in motion. None without.
    instruments : what the backend's own instruments told: interval_s (least and greatest of the readings),
    temperature_K (list), index_m. safe_speed : from which a dead encoder lets the stage go 10 µm at most [m/s];
    infinite without a current. braked : way of the motor while braked last [m]. used : greatest and least position [m]
    so far. most_command : greatest command so far [its unit].
    """

    def __init__(self, backend, axis, paced=False):
        self._backend, self._paced, self._due = backend, paced, None
        self._members, self._instruments = safety_members(backend), instruments(backend)
        self._clock, self.instruments = self._instruments.get("reading_time"), {}
        self.axis, self.period = axis, axis.value("period")
        self.command, self.limit = actuator_of(axis).command, actuator_of(axis).command_limit(axis)
        low, high = axis.value("travel.minimum"), axis.value("travel.maximum")
        self.stroke = high - low
        margin = min(0.01 * self.stroke, 5e-4)
        self.travel = (low + margin, high - margin)
        self.count = max(axis.value("sensors.encoder.resolution"), 1e-12)
        self.position, self.rows, self.started = math.nan, 0, False
        self.watch, self.top_speed, self.time_offset, self.delay = None, math.inf, 0.0, 0
        self.safe_speed, self.braked = math.inf, 0.0
        self.noise, self.current_offset, self.last, self.failed = 0.0, 0.0, None, None
        self._armed, self.zeroed = False, False
        self.used, self.most_command = {"travel_min_m": math.inf, "travel_max_m": -math.inf}, 0.0

    @property
    def time(self):
        """Machine time so far [s]."""
        return self.time_offset + self.rows * self.period

    def periods(self, seconds, least=1):
        """So many ``seconds`` [s] in control periods, at least ``least`` [1]."""
        return max(round(seconds / self.period), least)

    def run(self, reference, command, disturbance=None, window=None, error=math.inf, until=None, go_on=False):
        """Control periods, one per entry of ``reference`` [m].

        Parameters
        ----------
        command : (n, encoder, current) -> voltage [V]. disturbance : added to it [V], shape as reference.
        window : (low, high) [m] within the travel. error : largest reference − encoder [m]; beyond it the run ends and
            `ended` is "error". until : (n, encoder, current) -> True to end the run.
        go_on : another run follows at once: the last voltage stays where this one ends as planned.

        Returns
        -------
        `Record` of the periods that were run; ``ended`` says why they ended: "rows", "until" or "error".

        Raises
        ------
        Refused : the encoder fails or leaves the travel. Stopped : the hardware's own error, or no time left.
        """
        rows, backend = len(reference), self._backend
        if self.time + rows * self.period > LONGEST:
            raise Stopped(f"more than {LONGEST:g} s of machine time would be needed")
        table = np.full((5, rows), math.nan)
        columns: list[memoryview[float]] = [memoryview(row) for row in table]
        encoder, current, angle, voltage, added = columns
        low, high = (max(window[0], self.travel[0]), min(window[1], self.travel[1])) if window else self.travel
        extra = None if disturbance is None else np.asarray(disturbance, float).tolist()
        wanted, limit, look = np.asarray(reference, float).tolist(), self.limit, self.periods(LOOK, 10)
        jump = JUMP * min(self.top_speed, 1e3) * self.period + 40.0 * self.count
        clock, stamps = self._clock, []
        silent, n, self.ended, before, planned, u = 0, 0, "rows", self.position, False, 0.0
        watch, self.braked = self.watch, 0.0
        if watch is not None:
            watch.begin()
        try:
            self._arm(True)
            done, reading = 0, None
            if isinstance(command, LawCommand) and command.compiled and until is None:
                done, reading = self._simulated(command, wanted, extra, table, (low, high, jump, error))
            if done:
                n, before, u = done - 1, encoder[done - 1], voltage[done - 1]
            for n in range(done, rows):
                if self._paced:
                    self._wait()
                x, i, motor = reading or backend.read()
                reading = None
                encoder[n], current[n], angle[n] = x, i, motor
                if clock is not None:
                    stamps.append(clock())
                if not math.isfinite(x):
                    silent += 1
                    if silent > MOST_SILENT:
                        raise refused(
                            "encoder_dead", silent, "1", f"the encoder gave no number {silent} times in a row"
                        )
                    x = before
                elif abs(x - before) > jump:
                    raise refused(
                        "encoder_dead",
                        x - before,
                        "m",
                        f"the encoder jumped by {(x - before) * 1e6:.3g} µm in one period",
                    )
                else:
                    silent = 0
                if not low <= x <= high:
                    self._beyond(x, window)
                before = x
                if watch is not None:
                    watch.row(x, u, i)
                u = command(n, x, i)
                if extra is not None:
                    added[n] = extra[n]
                    u += extra[n]
                u = min(max(u, -limit), limit) if math.isfinite(u) else 0.0
                voltage[n] = u
                backend.write(u)
                if abs(wanted[n] - x) > error:
                    self.ended = "error"
                    break
                if until is not None and until(n, x, i):
                    self.ended = "until"
                    break
                if n % look == look - 1:
                    self._look(table, n)
                    if watch is not None:
                        watch.look(table[0], table[3], table[1], n)
            planned = self.ended == "rows"
        except HardwareError as problem:
            raise Stopped(f"the hardware reported: {problem}") from problem
        except Refused as end:
            if end.check.id == "encoder_dead" and watch is not None and watch.inertia > 0.0:
                self._brake(watch, table[3, max(n - AFTER_BRAKE, 0) : n], table[1, max(n - AFTER_BRAKE, 0) + 1 : n + 1])
            raise
        finally:
            if not (go_on and planned):
                self._zero()
                table[3, n] = 0.0  # what the drive holds until the next run's first reading
            self.position, self.rows = before, self.rows + n + 1
            self._note(table[:, : n + 1])
            self._note_stamps(stamps)
            self.last = self._record(table[:, : n + 1], np.asarray(reference, float)[: n + 1])
        return self.last

    def _simulated(self, command, wanted, extra, table, bounds):
        """As many periods of a simulated machine as compiled code can do: their number, and the reading after them that
        it left to `run`, None for none. ``bounds``: encoder from, to, its jump, error [m]."""
        arrays = getattr(self._backend, "arrays", None)  # of `SimulatedAxis` alone
        if arrays is None or self._paced or self.watch is not None or self._clock is not None or self._members:
            return 0, None
        added = np.zeros(len(wanted)) if extra is None else np.array(extra)
        bounds = np.array([self.position, *bounds, self.limit, command.offset])
        machine, law, held = tuple(arrays), command.controller.arrays, self._backend.held
        n = law_periods(machine, law, held, np.array(wanted), added, table, bounds)
        if extra is not None:
            table[4, :n] = added[:n]
        if n:
            self._backend.write(table[3, n - 1])
        return n, self._backend.last_reading if n < len(wanted) else None

    def _brake(self, watch, voltages, currents):
        """Stop the motor, whose speed only the back-EMF tells: pulses against it, and a look without voltage after
        each."""
        speed, volts = watch.speed(voltages, currents), BRAKE * self.limit
        try:
            for _ in range(BRAKES):
                if abs(speed) < SLOWEST_BRAKED:
                    break
                pulse = min(self.periods(BRAKED * watch.brake_time(speed, volts)), self.periods(LONGEST_BRAKE))
                sent, seen = [math.copysign(volts, -speed)] * pulse + [0.0] * AFTER_BRAKE, []
                for u in sent:
                    self._backend.write(u)
                    if self._paced:
                        self._wait()
                    seen.append(self._backend.read()[1])
                self.rows += len(sent)
                self.braked += watch.speed(sent, seen) * len(sent) * self.period
                speed = watch.speed(sent[-AFTER_BRAKE // 2 :], seen[-AFTER_BRAKE // 2 :])
            self._backend.write(0.0)
        except HardwareError as problem:
            raise Stopped(f"the hardware reported: {problem}") from problem

    def rest(self, seconds):
        """So many ``seconds`` [s] without voltage. Returns what `run` does."""
        rows = self.periods(seconds)
        place = self.position if math.isfinite(self.position) else 0.0
        return self.run(np.full(rows, place), lambda n, x, i: 0.0)

    def begin(self):
        """The first reading: where the machine stands.

        Raises
        ------
        Stopped : the hardware reported an error.
        Refused : the encoder gives no number, or one outside the travel less its margin.
        """
        try:
            self._backend.write(0.0)
            self._armed = True  # as the backend has left it
            self._arm(False)
            if "enable" in self._members:
                self._members["enable"](True)
            x, i, _ = self._backend.read()
            self._backend.write(0.0)
            self.zeroed = True
        except HardwareError as problem:
            raise Stopped(f"the hardware reported: {problem}") from problem
        self.rows += 1
        if math.isfinite(x):
            self.used = {"travel_min_m": float(x), "travel_max_m": float(x)}
        if not math.isfinite(x):
            raise refused("encoder_dead", math.nan, "m", "the encoder gives no number")
        self.position = x
        if not self.travel[0] <= x <= self.travel[1]:
            raise refused(
                "end_stop",
                x,
                "m",
                f"the encoder reads {x * 1e3:.4g} mm, outside the travel less its margin ({self.travel[0] * 1e3:.4g} to"
                f" {self.travel[1] * 1e3:.4g} mm): home the encoder, or move the stage inside by hand",
            )

    def _beyond(self, x, window):
        inside = self.travel[0] <= x <= self.travel[1]
        raise refused(
            "runaway",
            x,
            "m",
            f"the stage left {'the part of the travel that this step needs' if inside else 'the travel'}: "
            f"the encoder reads {x * 1e6:.6g} µm",
        )

    def _arm(self, on):
        """Arm the card's own watchdog, where it has one, for a run; disarm it between runs."""
        if "watchdog" in self._members and on != self._armed:
            self._members["watchdog"](SILENCE if on else 0.0)
        self._armed = on

    def _zero(self):
        self.zeroed = False
        try:
            self._backend.write(0.0)
            self.zeroed = True
            self._arm(False)
        except HardwareError as problem:
            raise Stopped(f"the hardware refused zero volts: {problem}") from problem

    def _wait(self):
        now = time.perf_counter()
        self._due = now if self._due is None or now > self._due + self.period else self._due + self.period
        if self._due - now > SPIN:
            time.sleep(self._due - now - SPIN)
        while time.perf_counter() < self._due:
            pass

    def _look(self, table, n):
        """Stop on the outside's signals."""
        if "e_stop" in self._members and self._members["e_stop"]():
            raise Stopped("the emergency stop is pressed")
        if "limit_switches" in self._members:
            pressed = self._members["limit_switches"]()
            if any(pressed):
                raise refused(
                    "end_stop",
                    self.position if n < 1 else float(table[0, n]),
                    "m",
                    f"the {'lower' if pressed[0] else 'upper'} limit "
                    "switch is actuated inside the travel of the sketch",
                )

    def _note(self, table):
        if np.isfinite(table[0]).any():
            self.used["travel_min_m"] = min(self.used["travel_min_m"], float(np.nanmin(table[0])))
            self.used["travel_max_m"] = max(self.used["travel_max_m"], float(np.nanmax(table[0])))
        if np.isfinite(table[3]).any():
            self.most_command = max(self.most_command, float(np.nanmax(np.abs(table[3]))))

    def _note_stamps(self, stamps):
        """Least and greatest interval of the readings [s] by the card's clock."""
        steps = np.diff(stamps)
        if len(steps):
            known = self.instruments.get("interval_s", [math.inf, -math.inf])
            self.instruments["interval_s"] = [min(known[0], float(steps.min())), max(known[1], float(steps.max()))]

    def note_surroundings(self):
        """Ask for temperature [K] and index mark [m], where the backend has them; between two steps, at zero volts.

        Raises `Stopped` when the hardware reports an error.
        """
        try:
            if "temperature" in self._instruments:
                self.instruments.setdefault("temperature_K", []).append(float(self._instruments["temperature"]()))
            if "index" in self._instruments:
                self.instruments["index_m"] = float(self._instruments["index"]())
        except HardwareError as problem:
            raise Stopped(f"the hardware reported: {problem}") from problem

    def _record(self, table, reference):
        sent = self.command.column
        names = ("encoder_m", "current_A", "motor_angle_rad", sent, self.command.disturbance)
        columns = {
            name: row.copy()
            for name, row in zip(names, table)
            if name in ("encoder_m", sent) or np.isfinite(row).any()
        }
        columns["reference_m"] = reference
        columns[sent] = np.nan_to_num(columns[sent])
        return Record(self.period, columns, metadata={"command": self.command.as_dict()})
