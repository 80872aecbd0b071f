"""From records of an axis to its parameters: which estimators a machine allows, and their order."""

import itertools

import numpy as np

from microstage_ros.identification import torque_constant
from microstage_ros.identification.closed_loop import refine_closed_loop
from microstage_ros.identification.estimators.acceleration import identify_attraction, identify_inertia
from microstage_ros.identification.estimators.actuator import Features, extract, steady_series
from microstage_ros.identification.estimators.actuator_fit import identify_presliding, identify_sliding
from microstage_ros.identification.estimators.estimate import Curve, Estimate, Identification, from_interval
from microstage_ros.identification.estimators.guideway import elastic_slope, extract_loading
from microstage_ros.identification.estimators.intervals import bootstrap
from microstage_ros.identification.estimators.inverse_dynamics import KEYS, identify_force_axis
from microstage_ros.identification.estimators.motor import cross_check, identify_motor
from microstage_ros.identification.estimators.position_drive import identify_position_drive
from microstage_ros.identification.estimators.stribeck import stribeck_curve
from microstage_ros.identification.estimators.variability import identify_variability, position_locked_share
from microstage_ros.identification.signals import motor_signals
from microstage_ros.identification.whole_axis import driven_load, identify_whole_axis, with_windup
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.friction.contact import BLOCK_LAWS
from microstage_ros.quantities.errors import InputError

MOST_SERIES = 6000  # samples of friction for the variability
MOST_DYNAMIC = 12  # records kept whole for motor constants, inertia and C
CELL = 1e-5  # travel of one sample of friction [m]

ELSEWHERE = {
    "stage.mass": "weighing the moving parts would: its inertia is under 1 % of the rotor's at the motor",
    "transmission.stiffness": "the stage against the motor's angle under known loads, or its resonance (about 300 "
    "Hz), would",
    "transmission.damping": "the decay of the drive train's resonance would",
}
GUIDEWAY_ELSEWHERE = (
    "incremental loading of the guideways alone would: their force is 7 % of the actuator's at the motor"
)


def identify(records, axis, seed=0, progress=lambda text: None, blocks=None, refine=False):
    """Identify an axis from records.

    Parameters
    ----------
    records : iterable of checked `Record`, read one at a time; each counts as a repeat.
    axis : `Axis` the records come from; its values are scales and first guesses, and stand for what the
        records do not tell.
    seed : of the bootstrap [1]. progress : called with a line of text after each record.
    blocks : number of Maxwell-slip blocks [1]; None lets the data choose.
    refine : for a force-driven axis, take the values of least closed-loop error, not the inverse model's.

    Returns
    -------
    `Identification`. Raises InputError for records from which this machine cannot be identified.
    """
    estimation = actuator_of(axis).estimated(axis, "identify")
    if estimation == "position":
        return identify_position_drive(list(records), axis)
    if estimation == "force":
        if axis.law("guideway").startswith("coulomb_viscous"):
            return _force_axis(list(records), axis, refine)
        return identify_guideway(records, axis, seed, progress, blocks)
    return identify_motor_axis(records, axis, seed, progress, blocks)


def _needs(axis, contact, laws, why):
    """InputError unless the contact's law is one whose parameters the records tell."""
    if axis.law(contact) not in laws:
        raise InputError(f"{axis.place}: contacts.{contact}.law", axis.law(contact), f"{' or '.join(laws)}: {why}")


def _force_axis(records, axis, refine):
    """Inverse model, and beside it the closed-loop output error where the axis file has a controller."""
    result = identify_force_axis(records, axis)
    if axis.controller.get("type", "none") == "none":
        return result
    closed = refine_closed_loop(records, axis, {key: result.estimates[key].value for key in KEYS})
    result.tables.append(("By least closed-loop error of the force", ("parameter", "unit", "value", "stderr"),
                          [(e.key, e.unit, f"{e.value:.6g}", f"{e.stderr:.2g}") for e in closed.estimates.values()]))
    result.remarks += closed.remarks
    if refine:
        result.add(*closed.estimates.values())
    return result


def identify_guideway(records, axis, seed=0, progress=lambda text: None, blocks=None):
    """Guideways from incremental loading: blocks, static limit, elastic slope, variability.

    Parameters as `identify`: ``seed`` and ``blocks`` [1].
    The static limit of a repeat lies between the last load held and the one that slid.
    """
    _needs(axis, "guideway", BLOCK_LAWS,
           "the blocks of a virgin curve are what incremental loading tells")
    repeats = []
    for record in records:
        repeats.append(extract_loading(record, axis))
        progress(f"{record.source}: {len(repeats[-1].loading.force)} loads, breakaway {repeats[-1].breakaway[1]:.3g} N")
    reading = axis.choices.get("contacts.guideway.reading", "blocks")
    result = identify_presliding(
        [r.loading for r in repeats],
        list(range(len(repeats))),
        seed,
        "guideway",
        ("N/m", "m", "N"),
        reading,
        "four or more repeats of incremental loading would",
        blocks,
    )
    statics = np.array([0.5 * sum(r.breakaway) for r in repeats if np.isfinite(r.breakaway[1])])
    key = "contacts.guideway.static"
    if len(statics) >= 4:
        value, stderr, low, high, _ = bootstrap(lambda k: statics[k].mean(), len(statics), seed)
        result.add(from_interval(key, value[0], stderr[0], "N", low[0], high[0], "bootstrap over repeats"))
        spread = float(statics.std(ddof=1) / statics.mean())
        result.add(from_interval("variability.relative", spread, spread / np.sqrt(2.0 * (len(statics) - 1)), "1",
                                 method="scatter of breakaway between repeats", experiment="ten or more repeats would"))
    else:
        result.add(
            Estimate(
                key,
                float("nan"),
                "N",
                determined=False,
                remark=f"not determined by these records ({len(statics)} "
                "repeats reach breakaway); loading up to breakaway in four or more repeats would",
            )
        )
    slopes = [elastic_slope(loop) for r in repeats for loop in r.loops]
    if slopes:
        low, middle, high = np.quantile(slopes, [0.05, 0.5, 0.95])
        result.remarks.append(
            f"Return loops: elastic slope {middle:.4g} N/m (nine tenths within {low:.4g} … {high:.4g}, {len(slopes)} "
            "loops); "
            "by the blocks it is the sum of all stiffnesses."
        )
    shown = repeats[0]
    way, load = (
        np.concatenate(parts) for parts in zip((shown.loading.displacement, shown.loading.force), *shown.loops)
    )
    result.curves.append(
        Curve("One repeat with its return loops (Fig. 7a)", "displacement [m]", "force [N]", way, load)
    )
    result.add(
        Estimate(
            "contacts.guideway.viscous",
            axis.value("contacts.guideway.viscous"),
            "N s/m",
            determined=False,
            remark="not determined by these records (loading is quasi-static); sliding at several speeds under a "
            "known force would",
        )
    )
    return result


def identify_motor_axis(records, axis, seed=0, progress=lambda text: None, blocks=None):
    """An axis with a voltage-driven motor, alone on its bench or with the stage.

    Parameters as `identify`: ``seed`` and ``blocks`` [1]. Raises InputError: there is no record.
    """
    _needs(
        axis,
        "actuator",
        ("generalised_maxwell_slip",),
        "only this law's parameters are estimated from a motor's records",
    )
    coupled, given, records = axis.law("guideway") != "none", axis, iter(records)
    first = list(itertools.islice(records, MOST_DYNAMIC))
    if not first:
        raise InputError("records", 0, "at least one record")
    motor = identify_motor([_signals_and_load(record, axis, coupled)[0] for record in first], axis)
    axis = torque_constant.with_found_constant(axis, motor.estimates)
    features, dynamic = Features(), []
    for number, record in enumerate(itertools.chain(first, records)):
        signals, load = _signals_and_load(record, axis, coupled)
        found = extract(signals, axis, number, load)
        series = steady_series(signals, axis, CELL, load)
        found.series = [series] if len(series) else []
        features.extend(found)
        if len(dynamic) < MOST_DYNAMIC:
            dynamic.append(signals)
        progress(f"{record.source}: {len(found.loadings)} slow reversals, {len(found.speed)} steady runs")
    result = identify_motor(dynamic, axis)
    result.remarks += filter(None, [cross_check(dynamic, result.estimates, axis)])
    result.merge(identify_inertia(dynamic, axis))
    result.merge(identify_sliding(features, seed))
    result.merge(identify_presliding(features.loadings, features.loading_repeat, seed, count=blocks))
    known = result.to_axis(axis)
    if coupled:
        result.merge(identify_whole_axis(dynamic, known, result))
        known = result.to_axis(axis)
    result.merge(identify_attraction(dynamic, known))
    result.merge(identify_series(features.series, known))
    for key, experiment in {**ELSEWHERE, **({"contacts.guideway": GUIDEWAY_ELSEWHERE} if coupled else {})}.items():
        if key == "contacts.guideway" or (axis.has(key) and (coupled or not key.startswith("stage"))):
            quantity = axis.quantity(key) if axis.has(key) else None
            result.add(Estimate(key, quantity.value if quantity else float("nan"), quantity.unit if quantity else "",
                                determined=False, remark=f"not determined by these records; {experiment}"))
    torque_constant.add_constant(result, given)
    return result


def _signals_and_load(record, axis, coupled):
    """(`MotorSignals`, what the stage asks of the motor or None) of one record."""
    signals = motor_signals(record, axis)
    if not coupled:
        return signals, None
    return with_windup(signals, axis), driven_load(signals, axis)


def identify_series(series, axis):
    """Variability from series of friction in steady sliding (`actuator.steady_series`), one per record."""
    from_axis = [
        axis.value(f"contacts.actuator.{k}")
        for k in ("static", "coulomb", "stribeck_velocity", "stribeck_exponent", "viscous")
    ]
    for number, part in enumerate(series):
        part[:, 2] += 1e3 * number  # records are far apart in travel
    table = np.concatenate([np.empty((0, 6)), *series])[:MOST_SERIES]
    sliding = [*from_axis[:4], 0.0]
    deviation = (np.abs(table[:, 1]) - from_axis[4] * np.abs(table[:, 0])) / stribeck_curve(sliding, table[:, 0]) - 1.0
    try:
        result = identify_variability(deviation, table[:, 2], table[:, 3], table[:, 5] > 0)
    except InputError as error:
        result = Identification()
        result.add(
            Estimate(
                "variability.relative",
                axis.value("variability.relative"),
                "1",
                determined=False,
                remark=f"not determined by these records ({error.value}); slow constant-velocity runs over 2 mm and "
                "more would",
            )
        )
        return result
    share, pairs = position_locked_share(table[:, 4], deviation, table[:, 2], 2.0 * CELL, 1e-3)
    if pairs > 100:
        result.remarks.append(
            f"Friction that comes back at the same place: {share:.0%} of the variance ({pairs} pairs of passes)."
        )
    return result
