"""Sensor of the motor current: a first-order filter, sampled once per period, perhaps before the encoder.

Within a period of held voltage the current approaches its end i_a with the winding's L/R, and the filter (time constant
S) follows it. From i_0, s_0 at the period's start:

    s(t) = i_a + (i_0 - i_a) g exp(-t R/L) + (s_0 - i_a - (i_0 - i_a) g) exp(-t/S),    g = (L/R) / (L/R - S)

Derived: S ds/dt = i(t) − s with i(t) = i_a + (i_0 − i_a) exp(−t R/L), solved from i_0 and s_0.
"""

import math


def current_filter(time, period, settling, bandwidth):
    """Weights of current now, current a period before and filter a period before in the filter's output.

    Parameters
    ----------
    time : of the output after the period's start [s]. period : control period [s]. settling : L/R [s].
    bandwidth : -3 dB frequency of the filter [Hz], 0 for none.

    Returns
    -------
    three numbers that sum to 1.
    """
    share, approach, fade, g = _parts(time, settling, bandwidth)
    end = math.exp(-period / settling)
    return share / (1.0 - end), g * (approach - fade) - share * end / (1.0 - end), fade


def sensed_transient(period, settling, bandwidth, skew):
    """What a reading still shows of a step of the voltage a period before [1].

    1 less its share of the current's new end.

    Parameters
    ----------
    period, settling : as above [s]. bandwidth : [Hz]. skew : time by which the current is sampled before the period's
        end [s].
    """
    return 1.0 - _parts(period - skew, settling, bandwidth)[0]


def _parts(time, settling, bandwidth):
    """(share of i_a, exp(-t R/L), exp(-t/S), g)."""
    filtering = 1.0 / (2.0 * math.pi * bandwidth) if bandwidth > 0.0 else 0.0
    if abs(filtering - settling) < 1e-6 * settling:  # the limit of equal time constants, near enough
        filtering *= 1.0 + 1e-5
    g = settling / (settling - filtering)
    approach = math.exp(-time / settling)
    fade = math.exp(-time / filtering) if filtering > 0.0 else 0.0
    return 1.0 - g * approach + (g - 1.0) * fade, approach, fade, g
