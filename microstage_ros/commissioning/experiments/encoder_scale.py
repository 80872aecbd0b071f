"""Whether the encoder counts as the motor turns: by the back-EMF and by the inertia, within what both are known."""

import math

from microstage_ros.commissioning.findings import Check, refused
from microstage_ros.control.design.rules import volts_per_acceleration
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.transmission import motor_ratio

EMF_DOUBT = 0.05  # of the logarithm: a magnet loses 0.2 % per kelvin, and the strokes tell the back-EMF within 1 %
LEAST_SCALE = 0.5 * math.log(2.0)  # of the logarithm: edges are counted wrong by two or four
WRONG_UNIT = math.log(10.0)  # of the logarithm: a milli or a kilo is 1000, and no data sheet is off by ten
INERTIA_DOUBT = 0.3  # of the logarithm: friction that changes as the stage gathers speed counts as inertia


def scale_check(found, sketch, sliding=None):
    """Check that the encoder counts as the motor turns; raises `Refused` where it surely does not.

    A scale c of the encoder divides the back-EMF per encoder speed, k/c, and twice what is left of the inertia when
    that is multiplied in, J/c²; a command that is a torque or a force tells the inertia alone, J/c. Each gives an
    interval of ln c: the sketch's tolerances as bounds, and the doubt of the measurement. Refused is what lies in both,
    where all of it is nearer to a factor of two than to one.

    Without a current the strokes tell a motor's back-EMF alone. What they show as inertia has the friction in it that
    builds up over microns after each reversal: at 1 ms it came out at 0.28 to 0.71 of the truth on four simulated
    machines, and that of the response in sliding within 1 %, which is why ``sliding`` is asked for.

    Parameters
    ----------
    found : `Strokes`. sketch : `Sketch`. sliding : inertia [V s²/m] by the response in sliding, or None.
    """
    if sketch.axis.choices["drive.type"] != "voltage_motor":
        low, high = _scale_by_inertia(found, sketch)
        return _judged_scale(low, high, "the sketched mass and force")
    inertia = sliding if sliding is not None else found.inertia if found.has_current else None
    low, high, alone = _scale_of_motor(found, sketch, inertia)
    if low > high:
        return _unexplained(alone)
    return _judged_scale(low, high, "the motor's back-EMF" + ("" if inertia is None else " and inertia"))


def _unexplained(alone):
    """`Check` where back-EMF and inertia ``alone`` [1] say different scales; raises Refused where one is as far off as
    by another unit, which no motor's tolerance explains."""
    says = (
        f"the encoder counts {alone[0]:.2g} times what the sketched back-EMF says, and {alone[1]:.2g}"
        " times what the sketched inertia says: no scale explains both, "
    )
    if max(abs(math.log(scale)) for scale in alone) > WRONG_UNIT:
        raise refused("encoder_scale", alone[0], "1", says + "and a number of the sketch has another unit, it seems "
                      "(drive.back_emf, drive.torque_constant, drive.rotor_inertia, stage.mass, encoder, pitch)")
    return Check("encoder_scale", True, alone[0], "1", says + "one of them is beyond its tolerance")


def _scale_by_inertia(found, sketch):
    """(lowest, highest) ln c by the inertia alone."""
    axis, actuator = sketch.axis, actuator_of(sketch.axis)
    gains = ("drive.gain", "drive.torque_constant", actuator.emf_key, "drive.resistance")
    doubt = sum(math.log1p(sketch.tolerance[key]) for key in gains if key in axis.quantities and axis.value(key) > 0.0)
    known = volts_per_acceleration(controller_parameters("pid_feedforward", axis, {})["feedforward"])
    rotor, load = actuator.reflected_mass(axis), axis.value("stage.mass")
    tolerance = sketch.tolerance
    parts = (rotor, 1.0 + tolerance.get("drive.rotor_inertia", 0.0)), (load, 1.0 + tolerance["stage.mass"])
    least, most = (sum(part * factor**power for part, factor in parts) / (rotor + load) for power in (-1.0, 1.0))
    seen = math.log(max(found.inertia, 1e-12) / known)
    return math.log(least) - doubt - INERTIA_DOUBT - seen, math.log(most) + doubt + INERTIA_DOUBT - seen


def _scale_of_motor(found, sketch, inertia):
    """(lowest, highest) ln c by back-EMF and ``inertia`` [V s²/m; None: by back-EMF alone], and the scales that each
    alone says."""
    axis, ratio = sketch.axis, motor_ratio(sketch.axis)
    emf = axis.value("drive.back_emf") / ratio
    factor = {key: 1.0 + sketch.tolerance[key] for key in ("drive.back_emf", "drive.resistance")}
    back, viscous = math.log(max(found.volts_per_speed, 1e-12) / emf), 0.0
    if not found.has_current:  # what is seen as back-EMF has the viscous friction in it
        all_volts = float(controller_parameters("pid_feedforward", axis, {})["feedforward"]["volts_per_velocity"])
        viscous = max(all_volts / emf - 1.0, 0.0) * factor["drive.back_emf"] * factor["drive.resistance"]
        viscous *= 1.0 + sketch.tolerance.get("contacts.actuator.viscous", 1.0)
    low = -math.log(factor["drive.back_emf"]) - EMF_DOUBT - back
    high = math.log(factor["drive.back_emf"] + viscous) + EMF_DOUBT - back
    if inertia is None:
        return low, high, (math.exp(-back), math.nan)
    turned, least, most = _turned(found, sketch, inertia, back)
    return max(low, 0.5 * (least - turned)), min(high, 0.5 * (most + viscous - turned)), (
        math.exp(-back), math.exp(-0.5 * turned))


def _turned(found, sketch, inertia, back):
    """Logarithms of the seen inertia over the sketched one, with the seen back-EMF, and of the least and most that the
    sketch allows."""
    axis, ratio = sketch.axis, motor_ratio(sketch.axis)
    rotor, load = axis.value("drive.rotor_inertia"), ratio * ratio * axis.value("stage.mass")
    known = found.resistance if found.has_current else axis.value("drive.resistance")
    turned = back + math.log(
        max(inertia, 1e-12) * axis.value("drive.torque_constant") * ratio / (known * (rotor + load))
    )
    doubt = INERTIA_DOUBT + (0.0 if found.has_current else math.log1p(sketch.tolerance["drive.resistance"]))
    parts = (rotor, 1.0 + sketch.tolerance["drive.rotor_inertia"]), (load, 1.0 + sketch.tolerance["stage.mass"])
    least, most = (
        math.log(sum(part * factor**power for part, factor in parts) / (rotor + load)) for power in (-1.0, 1.0)
    )
    return turned, least - doubt, most + doubt


def _judged_scale(low, high, by):
    """`Check` of ln c between ``low`` and ``high``, ``by`` what says so. Raises Refused."""
    seen = math.exp(0.5 * (low + high))
    if low > LEAST_SCALE or high < -LEAST_SCALE:
        held = next(
            (
                f"four times too {word}"
                for scale, word in ((4.0, "many"), (0.25, "few"))
                if low <= math.log(scale) <= high
            ),
            "a wrong scale",
        )
        raise refused(
            "encoder_scale",
            seen,
            "1",
            f"the encoder counts {seen:.2g} times ({math.exp(low):.2g} to {math.exp(high):.2g}) what {by} say: {held}"
            " (decoding of the tracks: 1, 2 or 4 edges; resolution, pitch or gear in the sketch)",
        )
    return Check(
        "encoder_scale",
        True,
        seen,
        "1",
        f"the encoder counts {math.exp(low):.2g} to {math.exp(high):.2g} times what {by} say",
    )
