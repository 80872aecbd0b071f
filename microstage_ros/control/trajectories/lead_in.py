"""What happened before a reference that begins in motion: the rows that a record cut away.

A reference table is often cut out of a longer run. Put at rest at its first value, the loop answers
with a jolt that the machine never had. So the reference is led in from rest at the acceleration of its
first rows, over rows that are simulated and not recorded.
"""

import numpy as np

LONGEST = 20_000               # rows of a lead-in; a slower start is taken as it is


def lead_in(reference, resolution):
    """Rows of the reference [m] before its first one, from rest; shape (rows,), empty if it begins at rest.

    ``resolution`` [m]: a first step within one count is no motion.

    With v and a the first and second difference per row: r(−n) = r(0) − n (v − a/2) + n² a/2 back to where the
    speed is zero. A start at constant speed has no such point; it is taken as it is.
    """
    if len(reference) < 4 or abs(reference[1] - reference[0]) <= resolution:
        return np.empty(0)
    bend = np.diff(reference[:4], 2).mean()
    speed = reference[1] - reference[0] - 0.5 * bend
    if speed * bend <= 0.0 or speed / bend > LONGEST:
        return np.empty(0)
    back = np.arange(int(np.ceil(speed / bend - 1e-6)), 0, -1)
    rows = reference[0] - back * speed + 0.5 * bend * back**2
    rest = reference[0] - 0.5 * speed**2 / bend
    return np.where(back * bend / speed > 1.0, rest, rows)
