"""Experiments of sliding under prescribed motion: Stribeck curve, lag, dwell, energy.

Source: the properties are those of the paper's section 3.3; the experiments and their criteria are this project's.
"""

import numpy

from microstage_ros.model.friction.properties.contact import CURVE, Contact, Finding

VELOCITY = CURVE["stribeck_velocity"]
DROP = CURVE["static"] - CURVE["coulomb"]


def stribeck(name):
    """Stribeck curve: fall of the steady force from 0.01 to 5 Stribeck velocities, over static [1].

    Shown if it falls by more than 5 %.
    """
    levels = []
    for speed in (0.01 * VELOCITY, 5.0 * VELOCITY):
        contact = Contact.of(name)
        _, force = contact.travel(0.1, speed, samples=4000)
        levels.append(force[-1])
    fall = (levels[0] - levels[1]) / CURVE["static"]
    return Finding(bool(fall > 0.05), float(fall))


def frictional_lag(name):
    """Frictional lag: force accelerating less force decelerating at the same speed, over the Stribeck drop [1].

    Speed 1 ± 0.5 Stribeck velocities at 20 Hz; shown if above 0.1 % and larger than at 2 Hz.
    """
    lags = []
    for frequency in (2.0, 20.0):
        contact = Contact.of(name)
        contact.travel(0.1, VELOCITY, samples=2000)
        time = numpy.arange(0, 3 * 4000 + 1) / 4000.0  # in periods
        force = contact.run(VELOCITY * (1.0 + 0.5 * numpy.sin(2.0 * numpy.pi * time)), 1.0 / 4000.0 / frequency)
        lags.append((force[8000] - force[10000]) / DROP)  # both pass the mean speed, up and down
    return Finding(bool(lags[1] > 0.001 and lags[1] > lags[0]), float(lags[1]))


def rising_static_friction(name):
    """Rising static friction: growth of the breakaway force per decade of dwell, over static [1].

    Slide, stop within 0.1 s, hold still for 0.1 to 100 s, start again at 10 Stribeck velocities per
    second; the peak counts. Shown if above 0.5 % per decade.
    """
    dwells, peaks = numpy.array([0.1, 1.0, 10.0, 100.0]), []
    for dwell in dwells:
        contact = Contact.of(name)
        contact.travel(0.1, VELOCITY, samples=2000)
        contact.run(numpy.linspace(VELOCITY, 0.0, 1001), 1e-4)
        contact.run(numpy.zeros(101), dwell / 100.0)
        peaks.append(contact.run(numpy.linspace(0.0, VELOCITY, 2001), 5e-5).max())
    slope = numpy.polyfit(numpy.log10(dwells), peaks, 1)[0] / CURVE["static"]
    return Finding(bool(slope > 0.005), float(slope))


def passivity(name, **changes):
    """Passivity: work put in over a cycle, less what is stored, over static limit times travel [1].

    The cycles are built to get energy out: a stroke at 5 Stribeck velocities, a stop within 1 µs, 1 ms at
    1e-6 of that speed, in which the force may climb to static, and the same way back. Sixteen strokes between 0.05 and
    2 mrad, two cycles to settle, four that count; besides, 30 random motions over five decades of speed.
    The smallest figure counts; shown (no energy is made) if above −0.1 %.
    """
    figures = []
    speed, period = 5.0 * VELOCITY, 1e-6
    for stroke in numpy.geomspace(0.05e-3, 2e-3, 16):
        half = numpy.concatenate((numpy.full(int(stroke / speed / period), speed), numpy.full(1000, 1e-6 * speed)))
        cycle = numpy.concatenate((half, -half))
        figures.append(_dissipation(Contact.of(name, **changes), numpy.tile(cycle, 2), numpy.tile(cycle, 4), period))
    random = numpy.random.default_rng(7)
    for _ in range(30):
        knots = random.normal(size=40) * 10.0 ** random.uniform(-3, 2, size=40) * VELOCITY
        motion = numpy.interp(numpy.arange(0, 39, 0.005), numpy.arange(40), knots)
        figures.append(_dissipation(Contact.of(name, **changes), motion[:2], motion, 1e-5))
    worst = min(figures)
    return Finding(bool(worst > -1e-3), float(worst))


def _dissipation(contact, settle, motion, period):
    """(Work put in − growth of the stored energy) / (static limit × travel) over ``motion``."""
    contact.run(settle, period)
    stored = contact.law.stored_energy(contact.packed, contact.state)
    power = contact.run(motion, period) * motion
    work = numpy.trapezoid(power, dx=period)
    stored = contact.law.stored_energy(contact.packed, contact.state) - stored
    return (work - stored) / (CURVE["static"] * numpy.trapezoid(numpy.abs(motion), dx=period))
