"""The one contact on which all laws are measured, and what an experiment hands back.

It is the paper's actuator-gearhead assembly (Tables 1 and 2, nominal column): torque at the motor
shaft against the angle of the gearhead's output. Laws with one stiffness take the initial slope of
that virgin curve, Σk; the parameters that the paper does not give are marked as estimates.
"""

import dataclasses

import numpy

from microstage_ros.model.friction.registry import FrictionLaw, advance_law, law_named, run_law

STIFFNESS = (1.159, 0.064417, 0.013066, 0.008027, 0.002043, 0.000961)  # N m/rad, Table 1
WEIGHT = (0.575, 0.160, 0.059, 0.120, 0.051, 0.034)  # Table 1
CURVE = {  # Table 2
    "static": 219e-6,
    "coulomb": 125.6e-6,
    "stribeck_velocity": 0.18,
    "stribeck_exponent": 0.9,
    "viscous": 10.51e-6,
}
INERTIA = 1.9e-6  # N m s²/rad: rotor of 1.0e-7 kg m² seen at the output angle, 19:1 (estimate)
BLOCKS = {"stiffness": STIFFNESS, "weight": WEIGHT}
ONE_SPRING = {"stiffness": sum(STIFFNESS)}


def own_parameters(law):
    """Parameters of a law on this contact: the paper's, or else the law file's ``EXAMPLE`` (estimates)."""
    paper = {name: BLOCKS[name] if spec.is_list else sum(STIFFNESS) for name, spec in law.own.items() if name in BLOCKS}
    return {**paper, **getattr(law.file, "EXAMPLE", {})}


@dataclasses.dataclass(frozen=True)
class Finding:
    """One measured property of one law.

    Parameters
    ----------
    shown : whether the law shows the property by the experiment's criterion; None if the experiment
        has no meaning for this law.
    value : the number that the criterion judges, in the experiment's unit.
    """

    shown: bool | None
    value: float


@dataclasses.dataclass
class Contact:
    """A law with the paper's parameters, and its state, under prescribed motion.

    ``viscous`` 0 leaves the viscous part out, which every law has alike and no experiment here is about.
    """

    law: FrictionLaw
    packed: numpy.ndarray
    state: numpy.ndarray

    @classmethod
    def of(cls, name, **changes):
        """A fresh contact of the named law; ``changes`` replace parameters."""
        law = law_named(name)
        packed = law.pack({**CURVE, "viscous": 0.0, **own_parameters(law), **changes})
        return cls(law, packed, law.initial_state(packed))

    def copy(self):
        """The same contact with a state of its own."""
        return Contact(self.law, self.packed, self.state.copy())

    def run(self, velocity, period):
        """Force [N m] along a ``velocity`` [rad/s], both (n,), one sample per ``period`` [s]; carries the state on."""
        return run_law(self.law, self.packed, velocity, period, state=self.state)

    def travel(self, distance, speed, samples=400):
        """Move by ``distance`` [rad] at ``speed`` [rad/s] in ``samples`` steps [1].

        Returns (displacement from the start [rad], force [N m]), both (samples,).
        """
        velocity = numpy.copysign(speed, distance)
        period = abs(distance) / speed / samples
        force = numpy.empty(samples)
        for i in range(samples):
            force[i] = advance_law(self.law.number, self.packed, self.state, velocity, velocity, period, 1.0)
        return numpy.arange(1, samples + 1) / samples * distance, force

    def reach(self, share, speed):
        """Displacement [rad] at which first loading at ``speed`` [rad/s] has ``share`` [1] of its largest force."""
        fresh = Contact(self.law, self.packed, self.law.initial_state(self.packed))
        way, force = fresh.travel(LONGEST_WAY, speed, samples=20000)
        return float(way[numpy.argmax(force >= share * force.max())])


LONGEST_WAY = 1.2 * max(a * CURVE["static"] / k for k, a in zip(STIFFNESS, WEIGHT))  # rad: all blocks slip
