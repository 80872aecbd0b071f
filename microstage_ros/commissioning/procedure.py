"""The order of a commissioning, from the first reading to the proof; every step may end it with a reason."""

import math
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from microstage_ros.commissioning.experiments import measured_loop, proof
from microstage_ros.commissioning.experiments.closed_loop import LOOSE, Loop, go_gently, programme, stroke
from microstage_ros.commissioning.findings import Check, Refused, Stopped, refused
from microstage_ros.commissioning.experiments.encoder_scale import scale_check
from microstage_ros.commissioning.experiments.first_motion import first_motion
from microstage_ros.commissioning.estimation.frequency_response import measured_margins
from microstage_ros.commissioning.estimation.known import known_axis
from microstage_ros.commissioning.design.law_choice import (
    DRAWS,
    FLOOR_GAIN,
    FLOOR_PHASE,
    choose_law,
    encoder_laws,
    encoder_margins,
    gentle_law,
    soft_gains,
    too_little,
)
from microstage_ros.commissioning.experiments.dead_encoder import EncoderWatch, standing
from microstage_ros.commissioning.experiments.machine import LONGEST
from microstage_ros.commissioning.experiments.simulated_proof import beside_simulation, judge_proof
from microstage_ros.commissioning.experiments.open_loop import Strokes, fit_strokes, strokes
from microstage_ros.commissioning.experiments.sliding import sliding_response
from microstage_ros.commissioning.estimation.parameters import draws, identified, slope_of
from microstage_ros.commissioning.estimation.plant_fit import fit_plant, resonance_of, volts_per_acceleration
from microstage_ros.commissioning.estimation.whole_loop import whole_margins
from microstage_ros.model.actuators import actuator_of

LEAST_RESONANCE = 0.45  # of the sketched one: stiffness half and mass twice give 0.5
MOST_DELAY = 2.5  # periods
LEAST_SAFE = 3e-3
"""Speed [m/s] that is allowed even where the stage could not be stopped within 8 µm from it: what identification and
response need. At 10 kHz only drives of 5 V s²/m and more are concerned (9 µm); at 1 kHz it leaves 15 µm."""
SUM = "programme"
GOOD = 3e-7  # largest 4s or mean error of the moves with which no other law is tried [m]
LONGEST_PROOF = 95.0  # s
PAST, PAST_SPEED = 2e-4, 1e-3  # m, m/s: beyond a place by far more than a drive train winds up, as slow as the proof


@dataclass
class Outcome:
    """What a commissioning found.

    Attributes
    ----------
    verdict : ready, refused or stopped. checks : by id. axis : identified `Axis` with its law, None if it did not come
    so far. estimates : of the identification. responses : list of `Response`. margins : `MeasuredMargins` in motion, or
    None. moves, iso, sine : of the proof; iso: figures of ISO 230-2. along : rows of the stroke. remarks : sentences.
    says : the reason of the verdict.
    """

    verdict: str = "stopped"
    says: str = ""
    checks: dict = field(default_factory=dict)
    axis: object = None
    estimates: dict = field(default_factory=dict)
    responses: list = field(default_factory=list)
    margins: object = None
    rest_margins: object = None
    moves: list = field(default_factory=list)
    iso: dict = field(default_factory=dict)
    sine: float = math.nan
    along: object = None
    remarks: list = field(default_factory=list)
    law: str = ""

    def check(self, *found):
        """Take checks over."""
        for one in found:
            self.checks[one.id] = one


def commission(machine, sketch, store, seed=0, progress=lambda text: None):
    """Run all steps. Returns `Outcome`; never raises for what the machine does.

    Parameters
    ----------
    machine : `Machine`, its backend open. sketch : `Sketch`. store : `Store`. seed : of phases and draws [1].
    progress : called with a line of text at each step.
    """
    outcome = Outcome()
    machine.time_offset = store.time
    paths = {}

    def keep(name, record):
        paths[name] = store.keep(name, record, machine.time)

    try:
        _steps(outcome, machine, sketch, store, seed, progress, keep, paths)
        outcome.verdict, outcome.says = "ready", f"{outcome.law}: moves and loop measured"
    except Refused as end:
        outcome.check(end.check)
        outcome.verdict, outcome.says = "refused", end.check.says
        _keep_last(machine, store)
    except Stopped as end:
        outcome.verdict, outcome.says = "stopped", str(end)
        _keep_last(machine, store)
    except KeyboardInterrupt:
        outcome.verdict, outcome.says = "stopped", "interrupted; the same command goes on from here"
        _keep_last(machine, store)
    return outcome


def _keep_last(machine, store):
    """The runs that no step has stored: the one that failed, and the last one."""
    for name, record in (("failed", machine.failed), ("last", machine.last)):
        if record is not None and len(record) > 1 and record.source == "record":
            store.keep(name, record, machine.time)


def _steps(outcome, machine, sketch, store, seed, progress, keep, paths):
    progress("first motion: the smallest commands that move anything")
    machine.begin()
    machine.note_surroundings()
    first, checks = first_motion(machine, sketch, keep)
    outcome.check(*checks)
    machine.noise = first.noise
    found, axis, response = _open_loop(outcome, machine, sketch, store, first, seed, progress, keep, paths)
    gentle = gentle_law(axis)
    loop = Loop(machine, axis, gentle, found.friction, soft_gains(gentle, axis, [])[0])
    records = _closed_loop(outcome, loop, store, progress, keep, paths)
    machine.note_surroundings()
    progress("identification")
    axis, outcome.estimates, outcome.remarks = identified(records, axis, sketch, found, response, seed)
    drawn = draws(axis, outcome.estimates, DRAWS, seed, sketch)
    law, gains, why = choose_law(axis, drawn, found.has_current)
    outcome.remarks.append(why)
    outcome.axis = axis
    _prove(outcome, machine, axis, drawn, law, gains, found, first, seed, progress, keep)


def _open_loop(outcome, machine, sketch, store, first, seed, progress, keep, paths):
    """(`Strokes`, known axis, plant `Response` or None): before any loop is closed."""
    progress("strokes: motor constants, inertia, friction, scale of the encoder")
    done = store.done("strokes")
    if done is not None:
        found = fit_strokes(store.records_of("strokes")[0], sketch, first, machine.period)
        outcome.check(scale_check(found, sketch))
    else:
        found, check = strokes(machine, sketch, first, keep)
        outcome.check(check)
        store.finish("strokes", asdict(found), [paths["strokes"]])
    assert isinstance(found, Strokes)
    actuator = actuator_of(sketch.axis)
    if found.has_current and actuator.tells_turning:
        machine.watch = EncoderWatch(
            machine.period,
            found.resistance,
            max(found.volts_per_speed, 1e-9),
            machine.current_offset,
            machine.count,
            max(found.inertia, 0.0),
            found.friction,
        )
        _stands(machine, sketch)
    elif found.has_current and not actuator.emf_key:  # now that the command per ampere is known: no more amperes
        amperes = actuator.command_limit(sketch.axis) * actuator.amperes_per_command(sketch.axis)
        machine.limit = min(machine.limit, amperes * found.resistance)
    machine.top_speed = machine.limit / max(found.volts_per_speed, 1e-9)
    axis = known_axis(sketch, found)
    progress("frequency response, sliding, before any loop is closed")
    response = sliding_response(machine, found, seed, keep)
    fit = None
    if response is not None:
        outcome.responses.append(response)
        fit = fit_plant(axis, response, machine.period, slope_of(axis, found))
    if fit is None:
        outcome.remarks.append(
            "Too few lines of the open-loop response are coherent: the drive train stays as sketched."
        )
    else:
        if actuator.tells_turning:  # friction that builds up after each reversal hides inertia from the strokes
            found = replace(found, inertia=volts_per_acceleration(axis, fit))
            if not found.has_current:  # where there is one the strokes have told it already
                outcome.check(scale_check(found, sketch, found.inertia))
        _judge_response(outcome, machine, sketch, fit)
        axis = known_axis(sketch, found, fit)
        if machine.watch is not None:
            _stands(machine, sketch, fit)
    return found, axis, response


def _stands(machine, sketch, fit=None):
    """What a live encoder need not show, by the sketch or the measured resonance, and the speed that is safe with
    it."""
    machine.watch.standing = standing(sketch, machine.count, fit)
    machine.safe_speed = max(machine.watch.safe_speed(machine.limit), LEAST_SAFE)


def _judge_response(outcome, machine, sketch, fit):
    """Checks of delay and resonance."""
    delay = fit.delay / machine.period
    if delay > MOST_DELAY and delay > 4.0 * fit.delay_error / machine.period:
        raise refused(
            "delay",
            delay,
            "periods",
            f"the encoder answers the command {delay:.1f} periods ({fit.delay * 1e3:.3g} ms) later than the "
            "model: buffers, filters or averaging in the readings or the output",
        )
    outcome.check(
        Check(
            "delay",
            True,
            max(delay, 0.0),
            "periods",
            f"{max(delay, 0.0):.2f} periods between command and motion beyond the model's",
        )
    )
    expected = resonance_of(sketch.axis)
    if not math.isfinite(expected):
        outcome.check(Check("resonance", True, math.nan, "Hz", "this transmission has no resonance in the model"))
        return
    share = fit.resonance / expected
    known = "transmission.stiffness" in sketch.given and "stage.mass" in sketch.given
    if fit.resonance > 0.45 / machine.period or not fit.resonance_error < 0.3:
        outcome.check(Check("resonance", True, fit.resonance, "Hz", "no resonance shows in the measured band"))
    elif share < LEAST_RESONANCE and known:
        raise refused(
            "resonance",
            fit.resonance,
            "Hz",
            f"the drive train swings at {fit.resonance:.4g} Hz, {share:.2g} of the {expected:.4g} Hz of the "
            "sketch: a loose coupling, nut or bearing, or a far heavier load",
        )
    else:
        outcome.check(
            Check("resonance", True, fit.resonance, "Hz",
                  f"{fit.resonance:.4g} Hz, {'sketched' if known else 'typical'} {expected:.4g} Hz")
        )


def _closed_loop(outcome, loop, store, progress, keep, paths):
    """Records for the identification: at rest, along the travel, the programme at two places."""
    progress("closing the loop, with gentle gains")
    keep("hold", loop.settle())
    if store.done("stroke") is None:
        progress("once along the travel: end stops, friction along the way")
        outcome.along, ends, _ = stroke(loop, keep)
        store.finish(
            "stroke", {"low_m": ends[0], "high_m": ends[1], "along": outcome.along.tolist()}, [paths["stroke"]]
        )
    else:
        outcome.along = np.array(store.done("stroke")["along"], float)
        ends = store.done("stroke")["low_m"], store.done("stroke")["high_m"]
    outcome.check(
        Check("end_stop", True, ends[1] - ends[0], "m", f"free from {ends[0] * 1e3:.4g} to {ends[1] * 1e3:.4g} mm")
    )
    if store.done(SUM) is None:
        made = []
        middle, reach = 0.5 * (ends[0] + ends[1]), ends[1] - ends[0]
        for number, place in enumerate((middle - 0.2 * reach, middle + 0.1 * reach)):
            progress(f"record for the identification, {number + 1} of 2")
            loop.go(place, 0.8 * loop.top_speed)
            keep(SUM, loop.follow(programme(loop, place), error=LOOSE))
            made.append(paths[SUM])
        store.finish(SUM, {}, made)
    return store.records_of(SUM)


def _prove(outcome, machine, axis, drawn, law, gains, found, first, seed, progress, keep):
    """Prove the chosen law on the machine; one that swings, or does not come to rest at its target, gives way to the
    next.

    The loop is measured under each law that is tried, and what is reported is that of the law that is taken.
    """
    taken = failed = None
    for name, chosen in _candidates(law, gains, axis, drawn):
        if taken is not None and machine.time + LONGEST_PROOF > LONGEST:
            break
        loop = Loop(machine, axis, name, found.friction, chosen)
        try:
            tried = _tried(loop, drawn, first, found, seed, progress, keep)
        except Refused as reason:
            if reason.check.id == "end_stop" and taken is not None:  # that the stage goes there is known since `stroke`
                _go_past(taken.loop, reason.check.value)
                outcome.remarks.append(f"{name} was not proven: {reason.check.says}. {taken.loop.law} passes there.")
                continue
            if reason.check.id != "runaway":
                raise
            outcome.remarks.append(f"{name} was given up: {reason.check.says}.")
            outcome.check(reason.check)
            failed = loop
            machine.rest(0.3)
            continue
        if taken is None or tried.worst < taken.worst:
            taken = tried
        if taken.worst <= GOOD:
            break
        outcome.remarks.append(f"{name} leaves a move {tried.worst * 1e6:.3g} µm off its target (4s, or mean error).")
    if taken is None:
        check = outcome.checks["runaway"]
        raise Refused(beside_simulation(failed, check, seed) if check.unit == "m" else check)
    outcome.moves, outcome.iso, outcome.sine, outcome.law = taken.moves, taken.iso, taken.sine, taken.loop.law
    outcome.responses += [r for r in (*taken.rest, *taken.motion) if r is not None]
    outcome.rest_margins = measured_margins(taken.rest[1]) if taken.rest[1] is not None else None
    outcome.margins = taken.margins or outcome.rest_margins
    machine.note_surroundings()
    progress(f"what {taken.loop.law} left beside what it should leave")
    outcome.remarks += filter(None, [judge_proof(taken.loop, taken.worst, taken.sine, seed)])
    outcome.check(Check("runaway", True, taken.sine, "m", "the loop rests and follows"))
    section = {"type": taken.loop.law, "tuned_period": machine.period}
    if taken.loop.gains:
        section[taken.loop.law] = {name: float(f"{value:.6g}") for name, value in taken.loop.gains.items()}
    outcome.axis = axis.with_controller(section)


def _go_past(loop, place):
    """Both ways past a ``place`` [m] where the stage seemed blocked under another law. Raises Refused (end_stop) where
    it is."""
    machine = loop.machine
    machine.failed = None
    machine.rest(0.3)
    for beyond in (PAST, -PAST):
        go_gently(loop, min(max(place + beyond, machine.travel[0]), machine.travel[1]), PAST_SPEED)


@dataclass(frozen=True)
class Tried:
    """What one law did: its measured (plant, loop) responses at rest and in motion, moves and slow sine,
    `MeasuredMargins` in motion or None."""

    loop: Loop
    rest: tuple
    motion: tuple
    moves: list
    iso: dict
    sine: float
    margins: object = None

    @property
    def worst(self):
        """Largest 4s or mean error of the moves [m]."""
        return proof.worst_of(self.moves)


def _candidates(law, gains, axis, drawn):
    """(law, gains) in the order in which they are tried."""
    yield law, gains
    for name in encoder_laws(axis):
        if name != law:
            softer = soft_gains(name, axis, drawn)[0]
            phase, gain = encoder_margins(name, axis, drawn, softer)
            if phase >= FLOOR_PHASE and gain >= FLOOR_GAIN:
                yield name, softer


def _tried(loop, drawn, first, found, seed, progress, keep):
    progress(f"loop of {loop.law}, measured at rest and in motion")
    keep("hold", loop.settle())
    motion = measured_loop.loop_in_motion(loop, found, seed, keep)
    margins = None
    if motion[1] is not None:
        margins = whole_margins(motion[1], loop.axis, drawn, loop.law, loop.gains)
        little = too_little(margins)
        if little:
            raise refused(
                "runaway", margins.phase_deg, "deg", f"the loop of {loop.law}, measured in motion, leaves {little}"
            )
    rest = measured_loop.loop_at_rest(loop, first.breakaway, seed, keep)
    progress(f"moves of 1 to 1000 µm and a slow sine under {loop.law}")
    moves, iso, sine = proof.prove(loop, keep)
    return Tried(loop, rest, motion, moves, iso, sine, margins)
