"""Which law with which gains: stable, with margins, on the identified axis and on draws from what is known of it."""

from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import controller_margins, pid_margins
from microstage_ros.control.tuning.tuning import GUARDED, LEAST_GAIN, LEAST_PHASE

DRAWS = 8
SOFTER, SOFTEST = 0.85, 0.15


def choose_law(axis, drawn, has_current):
    """(law, gains over those of the rules, sentence).

    Parameters
    ----------
    axis : identified `Axis`. drawn : axes from the posterior. has_current : the observer law needs it.
    """
    if has_current and axis.choices["drive.type"] == "voltage_motor":
        parameters = controller_parameters("self_tuning_observer", axis, {})
        unstable = [k for k, a in enumerate([axis, *drawn]) if not _stable(controller_margins(a, parameters))]
        if not unstable:
            return "self_tuning_observer", {}, f"self_tuning_observer: stable on the identified axis and on {len(drawn)} draws from its uncertainty"
        reason = f"self_tuning_observer would be unstable on {len(unstable)} of {len(drawn) + 1} axes that agree with the records; "
    else:
        reason = ""
    gains, share = soft_gains("self_tuning", axis, drawn)
    return "self_tuning", gains, f"{reason}self_tuning with {share:.0%} of the rule's gains keeps {LEAST_PHASE:g}° and {LEAST_GAIN:g} dB on all of them"


def _stable(margins):
    return all(m.stable for m in margins if m.regime in GUARDED)


def soft_gains(law, axis, drawn):
    """Gains of an encoder-only law (over the rule's), lowered until every drawn axis keeps the least margins, and their share."""
    parameters = controller_parameters(law, axis, {})["pid"]
    gains = {name: float(parameters[name]) for name in parameters.dtype.names}
    share = 1.0
    while share > SOFTEST and not all(_guarded(pid_margins(a, {**gains, "proportional": share * gains["proportional"]})) for a in [axis, *drawn]):
        share *= SOFTER
    return ({} if share == 1.0 else {"proportional": share * gains["proportional"]}), share


def _guarded(margins):
    return all(m.stable and m.phase_deg >= LEAST_PHASE - 1.0 and m.gain_db >= LEAST_GAIN - 0.5 for m in margins if m.regime in GUARDED)
