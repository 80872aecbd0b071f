"""From which past step of the voltage the current answers; a delay of `LEAST` periods or more.

The squared correlation of the current's steps with those of the voltage `lag` periods ago is near 1 at the true lag
where steps of the command are what moves the current, however large R is, and near 0 where noise does. A long one is
clear only where it is clearer than any shorter one; then the observer counts with the voltage of then
(`drive_learning.find_lag`), and the observer law with a slower loop (`self_tuning_observer.slow_for_delay`).
"""

from microstage_ros.numerics.compiled import compiled

LONGEST = 24  # periods
LEAST = 5  # periods
MEMORY = 0.01  # 1/periods
CLEAR = 0.5  # squared correlation
SHARPER = 0.25  # of it, beyond that of every shorter delay: a slow amplifier answers to all of them alike
CLEAR_TIME = 2e-3  # s, for which it is clear
FIELDS = [
    ("far_voltages", "f8", LONGEST + 1),  # V, a ring
    ("far_answers", "f8", LONGEST),  # V A, mean products, by lag
    ("far_place", "i8"),  # of the newest step
    ("far_voltage_power", "f8"),  # V^2
    ("far_current_power", "f8"),  # A^2
    ("far_time_s", "f8"),  # s, for which a long delay has been clear; shorter again while a short one is
    ("delayed", "i8"),  # 1: the current answers that late
    ("delay", "i8"),  # periods, how late
]


@compiled
def long_delay_reset(s):
    """No delay known."""
    s.far_voltages[:] = 0.0
    s.far_answers[:] = 0.0
    s.far_place = 0
    s.far_voltage_power = 0.0
    s.far_current_power = 0.0
    s.far_time_s = 0.0
    s.delayed = 0
    s.delay = 0


@compiled
def keep_far_voltage(s, voltage):
    """Remember the ``voltage`` [V] of the newest period."""
    s.far_place = s.far_place + 1 if s.far_place < LONGEST else 0
    s.far_voltages[s.far_place] = voltage


@compiled
def far_voltage(s, lag):
    """Voltage [V] of ``lag`` periods ago, `LONGEST` [1] at most."""
    return s.far_voltages[s.far_place - lag if s.far_place >= lag else s.far_place - lag + LONGEST + 1]


@compiled
def watch_long_delay(s, period, current_step):
    """One period: a step of the current [A]."""
    most, short, lag = 0.0, 0.0, 0
    k = s.far_place
    later = s.far_voltages[k]
    voltage_step = later - far_voltage(s, 1)
    for j in range(LONGEST):
        k = k - 1 if k > 0 else LONGEST
        before = s.far_voltages[k]
        s.far_answers[j] += MEMORY * (current_step * (later - before) - s.far_answers[j])
        later = before
        if s.far_answers[j] > most:
            most, lag = s.far_answers[j], j
        if j < LEAST:
            short = max(short, s.far_answers[j])
    s.far_voltage_power += MEMORY * (voltage_step * voltage_step - s.far_voltage_power)
    s.far_current_power += MEMORY * (current_step * current_step - s.far_current_power)
    power = s.far_voltage_power * s.far_current_power
    if most * most > CLEAR * power:
        late = most * most - short * short > SHARPER * power
        s.far_time_s = min(max(s.far_time_s + (period if late else -period), 0.0), CLEAR_TIME)
    if s.far_time_s == CLEAR_TIME:
        s.delayed, s.delay = 1, lag
    elif s.far_time_s == 0.0:
        s.delayed = 0
