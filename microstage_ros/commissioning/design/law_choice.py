"""Which law with which gains: stable, with margins, on the identified axis and on draws from what is known of it."""

from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import controller_margins, pid_margins
from microstage_ros.control.tuning.tuning import GUARDED

DRAWS = 8
SOFTER, SOFTEST = 0.9, 0.4  # of the bandwidth: from one trial to the next, and least
SLIDING = GUARDED[1]
LEAST_PHASE, LEAST_GAIN = 25.0, 4.5  # degrees, dB


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
    gains, share = soft_gains("self_tuning_feedforward", axis, drawn)
    return "self_tuning_feedforward", gains, (f"{reason}self_tuning_feedforward with {share:.0%} of the rule's bandwidth: {LEAST_PHASE:g}° and {LEAST_GAIN:g} dB in sliding "
                                  "on all of them" + (" are not reached" if share <= SOFTEST else ""))


def _stable(margins):
    return all(m.stable for m in margins if m.regime in GUARDED)


def slower(gains, share):
    """PID gains with all bandwidths (of damping, position, integral, filter) lowered to ``share``."""
    return {"proportional": gains["proportional"] * share**2,
            **{name: gains[name] / share for name in ("integral_time", "derivative_time", "filter_time")}}


def soft_gains(law, axis, drawn):
    """Gains of an encoder-only law (over the rule's), slowed down until every drawn axis keeps the least margins in sliding, and
    the share of the rule's bandwidth. At rest the law calms itself; the machine shows whether that is enough.
    """
    parameters = controller_parameters(law, axis, {})["pid"]
    gains = {name: float(parameters[name]) for name in parameters.dtype.names}
    share = 1.0
    while share > SOFTEST and not all(_guarded(pid_margins(a, {**gains, **slower(gains, share)})) for a in [axis, *drawn]):
        share *= SOFTER
    return ({} if share == 1.0 else slower(gains, share)), share


def _guarded(margins):
    return all(m.stable and m.phase_deg >= LEAST_PHASE and m.gain_db >= LEAST_GAIN for m in margins if m.regime == SLIDING)
