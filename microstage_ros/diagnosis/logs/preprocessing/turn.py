"""One turn of the drive along the coordinate: from the lead, from angles, or guessed from the ripple itself."""

import numpy as np

STEADY = 2
STRONG = 12.0            # power of a line over the median of its neighbourhood that makes a guess
LEAST_TURNS = 6          # periods over the stroke that a guess must have


def turn_of(groups, channels, description, stroke):
    """(length of one turn in the coordinate's unit or 0, sentence if it is a guess).

    ``stroke``: (lowest, highest) coordinate in the unit of the position.
    """
    log = groups["baseline"][0].log
    if "lead" in description.facts and log.place_unit == "m":
        return description.facts["lead"], ""
    if log.place_unit == "rad":
        return 2.0 * np.pi, ""
    if not groups["baseline"][0].motion.absolute or "effort" not in channels:
        return 0.0, ""
    period = _guess(groups, channels["effort"], stroke)
    if not period:
        return 0.0, ""
    return (
        period,
        f"No lead was given; a ripple of {period * 1e3:.4g} mm of travel is taken for one turn. This is a guess.",
    )


def _guess(groups, channel, stroke):
    """Period of the strongest line of the effort over the place, or 0."""
    span = abs(stroke[1] - stroke[0])
    if span <= 0.0:
        return 0.0
    frequencies = np.arange(LEAST_TURNS, 400) / span
    power, count = np.zeros(len(frequencies)), 0
    for rows in [*groups["baseline"][:4], *groups["now"][:4]]:
        m, y = rows.motion, channel.values(rows) - channel.predicted(rows)
        for direction in (-1, 1):
            use = (m.state == STEADY) & (m.direction == direction) & np.isfinite(y)
            if use.sum() < 200:
                continue
            index = np.flatnonzero(use)[:20_000]
            step = float(np.median(np.abs(m.speed[index]))) * rows.log.period
            x, r = m.x[index], y[index] - y[index].mean()
            limit = frequencies < 0.4 / max(step, 1e-300)
            wave = np.array([np.abs(np.mean(r * np.exp(-2j * np.pi * f * x))) ** 2 for f in frequencies[limit]]) / max(
                np.var(r), 1e-300
            )
            full = np.zeros(len(frequencies))
            full[limit] = wave
            power, count = power + full, count + 1
    if not count:
        return 0.0
    k = int(np.argmax(power))
    usual = np.median(power[power > 0.0]) if (power > 0.0).any() else 1.0
    return float(1.0 / frequencies[k]) if power[k] > STRONG * usual and k > 0 else 0.0
