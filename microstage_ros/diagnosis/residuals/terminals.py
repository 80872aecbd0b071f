"""Torque and resonance of records whose amplifier and winding are known by now.

The motor's speed comes from its back-EMF, K_E ω = u − R i: what the amplifier makes of the command otherwise, or the
winding's resistance, is in it. The wind-up tells such a fault to a thousandth, by its integral; but in the torque,
which has the speed's derivative, and in the resonance it leaves what no friction does, and some of that passes for
creep, for a lag or for a mass. So these two channels are made anew with the voltage that the motor had at its
terminals. The wind-up stays as it is: the fault is judged there.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.catalogue.electrical import amplifier_deadband
from microstage_ros.diagnosis.residuals.collection import channels_of
from microstage_ros.diagnosis.residuals.evidence_set import Evidences

OF_AMPLIFIER = ("amplifier_offset", "amplifier_gain", "amplifier_deadband")
AT_TERMINALS = (*OF_AMPLIFIER, "resistance_rise")
MADE_ANEW = ("torque", "resonance")
CHANGED = ("learn", "held")


@dataclasses.dataclass
class _Voltage:
    """A record as the wind-up's forms see it, but for the integral: their columns are voltages (n, k) [V]."""

    prepared: object

    @staticmethod
    def integral(voltage):
        return voltage


def at_terminals(collection, evidences, choices, groups, known, law):
    """`Evidences` in which torque and resonance are those of the voltage at the motor's terminals.

    Parameters
    ----------
    collection : `Collection`, whose channels are changed. evidences, choices : what was fitted so far.
    groups : records {group: [`Record`]}. known : `prerequisites.Known`. law : `prerequisites.law.OwnLaw` or None.

    Returns
    -------
    The very same ``evidences`` where no fault of amplifier or winding was chosen, or a gap parts stage and motor.
    """
    faults = [c for c in choices if c.effect in AT_TERMINALS]
    if not faults or known.gap is not None:
        return evidences
    frame = collection.frame
    more = [_voltage_of(evidences, choices, p, frame) for group in CHANGED for p in collection.prepared[group]]
    anew = known.prepare(groups, frame.drive, collection.prepared, more)
    tables = {group: dict(getattr(evidences, group)) for group in CHANGED}
    names = [name for name in MADE_ANEW if name in evidences.learn]
    for group, how in (("learn", collection.gather), ("held", collection.growing)):
        prepared = law.replayed(anew[group], frame.drive) if law is not None else anew[group]
        for old, one in zip(collection.channels[group], prepared):
            new = channels_of(one, frame.drive)
            torque = new["torque"]
            own = [form.columns(torque, frame) @ sizes for form, sizes in collection.healthy]
            torque.take_out(sum(own, np.zeros(len(torque.residual))))
            torque.random = old["torque"].random
            for name in names:      # in their places: forms that the records suggested know their channels
                vars(old[name]).update(vars(new[name]))
        for name in names:
            tables[group][name] = how(name, [form for form in evidences.forms if form.channel == name], group)
    return evidences.with_tables(tables["learn"], tables["held"])


def beyond_the_command(collection, evidences, choices):
    """What the amplifier puts out beyond the command, without its delay or lag: voltage (n,) [V] of each learning, then
    each held-out record of a ``collection``; None where no fault of the amplifier is among the ``choices`` that were
    fitted by ``evidences``."""
    faults = [c for c in choices if c.effect in OF_AMPLIFIER]
    if not faults:
        return None
    prompt = [dataclasses.replace(p, answered=p.commanded) for name in CHANGED for p in collection.prepared[name]]
    return [_voltage_of(evidences, choices, p, collection.frame, OF_AMPLIFIER) for p in prompt]


def _voltage_of(evidences, choices, prepared, frame, effects=AT_TERMINALS):
    """What the chosen faults among ``effects`` add to the voltage that a record's amplifier was told (n,) [V]."""
    forms = {form.key: form for choice in choices for form in choice.forms if form.channel == "windup"}
    seen, total = _Voltage(prepared), np.zeros(len(prepared.time))
    for key, sizes in evidences.learn["windup"].sizes(Evidences._keys("windup", choices)).items():
        if key[0] not in effects:
            continue
        if key[0] == "amplifier_deadband":      # the catalogue's widths are a grid
            total += sizes[0] * amplifier_deadband(sizes[0])(seen, frame)[:, 0]
        else:
            total += forms[key].columns(seen, frame) @ sizes
    return total
