"""Closed-loop re-simulation of records: reference in, force and position out, compared with the measurement.

    F(n) = gain · [controller(reference(n), x(n)) + disturbance(n)],   x from `solver.step` driven by F

The model starts where the record starts, at its position and speed, with a controller whose memory holds
the motion before the first row (the record may begin on the way). No noise is simulated.
"""

import concurrent.futures
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.runs.closed_loop import TRACE, run_loop
from microstage_ros.diagnosis.resimulation.rests import rows_that_tell
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.axis_file import Axis
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.period import as_array, read
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work

LAW_MISMATCH = 0.05            # share of the command that the controller of the axis file may leave unexplained
HOMING_TRIES = 12              # places of the turn tried first: four per cycle of the third harmonic
START_ROWS = 10                # rows from which the speed at the start is taken
COUNTS = ("sensors.encoder.resolution", "sensors.encoder.bits", "drive.dac_bits", "drive.command_bits")
NOISES = 3.0                   # standard deviations of the sensor within which a start is that of the reference
READINGS_TRIED = 4             # derived: slopes of shipped sensors are within 1 % of one, and 0.01⁴ is nothing
ENCODER, VOLTAGE = TRACE.index("encoder_m"), TRACE.index("voltage_V")


@dataclass(frozen=True)
class Measured:
    """What a re-simulation needs of one record: arrays of shape (n,), SI.

    ``law`` is the rms of the command that the controller of the axis file does not explain [N], start left out;
    ``target_before`` where the target was at rest before the first row [m], None if it moved, whichever explains more;
    ``tells`` the mask of `rests.rows_that_tell`; ``designed_for`` the axis file whose law was in the loop: a model of
    another mass has the gains that the machine had.
    """

    source: str
    time: np.ndarray
    reference: np.ndarray
    position: np.ndarray
    force: np.ndarray
    disturbance: np.ndarray
    position_at_start: float
    speed_at_start: float
    law: float
    target_before: float | None
    tells: np.ndarray
    designed_for: Axis

    def __len__(self):
        return len(self.time)


def measured(record, axis):
    """Check a record against the axis file and its controller, as it was in the loop; returns `Measured`.

    Raises InputError: missing samples, a period other than the axis's, or a command that the axis file's
    controller does not produce from the record's own reference and encoder.
    """
    actuator = actuator_of(axis)
    period, gain, command = axis.value("period"), actuator.judged(axis)[0], actuator.command
    if abs(record.period_s / period - 1.0) > 1e-3:
        raise InputError(
            f"{record.source}: t_s", record.period_s, f"rows {period:g} s apart, the period of {axis.place}"
        )
    for name in ("encoder_m", "reference_m"):
        _no_gaps(record, name)
    name = command.column if command.column in record else "force_N"
    _no_gaps(record, name)
    voltage = record[name] if name == command.column else record["force_N"] / gain
    added = np.nan_to_num(record[command.disturbance]) if command.disturbance in record else np.zeros(len(record))
    start, speed = _start(record, axis)
    ways = [(_law_residual(axis, record, voltage - added, speed, place), place) for place in (None, _first(record))]
    left, target_before = min(ways, key=lambda way: float(way[0] @ way[0]))
    law = float(np.sqrt(np.mean(left[START_ROWS:] ** 2)))
    if law > LAW_MISMATCH * np.std(voltage):
        raise InputError(
            f"{axis.place}: controller",
            axis.controller,
            f"the controller that gave {name} of {record.source} (it leaves {law:.3g} {command.unit} rms unexplained)",
        )
    return Measured(
        record.source,
        np.arange(len(record)) * period,
        record["reference_m"],
        record["encoder_m"],
        gain * voltage,
        added,
        start,
        speed,
        gain * law,
        target_before,
        rows_that_tell(record["reference_m"], axis, _controller(axis)),
        axis,
    )


def _start(record, axis):
    """(position [m], speed [m/s]) at the first row.

    A drive that holds a position is at rest where the reference is; it stands on the reference if the sensor says so
    within its noise, since the noise of a start would stay in its history.
    """
    first, reference = record["encoder_m"][:START_ROWS], record["reference_m"][:START_ROWS]
    if actuator_of(axis).holds_position and np.ptp(reference) == 0.0:
        place, noise = float(first.mean()), axis.value("sensors.encoder.noise")
        return (float(reference[0]) if abs(place - reference[0]) <= NOISES * noise else place), 0.0
    return float(first[0]), float(np.polyfit(np.arange(START_ROWS) * axis.value("period"), first, 2)[1])


def _stage_at_start(axis, plant, part):
    """Where the stage stands [m] when its sensor, without noise, reads what the `Measured` ``part`` begins with.

    A tilted capacitive sensor reads nanometres beside its place: a piezo that begins there keeps them in its
    hysteresis. A drive that holds a position stands on its target where the sensor reads as it would there.
    """
    if actuator_of(axis).holds_position:
        target, noise = float(part.reference[0]), axis.value("sensors.encoder.noise")
        if abs(_reading_at(plant, target) - part.position_at_start) <= NOISES * noise:
            return target
    place = part.position_at_start
    for _ in range(READINGS_TRIED):
        place += part.position_at_start - _reading_at(plant, place)
    return place


def _reading_at(plant, place):
    """What the position sensor of a ``plant`` reads with its stage at rest at a ``place`` [m]."""
    readings = new_readings()
    read(as_array(plant), as_array(new_state(plant, position=place)), as_array(readings))
    return float(readings["encoder"])


def _first(record):
    """The target in the first row [m]."""
    return float(record["reference_m"][0])


def _no_gaps(record, name):
    missing = np.flatnonzero(np.isnan(record[name]))
    if len(missing):
        raise InputError(f"{record.source}: row {missing[0] + 1}, field {name}", "empty", "a number in every row")


def _controller(axis):
    section = {key: value for key, value in axis.controller.items() if not isinstance(value, dict)}
    if "type" not in section:
        raise InputError(
            f"{axis.place}: controller.type", None, "the controller that was in the loop, for instance cascade"
        )
    return make_controller(section.pop("type"), axis, **section)


def _primed(axis, position, speed, target_before=None):
    """A controller that has seen an even motion before the first row, or a target at rest, ``target_before`` [m]: a law
    that feeds friction forward would else lean on what noise makes of the ``speed`` [m/s]."""
    controller, period = _controller(axis), axis.value("period")
    for back in range(4, 0, -1):
        before = position - back * speed * period
        controller.step(before if target_before is None else target_before, before)
    return controller


def _law_residual(axis, record, voltage, speed, target_before=None):
    """Command [V] that the controller does not give on the record's own signals, shape (n,)."""
    controller = _primed(axis, float(record["encoder_m"][0]), speed, target_before)
    own = np.array([controller.step(r, y) for r, y in zip(record["reference_m"], record["encoder_m"])])
    return voltage - own


def turning_effects(axis):
    """Ids of the effects of an axis that repeat with the turn of the screw, and so begin anew after each homing."""
    pitch, found = axis.value("transmission.pitch"), []
    if np.any(np.asarray(axis.effects.get("torque_ripple", {}).get("amplitude_Nm", 0.0))):
        found.append("torque_ripple")
    wave = axis.effects.get("position_dependent_friction", {})
    if np.any(np.asarray(wave.get("amplitude", 0.0))) and _whole(pitch / np.asarray(wave["period_m"], float)):
        found.append("position_dependent_friction")
    return tuple(found)


def _whole(ratio):
    return bool(np.all(np.abs(ratio / np.maximum(np.round(ratio), 1.0) - 1.0) < 1e-6))


def turned(axis, shift):
    """The axis whose screw stands ``shift`` [m] of travel further when the position reads the same."""
    names = turning_effects(axis) if shift else ()
    if not names:
        return axis
    effects = {name: dict(section) for name, section in axis.effects.items()}
    lever = axis.value("transmission.pitch") / (2.0 * np.pi * axis.value("transmission.gear_ratio"))
    for name in names:
        number = (np.asarray(effects[name]["cycles_per_turn"], float) / lever if name == "torque_ripple"
                  else 2.0 * np.pi / np.asarray(effects[name]["period_m"], float))
        phase = np.asarray(effects[name]["phase_rad"], float) + number * shift
        effects[name]["phase_rad"] = phase.tolist() if phase.ndim else float(phase)
    return axis.with_effects(effects)


class ClosedLoop:
    """Re-simulates a list of `Measured` for any variant of one axis, with ``jobs`` threads (the loop is compiled)."""

    def __init__(self, parts, jobs=1):
        self.parts = parts
        self.shifts = np.zeros(len(parts))
        self._pool = concurrent.futures.ThreadPoolExecutor(jobs) if jobs > 1 else None
        self.force = np.concatenate([part.force for part in parts])
        self.position = np.concatenate([part.position for part in parts])
        self.tells = np.concatenate([part.tells for part in parts])

    def home(self, axis, every=False):
        """Find anew, in each record, where the turn of the screw begins; `shifts` [m] is changed.

        A machine that homes before a record counts from another place of the turn: what repeats with the turn keeps its
        size, and its phase is a matter of the record. The first record defines the phases of effects that are being
        fitted; with ``every`` (effects that the axis file brought along) it is homed, too.
        """
        if not turning_effects(axis):
            return
        pitch = axis.value("transmission.pitch")

        for k in range(0 if every else 1, len(self.parts)):
            part = self.parts[k]

            def left(shift, part=part):
                force = actuator_of(axis).judged(axis)[0] * self._trace(turned(axis, float(shift)), part)[:, VOLTAGE]
                return float(np.sum((part.force - force) ** 2))

            tried = np.arange(HOMING_TRIES) * pitch / HOMING_TRIES
            best = tried[int(np.argmin([left(shift) for shift in tried]))]
            step = pitch / HOMING_TRIES
            self.shifts[k] = minimize_scalar(left, bounds=(best - step, best + step), method="bounded",
                                             options={"xatol": 1e-3 * pitch, "maxiter": 12}).x % pitch

    def residual(self, axis):
        """Measured minus simulated force [N], all records one after the other, shape (rows,)."""
        return self.force - self.simulate(axis)[0]

    def residuals(self, axes):
        """`residual` of each of several ``axes``, `Axis` each, a list in their order."""
        return list(self._pool.map(self.residual, axes)) if self._pool else [self.residual(axis) for axis in axes]

    def simulate(self, axis):
        """Force [N] and position [m] of the model, each of shape (rows,)."""
        trace = np.concatenate([self._trace(turned(axis, shift), part) for shift, part in zip(self.shifts, self.parts)])
        return actuator_of(axis).judged(axis)[0] * trace[:, VOLTAGE], trace[:, ENCODER]

    def stated_noise(self, axis, draws):
        """What the noise that the axis file states makes of the command, through the model's own loop
        (`Actuator.judged`), shape (draws, rows) [unit of the residual].

        Drive, sensor and random friction as the file has them, each record once in each draw with a seed of its own,
        against none.
        """
        still = [self._trace(axis, part)[:, VOLTAGE] for part in self.parts]

        def draw(k):
            return np.concatenate([
                self._trace(axis, part, seed=k * len(self.parts) + place + 1)[:, VOLTAGE] - without
                for place, (part, without) in enumerate(zip(self.parts, still))
            ])

        drawn = self._pool.map(draw, range(draws)) if self._pool else map(draw, range(draws))
        return actuator_of(axis).judged(axis)[0] * np.array(list(drawn))

    @staticmethod
    def _trace(axis, part, seed=None):
        """Re-simulation of one record, without counts and noise where no ``seed`` is given."""
        exact = make_plant(axis.with_values({key: 0 for key in COUNTS if axis.has(key)}), noise=NoiseSpec.none())
        plant = exact if seed is None else make_plant(axis)
        start = _stage_at_start(axis, exact, part)
        state = new_state(plant, seed=seed or 0, position=start, speed=part.speed_at_start)
        controller = _primed(part.designed_for, part.position_at_start, part.speed_at_start, part.target_before)
        trace = np.empty((len(part), len(TRACE)))
        run_loop(
            plant,
            state,
            new_work(plant),
            new_readings(),
            controller.parameters,
            controller.memory,
            part.reference,
            np.zeros(len(part)),
            part.disturbance,
            trace,
        )
        return trace
