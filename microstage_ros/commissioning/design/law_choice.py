"""Which law with which gains: stable, with margins, on the identified axis and on draws from what is known of it."""

import math

from microstage_ros.control.design.rules import OBSERVER_PERIOD
from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.tuning.margins import controller_margins, pid_margins
from microstage_ros.control.tuning.tuning import GUARDED

DRAWS = 8
SOFTER, SOFTEST = 0.9, 0.4  # of the bandwidth: from one trial to the next, and least
SLIDING = GUARDED[1]
LEAST_PHASE, LEAST_GAIN = 25.0, 4.5  # degrees, dB
OBSERVER = "self_tuning_observer"
OBSERVER_STEPS = ((1.0, 1.0), (1.0, 2.0), (0.8, 2.0), (0.8, 3.0), (0.8, 4.0), (0.65, 1.0), (0.65, 2.0), (0.65, 4.0))
"""(share of the bandwidth, factor on the doubt in the back-EMF) of the observer law's trials, what costs least first: the
back-EMF makes its loop fast and takes the margins, the encoder is slower and leaves them. On four simulated machines the moves'
4s stayed as it was down to 0.8 of the bandwidth with 4 times the doubt; 0.65 cost up to a factor of three, 0.5 of eight."""
OBSERVER_PHASE, OBSERVER_GAIN = 20.0, 2.0  # degrees, dB, that end the trials
BARE = 0.25  # of both, below which the law is not taken


def choose_law(axis, drawn, has_current):
    """(law, gains over those of the rules, sentence).

    Parameters
    ----------
    axis : identified `Axis`. drawn : axes from the posterior. has_current : the observer law needs it.
    """
    reason = ""
    if has_current and axis.choices["drive.type"] == "voltage_motor":
        gains, reach, step = observer_gains(axis, drawn)
        if reach >= BARE:
            changed = "" if step == OBSERVER_STEPS[0] else f", with {step[0]:.0%} of the rule's bandwidth and {step[1]:g} times its doubt in the back-EMF"
            return OBSERVER, gains, (f"{OBSERVER}{changed}: at least {min(reach, 1.0) * OBSERVER_PHASE:.0f}° and {min(reach, 1.0) * OBSERVER_GAIN:.1f} dB at the "
                                     f"amplifier on the identified axis and on {len(drawn)} draws from its uncertainty")
        reason = (f"{OBSERVER} is not stable on the identified axis and on {len(drawn)} draws from its uncertainty with at least "
                  f"{BARE * OBSERVER_PHASE:.0f}° and {BARE * OBSERVER_GAIN:.1f} dB; ")
    gains, share = soft_gains("self_tuning_feedforward", axis, drawn)
    return "self_tuning_feedforward", gains, (f"{reason}self_tuning_feedforward with {share:.0%} of the rule's bandwidth: {LEAST_PHASE:g}° and {LEAST_GAIN:g} dB in sliding "
                                  "on all of them" + (" are not reached" if share <= SOFTEST else ""))


def observer_gains(axis, drawn):
    """(gains over the rule's, reach, step) of the observer law: the first of `OBSERVER_STEPS` whose reach is 1, or the farthest.

    The reach is the least of phase margin / `OBSERVER_PHASE` and gain margin / `OBSERVER_GAIN` over the axis, the draws and
    the guarded regimes; -1 where the loop is unstable or the check before a start (`start_check`) says no.
    """
    rule = controller_parameters(OBSERVER, axis, {})
    pid = {name: float(rule["pid"][name]) for name in rule["pid"].dtype.names}
    doubt = float(rule["observer"]["voltage_noise"])
    held = axis.value("period") > OBSERVER_PERIOD  # gains on the stage's swing too, that are designed together
    best = {}, -1.0, OBSERVER_STEPS[0]
    for step in OBSERVER_STEPS:
        if held and step[0] != 1.0:
            continue
        softer = {name: value for name, value in slower(pid, step[0]).items() if name != "filter_time"}
        gains = {**(softer if step[0] != 1.0 else {}), **({"voltage_noise": step[1] * doubt} if step[1] != 1.0 else {})}
        found = _reach(axis, drawn, controller_parameters(OBSERVER, axis, gains), best[1])
        if found > best[1]:
            best = gains, found, step
        if found >= 1.0:
            break
    return best


def _reach(axis, drawn, parameters, enough):
    """See `observer_gains`; the search of the draws ends below ``enough``."""
    if parameters["unstable"]:
        return -1.0
    found = math.inf
    for each in [axis, *drawn]:
        for m in controller_margins(each, parameters):
            if m.regime in GUARDED:
                found = min(found, m.phase_deg / OBSERVER_PHASE, m.gain_db / OBSERVER_GAIN) if m.stable else -1.0
        if found <= enough:
            break
    return found


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
