"""Delay and lag of the amplifier in the command channel: β = 1 at the form's own time."""

import numpy as np
from scipy.signal import lfilter

from microstage_ros.diagnosis.catalogue.form import Form
from microstage_ros.signals.rows import of_row_before

DELAYS = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0)   # periods
LAGS = (15e-6, 40e-6, 80e-6, 150e-6, 300e-6, 600e-6, 1.2e-3, 3e-3)   # s


def delayed(command, periods, winding):
    """What a command (n,) that comes ``periods`` [1] later does to the settled current, as an equivalent command.

    ``winding``: T/τ of the winding [1], see `weight_of_old`.
    """
    whole = int(periods)
    early, late = _shifted(command, whole)
    old = weight_of_old(periods - whole, winding)
    return (1.0 - old) * early + old * late


def weight_of_old(part, winding):
    """Weight [1] that a change which comes a ``part`` f of a period [1] late leaves on the value before it.

    (b − a)/(1 − a), b = exp(−(1 − f) T/τ), a = exp(−T/τ), with ``winding`` = T/τ [1], τ = L/R.
    """
    a, b = np.exp(-winding), np.exp(-(1.0 - part) * winding)
    return (b - a) / (1.0 - a)


def part_of(old, winding):
    """The part [1] of a period that leaves this weight ``old`` [1] on the value before, with ``winding`` = T/τ [1]: the
    inverse of `weight_of_old`."""
    a = np.exp(-winding)
    return 1.0 + np.log(a + old * (1.0 - a)) / winding


def _shifted(command, whole):
    """The command (n,) so many whole periods later, and one more."""
    early = np.concatenate([np.full(whole, command[0]), command[: len(command) - whole]])
    return early, of_row_before(early)


def lagged(command, time, period, winding):
    """What a command (n,) through a first-order lag does to the settled current, as an equivalent command.

    ``time``: of the lag [s]; ``period``: T [s]. The lag's own state decays by e = exp(−T/time) per period; the settled
    current gives it the weight (e − a)/((1 − a)(1 − τ/time)), a = exp(−T/τ), ``winding`` = T/τ [1].
    """
    time = _unlike(time / period, winding) * period
    keep, a = np.exp(-period / time), np.exp(-winding)
    ratio = period / winding / time
    state = lfilter([0.0, 1.0 - keep], [1.0, -keep], command, zi=[command[0]])[0]  # at the period's start
    old = (keep - a) / ((1.0 - a) * (1.0 - ratio))
    return command + (state - command) * old


def _unlike(time, winding):
    """A ``time`` [1], in periods, that is not the winding's own, where the weights below are 0/0."""
    return time * (1.0 + 1.0e-5) if abs(time * winding - 1.0) < 1.0e-6 else time


def late_and_lagged(command, periods, time, winding):
    """What a command (n,) that comes ``periods`` [1] later, through a lag of ``time`` [1] periods, does to the settled
    current, as an equivalent command.

    Within a period the old value holds for a part f and the new one for p = 1 − f, and the lag's state follows the one,
    then the other. The settled current gives the state the weight of `lagged`, the new value (1 − b)/(1 − a) −
    (e^{−p/time} − b)/((1 − a)(1 − τ/time)), b = exp(−p T/τ), a = exp(−T/τ), and the old one the rest; ``winding`` =
    T/τ [1].
    """
    whole = int(periods)
    early, late = _shifted(command, whole)
    time = _unlike(time, winding)
    part, ratio = 1.0 - (periods - whole), 1.0 / winding / time
    keep, kept, a, b = np.exp(-1.0 / time), np.exp(-part / time), np.exp(-winding), np.exp(-part * winding)
    target = (kept - keep) * late + (1.0 - kept) * early                  # what the state takes in over a period
    state = lfilter([0.0, 1.0], [1.0, -keep], target, zi=command[:1])[0]
    of_state = (keep - a) / ((1.0 - a) * (1.0 - ratio))
    new = (1.0 - b) / (1.0 - a) - (kept - b) / ((1.0 - a) * (1.0 - ratio))
    return of_state * state + new * early + (1.0 - of_state - new) * late


def transport_delay(periods):
    """u(t − delay) − u(t), the delay being ``periods`` [1], beside the motor's speed: a form's columns, (n, 1)."""
    def columns(channel, frame):
        return channel.filtered(lambda command: delayed(command, periods, channel.winding))
    return columns


def actuator_lag(time):
    """Command through a lag of ``time`` [s] minus command, beside the motor's speed: a form's columns, (n, 1)."""
    def columns(channel, frame):
        return channel.filtered(lambda command: lagged(command, time, channel.prepared.period, channel.winding))
    return columns


def _right(smallest):
    """β must be near 1 for the form's time to be the right one; the smallest form is linear down to 0."""
    return lambda beta: (0.0 if smallest else 0.4) < beta[0] < 2.0


def _time_sizes(name, time):
    def sizes(beta, covariance, frame):
        value, stderr = float(beta[0] * time), float(abs(time) * np.sqrt(covariance[0, 0]))
        return {name: (value, stderr, "s")}, {name: max(value, 0.0)}
    return sizes


def delay_form(periods, period=1e-4, anyway=False):
    """The `Form` of one delay of ``periods`` [1], with ``period`` [s]."""
    return Form("transport_delay", "command", f"{periods:g}", transport_delay(periods),
                _time_sizes("delay_s", periods * period), None if anyway else _right(periods == DELAYS[0]))


def whole_delay_form(whole):
    """The `Form` of all delays from so many ``whole`` periods [1] to one more, exactly: sizes 1 and `weight_of_old`."""
    def columns(channel, frame):
        early = channel.filtered(lambda command: _shifted(command, whole)[0])
        late = channel.filtered(lambda command: _shifted(command, whole)[1])
        return np.concatenate([early, late - early], axis=1)
    return Form("transport_delay", "command", f"from {whole}", columns)


def delay_and_lag_form(periods, time):
    """The `Form` of an amplifier that comes ``periods`` [1] late and lags by ``time`` [1] of them."""
    def columns(channel, frame):
        return channel.filtered(lambda command: late_and_lagged(command, periods, time, channel.winding))
    return Form("transport_delay", "command", f"{periods:g} beside {time:g}", columns)


def lag_form(time, anyway=False):
    """The `Form` of one time constant, ``time`` [s]."""
    return Form("actuator_lag", "command", f"{time:g}", actuator_lag(time), _time_sizes("time_s", time),
                None if anyway else _right(time == LAGS[0]))


def gain(channel, frame):
    """A gain that differs; the wind-up channel judges it."""
    return channel.beside_speed(channel.command)


FORMS = (*map(delay_form, DELAYS), *map(lag_form, LAGS), Form("generic:gain", "command", "", gain))
