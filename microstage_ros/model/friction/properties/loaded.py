"""Experiments of a body under a load, whose motion is not prescribed: drift, breakaway, stick-slip.

Source: the properties are those of the paper's section 3.3; the experiments and their criteria are this project's.
"""

import numpy

from microstage_ros.model.friction.properties.contact import CURVE, INERTIA, ONE_SPRING, Contact, Finding
from microstage_ros.model.friction.properties.presliding import SPEED
from microstage_ros.model.friction.properties.slider import run_slider

DEFLECTION = CURVE["static"] / ONE_SPRING["stiffness"]  # rad, elastic deflection at the static limit
DAMPER = 1e-3  # N m s/rad, beside the contact where ringing would hide what is measured


def drift(name):
    """Drift: way per cycle under a load of 20 % ± 15 % of the largest friction, at 20 Hz, over F_s / Σk [1].

    The mean of cycles 41 to 60. Shown (it drifts) if above 0.01 %.
    """
    contact = Contact.of(name, viscous=DAMPER)
    largest = numpy.abs(contact.copy().travel(0.01, SPEED, samples=2000)[1]).max()
    period, cycle = 1e-4, 500
    time = numpy.arange(60 * cycle + 1) * period
    load = largest * (0.2 * numpy.minimum(time / 0.1, 1.0) + 0.15 * numpy.sin(2.0 * numpy.pi * 20.0 * time))
    position, _, _ = run_slider(contact, load, period, INERTIA)
    per_cycle = (position[60 * cycle] - position[40 * cycle]) / 20.0 / DEFLECTION
    return Finding(bool(abs(per_cycle) > 1e-4), float(per_cycle))


def breakaway_spread(name):
    """Spread of breakaway: highest friction under a slowly rising load less that under a fast one, over static [1].

    The loads rise by 0.1 and by 100 static limits per second. Shown if it differs by more than 2 %. The run ends
    at 20 Stribeck velocities, when the body has long broken away.
    """
    peaks = []
    for rate in (0.1, 100.0):
        contact = Contact.of(name)
        load = 3.0 * CURVE["static"] * numpy.linspace(0.0, 1.0, 30001)
        _, _, friction = run_slider(
            contact, load, 3.0 / rate / 30000, INERTIA, stop_speed=20.0 * CURVE["stribeck_velocity"]
        )
        peaks.append(friction.max() / CURVE["static"])
    spread = peaks[0] - peaks[1]
    return Finding(bool(abs(spread) > 0.02), float(spread))


def stick_slip(name):
    """Stick-slip: peak to peak of the spring's force when dragged slowly, over static [1].

    Spring of 0.02 N m/rad whose end moves at 0.01 rad/s for 8 s; the last 4 s count. Shown if above 10 %
    and the body comes to rest (less than 1 % of the drag speed) in between.
    """
    contact = Contact.of(name, viscous=CURVE["viscous"])
    spring, speed, period = 0.02, 0.01, 1e-4
    time = numpy.arange(80001) * period
    position, velocity, _ = run_slider(contact, spring * speed * time, period, INERTIA, spring)
    late = slice(40000, None)
    force = spring * (speed * time - position)[late]
    swing = (force.max() - force.min()) / CURVE["static"]
    rests = numpy.abs(velocity[late]).min() < 0.01 * speed
    return Finding(bool(swing > 0.1 and rests), float(swing))


def creep(name):
    """Creep: way crept from 1 s to 10 s under a constant load of half the largest friction, over F_s / Σk [1].

    Shown if above 0.1 %.
    """
    contact = Contact.of(name, viscous=DAMPER)
    largest = numpy.abs(contact.copy().travel(0.01, SPEED, samples=2000)[1]).max()
    period = 5e-4
    time = numpy.arange(20001) * period
    position, _, _ = run_slider(contact, 0.5 * largest * numpy.minimum(time / 0.2, 1.0), period, INERTIA)
    crept = (position[20000] - position[2000]) / DEFLECTION
    return Finding(bool(crept > 1e-3), float(crept))
