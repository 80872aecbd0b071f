"""The force that crosses the drive train, from the motion of the stage that it drives, and where a gap in it is closed.

    F_c = m dv/dt + F_g(x, v) + c v
    F_c = K_c (d − sgn(d) b/2) where |d| > b/2, else 0,     d = (r/N) θ − x

Nothing is integrated: what rattles in a gap has no place to lose. F_g is the guideways' friction, replayed on the
stage's own motion.
"""

import math

import numpy as np
from scipy.ndimage import binary_opening, maximum_filter1d

from microstage_ros.diagnosis.preprocessing.friction_replay import replayed_force
from microstage_ros.diagnosis.preprocessing.smoothing import reading_noise, triangle

# periods over which the stage's motion is smoothed; derived: a millisecond to either side, a quarter of a cycle of the
# fastest rattle, and noise of a third of the least clear force
WIDTH = 11
# of the guideways' sliding friction from which a flank carries the stage; derived: midway between one that nothing
# touches and one that slides
CARRIED = 0.5
# periods of a flank that carries the stage steadily; derived: the force is a mean over four times `WIDTH`, and a hit
# lasts some ten
STEADY = 5 * WIDTH
# periods; derived: as far as the mean over `preparation.GAP_FUSION` reaches to either side
NEAR = 1000
SIGMAS = 5.0    # of the force's own noise from which it has a sign; derived: a chance of 6·10⁻⁷


def transmitted_force(stage, drive, period, width):
    """F_c [N], shape (n,), in a triangular mean over twice ``width`` periods [1].

    Parameters
    ----------
    stage : position reading (n,) [m].
    drive : `Drive` whose mass and guideways carry the stage.
    period : of the readings [s].
    """
    acceleration = np.zeros_like(stage)
    acceleration[1:-1] = np.diff(stage, 2) / period**2
    speed = np.gradient(triangle(stage, width), period)
    friction = replayed_force(drive.guideway, speed, period)
    return triangle(drive.mass * acceleration + friction + drive.guideway.viscous * speed, width)


def force_noise(stage, drive, period, width):
    """Standard deviation [N] of `transmitted_force` by the reading's white noise: m σ √6 / (``width`` T)².

    ``stage``: the readings (n,) [m]; ``drive``: `Drive` with the mass; ``period``: T [s]; ``width`` [1], in periods.
    """
    # derived: a second difference has the variance 1 + 4 + 1
    return drive.mass * reading_noise(stage) * math.sqrt(6.0) / (width * period) ** 2


def offset_where_closed(stage, angle, gap, drive, period, pull=0.0):
    """(stage less motor without gap and wind-up (n,) [m], whether a flank carries the stage (n,)).

    Where none does the offset is bridged in a straight line: it tells nothing there. So it is where a flank is only
    hit, as far as one carries the stage steadily within `NEAR` periods: of a hit the force, a mean over more than its
    length, tells little.

    Parameters
    ----------
    stage, angle : place of the stage, and of the motor in metres of stage, (n,) [m].
    gap : b [m]. drive : `Drive` with its stiffness. period : of the rows [s].
    pull : force that pulls on the stage towards smaller x all the time [N]; a flank bears it, too.
    """
    force = transmitted_force(stage, drive, period, WIDTH) + pull
    least = max(CARRIED * drive.guideway.static, SIGMAS * force_noise(stage, drive, period, WIDTH))
    closed = np.abs(force) > least
    steady = binary_opening(closed, np.ones(STEADY))
    known = steady | (closed & (maximum_filter1d(steady, 2 * NEAR + 1) == 0))
    offset = triangle(stage - angle, WIDTH)
    if known.any():
        rows = np.flatnonzero(known)
        there = (offset + np.sign(force) * 0.5 * gap + force / drive.stiffness)[rows]
        offset = np.interp(np.arange(len(stage)), rows, there)
    return offset, closed
