"""The order of a commissioning, from the first reading to the proof; every step may end it with a reason."""

import math
from dataclasses import asdict, dataclass, field

import numpy as np

from microstage_ros.commissioning import proof
from microstage_ros.commissioning.closed_loop import Loop, programme, stroke
from microstage_ros.commissioning.findings import Check, Refused, Stopped, refused
from microstage_ros.commissioning.first_motion import first_motion
from microstage_ros.commissioning.frequency_response import measured_margins
from microstage_ros.commissioning.known import known_axis
from microstage_ros.commissioning.law_choice import DRAWS, choose_law, soft_gains
from microstage_ros.commissioning.open_loop import Strokes, fit_strokes, scale_check, sliding_response, strokes
from microstage_ros.commissioning.parameters import draws, identified
from microstage_ros.commissioning.plant_fit import fit_plant, resonance_of

LEAST_RESONANCE = 0.45  # of the sketched one: stiffness half and mass twice give 0.5
MOST_DELAY = 2.5  # periods
SUM = "programme"


@dataclass
class Outcome:
    """What a commissioning found.

    Attributes
    ----------
    verdict : ready, refused or stopped. checks : by id. axis : identified `Axis` with its law, None if it did not come so far.
    estimates : of the identification. responses : list of `Response`. margins : `MeasuredMargins` in motion, or None.
    moves, sine : of the proof. along : rows of the stroke. remarks : sentences. says : the reason of the verdict.
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
    machine : `Machine`, its backend open. sketch : `Sketch`. store : `Store`. seed : of phases and draws.
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
    last = getattr(machine, "last", None)
    if last is not None and len(last) > 1 and last.source == "record":
        store.keep("last", last, machine.time)


def _steps(outcome, machine, sketch, store, seed, progress, keep, paths):
    progress("first motion: the smallest voltages that move anything")
    machine.begin()
    first, checks = first_motion(machine, sketch, keep)
    outcome.check(*checks)
    machine.noise = first.noise
    found, axis, fit = _open_loop(outcome, machine, sketch, store, first, seed, progress, keep, paths)
    loop = Loop(machine, axis, "self_tuning", found.friction, soft_gains("self_tuning", axis, [])[0])
    records = _closed_loop(outcome, loop, store, progress, keep, paths)
    progress("identification")
    axis, outcome.estimates, outcome.remarks = identified(records, axis, sketch, found, fit, seed)
    drawn = draws(axis, outcome.estimates, DRAWS, seed)
    law, gains, why = choose_law(axis, drawn, found.has_current)
    outcome.remarks.append(why)
    outcome.axis = axis
    _prove(outcome, machine, axis, drawn, law, gains, found, first, seed, progress, keep)


def _open_loop(outcome, machine, sketch, store, first, seed, progress, keep, paths):
    """(`Strokes`, known axis, `PlantFit`): before any loop is closed."""
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
    if found.has_current and sketch.axis.choices["drive.type"] == "voltage_motor":
        machine.constants = (found.resistance, max(found.volts_per_speed, 1e-9))
    machine.top_speed = machine.limit / max(found.volts_per_speed, 1e-9)
    axis = known_axis(sketch, found)
    progress("frequency response, sliding, before any loop is closed")
    response = sliding_response(machine, found, seed, keep)
    fit = None
    if response is not None:
        outcome.responses.append(response)
        fit = fit_plant(axis, response, machine.period, _slope(axis, found))
    if fit is None:
        outcome.remarks.append("Too few lines of the open-loop response are coherent: the drive train stays as sketched.")
    else:
        _judge_response(outcome, machine, sketch, fit)
        axis = known_axis(sketch, found, fit)
    return found, axis, fit


def _slope(axis, found):
    """Viscous torque at the motor per motor speed [N m s/rad]; per stage speed [N s/m] for a force drive."""
    if axis.choices["drive.type"] == "force":
        return (found.viscous + found.volts_per_speed) * axis.value("drive.gain")
    if not found.has_current:
        return 0.0
    from microstage_ros.commissioning.known import ratio_of

    return max(found.viscous, 0.0) / found.resistance * axis.value("drive.torque_constant") * ratio_of(axis)


def _judge_response(outcome, machine, sketch, fit):
    """Checks of delay and resonance."""
    delay = fit.delay / machine.period
    if delay > MOST_DELAY and delay > 4.0 * fit.delay_error / machine.period:
        raise refused("delay", delay, "periods", f"the encoder answers the command {delay:.1f} periods ({fit.delay * 1e3:.3g} ms) later than the "
                      "model: buffers, filters or averaging in the readings or the output")
    outcome.check(Check("delay", True, max(delay, 0.0), "periods", f"{max(delay, 0.0):.2f} periods between command and motion beyond the model's"))
    expected = resonance_of(sketch.axis)
    if not math.isfinite(expected):
        outcome.check(Check("resonance", True, math.nan, "Hz", "this transmission has no resonance in the model"))
        return
    share = fit.resonance / expected
    known = "transmission.stiffness" in sketch.given and "stage.mass" in sketch.given
    if fit.resonance > 0.45 / machine.period or not fit.resonance_error < 0.3:
        outcome.check(Check("resonance", True, fit.resonance, "Hz", "no resonance shows in the measured band"))
    elif share < LEAST_RESONANCE and known:
        raise refused("resonance", fit.resonance, "Hz", f"the drive train swings at {fit.resonance:.4g} Hz, {share:.2g} of the {expected:.4g} Hz of the "
                      "sketch: a loose coupling, nut or bearing, or a far heavier load")
    else:
        outcome.check(Check("resonance", True, fit.resonance, "Hz", f"{fit.resonance:.4g} Hz, sketched {expected:.4g} Hz"))


def _closed_loop(outcome, loop, store, progress, keep, paths):
    """Records for the identification: at rest, along the travel, the programme at two places."""
    progress("closing the loop, with gentle gains")
    keep("hold", loop.settle())
    if store.done("stroke") is None:
        progress("once along the travel: end stops, friction along the way")
        outcome.along, ends, _ = stroke(loop, keep)
        store.finish("stroke", {"low_m": ends[0], "high_m": ends[1], "along": outcome.along.tolist()}, [paths["stroke"]])
    else:
        outcome.along = np.array(store.done("stroke")["along"], float)
        ends = store.done("stroke")["low_m"], store.done("stroke")["high_m"]
    outcome.check(Check("end_stop", True, ends[1] - ends[0], "m", f"free from {ends[0] * 1e3:.4g} to {ends[1] * 1e3:.4g} mm"))
    if store.done(SUM) is None:
        made = []
        middle, reach = 0.5 * (ends[0] + ends[1]), ends[1] - ends[0]
        for number, place in enumerate((middle - 0.2 * reach, middle + 0.1 * reach)):
            progress(f"record for the identification, {number + 1} of 2")
            loop.go(place, 0.8 * loop.top_speed)
            keep(SUM, loop.follow(programme(loop, place)))
            made.append(paths[SUM])
        store.finish(SUM, {}, made)
    return store.records_of(SUM)


def _prove(outcome, machine, axis, drawn, law, gains, found, first, seed, progress, keep):
    """The law's loop measured, moves and sine; a law that swings gives way to the encoder-only one."""
    loop = None
    for attempt, (name, chosen) in enumerate([(law, gains), ("self_tuning", soft_gains("self_tuning", axis, drawn)[0])]):
        loop = Loop(machine, axis, name, found.friction, chosen)
        try:
            progress(f"loop of {name}, measured at rest and in motion")
            keep("hold", loop.settle())
            rest = proof.loop_at_rest(loop, first.breakaway, seed, keep)
            motion = proof.loop_in_motion(loop, found, seed, keep)
            progress(f"moves of 1 to 1000 µm and a slow sine under {name}")
            outcome.moves, outcome.sine = proof.prove(loop, keep)
            break
        except Refused as reason:
            if attempt == 1 or name == "self_tuning" or reason.check.id != "runaway":
                raise
            outcome.remarks.append(f"{name} was given up: {reason.check.says}.")
            machine.rest(0.3)
    outcome.check(Check("runaway", True, outcome.sine, "m", "the loop rests and follows"))
    outcome.responses += [r for r in (*rest, *motion) if r is not None]
    outcome.rest_margins = measured_margins(rest[1]) if rest[1] is not None else None
    outcome.margins = measured_margins(motion[1]) if motion[1] is not None else outcome.rest_margins
    outcome.law = loop.law
    section = {"type": loop.law, "tuned_period": machine.period}
    if loop.gains:
        section[loop.law] = {name: float(f"{value:.6g}") for name, value in loop.gains.items()}
    outcome.axis = axis.with_controller(section)
