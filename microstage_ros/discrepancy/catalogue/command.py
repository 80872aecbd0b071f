"""Delay and lag of the amplifier in the command channel: β = 1 at the form's own time."""

import numpy as np
from scipy.signal import lfilter

from microstage_ros.discrepancy.catalogue.form import Form

DELAYS = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0)   # periods
LAGS = (15e-6, 40e-6, 80e-6, 150e-6, 300e-6, 600e-6, 1.2e-3, 3e-3)   # s


def delayed(command, periods):
    """Command (n,) that comes ``periods`` later, linear between whole periods."""
    whole, part = int(periods), periods - int(periods)
    early = np.concatenate([np.full(whole, command[0]), command[: len(command) - whole]])
    late = np.concatenate([early[:1], early[:-1]])
    return (1.0 - part) * early + part * late


def lagged(command, time, period):
    """Command (n,) through a first-order lag, as it stands at the end of each period."""
    keep = np.exp(-period / time)
    return lfilter([1.0 - keep], [1.0, -keep], command, zi=[keep * command[0]])[0]


def transport_delay(periods):
    """u(t − delay) − u(t)."""
    def columns(channel, frame):
        return (delayed(channel.command, periods) - channel.command)[:, None]
    return columns


def actuator_lag(time):
    """Lagged command minus command."""
    def columns(channel, frame):
        return (lagged(channel.command, time, channel.prepared.period) - channel.command)[:, None]
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
    """The form of one delay."""
    return Form("transport_delay", "command", f"{periods:g}", transport_delay(periods),
                _time_sizes("delay_s", periods * period), None if anyway else _right(periods == DELAYS[0]))


def lag_form(time, anyway=False):
    """The form of one time constant."""
    return Form("actuator_lag", "command", f"{time:g}", actuator_lag(time), _time_sizes("time_s", time),
                None if anyway else _right(time == LAGS[0]))


FORMS = (*map(delay_form, DELAYS), *map(lag_form, LAGS))
