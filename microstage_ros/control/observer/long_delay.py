"""A delay of the voltage longer than `drive_learning` allows for: found from which past step of it the current answers.

The squared correlation of the current's steps with those of the voltage `lag` periods ago is near 1 at the true lag
where steps of the command are what moves the current, however large R is, and near 0 where noise does. The observer law
is not designed for such a delay: the supervision hands over.
"""

from microstage_ros.numerics.compiled import compiled

LONGEST = 24  # periods
LEAST = 5  # periods, from which on the observer law may swing
MEMORY = 0.01  # 1/periods
CLEAR = 0.5  # squared correlation
SHARPER = 0.25  # of it, beyond that of every shorter delay: a slow amplifier answers to all of them alike
CLEAR_TIME = 2e-3  # s, for which it is clear
FIELDS = [
    ("far_steps", "f8", LONGEST),  # V, a ring
    ("far_answers", "f8", LONGEST),  # V A, mean products, by lag
    ("far_place", "i8"),  # of the newest step
    ("far_voltage_power", "f8"),  # V^2
    ("far_current_power", "f8"),  # A^2
    ("far_time_s", "f8"),  # s, for which a long delay has been clear; shorter again while a short one is
    ("delayed", "i8"),  # 1: the current answers that late
    ("delay_s", "f8"),  # s, how late
]


@compiled
def long_delay_reset(s):
    """No delay known."""
    s.far_steps[:] = 0.0
    s.far_answers[:] = 0.0
    s.far_place = 0
    s.far_voltage_power = 0.0
    s.far_current_power = 0.0
    s.far_time_s = 0.0
    s.delayed = 0
    s.delay_s = 0.0


@compiled
def watch_long_delay(s, period, voltage_step, current_step):
    """One period: steps of voltage [V] and current [A]."""
    newest = s.far_place + 1 if s.far_place + 1 < LONGEST else 0
    s.far_place = newest
    s.far_steps[newest] = voltage_step
    most, short, lag = 0.0, 0.0, 0
    for j in range(LONGEST):
        k = newest - j if newest >= j else newest - j + LONGEST
        s.far_answers[j] += MEMORY * (current_step * s.far_steps[k] - s.far_answers[j])
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
        s.delayed, s.delay_s = 1, lag * period
    elif s.far_time_s == 0.0:
        s.delayed = 0
