"""Position, speed and acceleration of a record by a local cubic polynomial (Savitzky, Golay, Analytical Chemistry 36
(1964))."""

from scipy.signal import savgol_filter

from microstage_ros.signals.rows import bridged

SMOOTH = 4e-3  # s, length of the polynomial


def window_rows(period):
    """Rows of the polynomial, an odd number of at least 7; ``period``: of control [s]."""
    return max(int(SMOOTH / period) | 1, 7)


def smoothed(record, period):
    """(position [m], speed [m/s], acceleration [m/s^2]) over `SMOOTH`, each of shape (n,); missing readings are
    interpolated. ``period``: of control [s]."""
    x = bridged(record["encoder_m"])
    return tuple(savgol_filter(x, window_rows(period), 3, deriv=k, delta=period) for k in range(3))
