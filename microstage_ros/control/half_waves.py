"""Half waves of a signal in a row: how a loop that swings is distinguished from noise and from single moves.

A half wave ends where the signal without its slow part changes its sign; its size is the largest value since the sign
before. Half waves count as swings while each is larger than a least size and follows the one before within a longest
time. The laws differ in the signal, the size, the time and in what they do then.

Noise changes the sign several times as a swing passes through zero. Where that matters, the signal has to be beyond a
hysteresis on the other side before the half wave is over: else the small half waves of the noise end the row.
"""

from microstage_ros.numerics.compiled import compiled


@compiled
def half_wave(fast, peak, swings, since, longest, least, hysteresis):
    """One period.

    Parameters
    ----------
    fast, peak : the signal without its slow part [m], and its largest value since its sign changed [m].
    swings : in a row so far. since : time since the sign changed [s].
    longest : time between two that belong together [s]. least : size of a half wave that is a swing [m].
    hysteresis : value [m] that the signal has to pass on the other side.

    Returns
    -------
    swings : in a row now. turned : whether the sign changed in this period; the caller then begins a new half wave.
    """
    count = 0 if since > longest else swings
    turned = fast * peak < 0.0 and abs(fast) > hysteresis
    if turned:
        count = count + 1 if abs(peak) > least else 0
    return count, turned
