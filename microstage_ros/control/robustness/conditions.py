"""Conditions of a robustness campaign: machines, sensors and effects that the controller is not given.

A `Condition` changes the machine that is simulated; the controller keeps the axis file, unless ``given`` says that the
axis file is right about the change. `random_machine` draws every number of a machine within a factor.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from microstage_ros.control.laws.controller import make_controller
from microstage_ros.control.runs.closed_loop import TRACE, run_loop
from microstage_ros.solver.plant import NoiseSpec, make_plant, new_readings, new_state, new_work, usual_start

MASS, STIFFNESS, INERTIA = "stage.mass", "transmission.stiffness", "drive.rotor_inertia"
MOTOR = ("drive.back_emf", "drive.torque_constant")


@dataclass(frozen=True)
class Condition:
    """One machine of a campaign.

    Attributes
    ----------
    name : what a person reads and ``--only`` takes.
    factors : {key of the axis file: factor on the machine's number}.
    values : {key of the axis file: the machine's number}.
    effects, noise : as in a run file. period_s : control period [s], None for the axis's own.
    given : the axis file that the controller has is changed in the same way (effects excepted).
    """

    name: str
    factors: dict = field(default_factory=dict)
    values: dict = field(default_factory=dict)
    effects: dict = field(default_factory=dict)
    noise: dict = field(default_factory=dict)
    period_s: float | None = None
    given: bool = False

    def machine(self, axis):
        """`Axis` of the machine that is simulated."""
        changed = {}
        for key, factor in self.factors.items():
            value = axis.value(key)
            changed[key] = [factor * v for v in value] if isinstance(value, list) else factor * value
        machine = axis.with_values({**changed, **self.values}, source="derived")
        return machine.with_effects({**axis.effects, **self.effects})

    def assumed_axis(self, axis):
        """`Axis` that the controller is given, to be simulated on `machine`."""
        machine = self.machine(axis)
        return (machine.with_effects(axis.effects) if self.given else axis).simulated_on(machine)


def conditions(axis):
    """The standard conditions, a list of `Condition`; only those that the axis can have."""
    found = [Condition("nominal")]
    for factor in (0.3, 0.5, 2, 3, 4, 5, 6, 8, 10):
        found.append(Condition(f"mass x {factor:g}", {MASS: factor}))
    for factor in (0.1, 0.2, 0.33, 0.5, 2, 4):
        found.append(Condition(f"stiffness x {factor:g}", {STIFFNESS: factor}))
    for factor in (0.25, 0.5, 2, 3, 4):
        found.append(Condition(f"rotor inertia x {factor:g}", {INERTIA: factor}))
    found += [
        Condition("mass x 3, stiffness / 3", {MASS: 3.0, STIFFNESS: 1 / 3}),
        Condition("mass x 6, stiffness / 3", {MASS: 6.0, STIFFNESS: 1 / 3}),
        Condition("mass x 6, axis file right", {MASS: 6.0}, given=True),
        Condition("mass x 10, axis file right", {MASS: 10.0}, given=True),
        Condition("stiffness / 5, axis file right", {STIFFNESS: 0.2}, given=True),
        Condition("damping of the drive / 5", {"transmission.damping": 0.2}),
    ]
    for factor in (0.8, 1.2):
        found += [
            Condition(f"motor constant x {factor:g}", dict.fromkeys(MOTOR, factor)),
            Condition(f"torque constant x {factor:g}", {"drive.torque_constant": factor}),
            Condition(f"back-EMF x {factor:g}", {"drive.back_emf": factor}),
        ]
    for factor in (0.5, 0.7, 1.3, 2):
        found.append(Condition(f"resistance x {factor:g}", {"drive.resistance": factor}))
    friction = ("contacts.actuator.static", "contacts.actuator.coulomb", "contacts.guideway.static")
    for factor in (0.3, 0.5, 2, 3):
        found.append(Condition(f"friction x {factor:g}", dict.fromkeys(friction, factor)))
    found += [
        Condition("Stribeck velocity x 0.5", {"contacts.actuator.stribeck_velocity": 0.5}),
        Condition("Stribeck velocity x 3", {"contacts.actuator.stribeck_velocity": 3.0}),
        Condition(
            "pre-sliding stiffness x 0.4", {"contacts.actuator.stiffness": 0.4, "contacts.guideway.stiffness": 0.4}
        ),
        Condition(
            "pre-sliding stiffness x 3", {"contacts.actuator.stiffness": 3.0, "contacts.guideway.stiffness": 3.0}
        ),
        Condition("friction varies by 0.12", noise={"friction_relative": 0.12}),
    ]
    for seconds in (1e-4, 2e-4, 3e-4, 5e-4, 1e-3, 2e-3):
        found.append(_effect(f"delay {seconds * 1e3:g} ms", "transport_delay", delay_s=seconds))
    for seconds in (1e-4, 3e-4, 1e-3):
        found.append(_effect(f"actuator lag {seconds * 1e3:g} ms", "actuator_lag", time_s=seconds))
    for volts in (5e-3, 1e-2, 2e-2, 5e-2):
        found.append(_effect(f"dead band {volts * 1e3:g} mV", "amplifier_deadband", half_width_V=volts))
    for factor in (0.5, 0.7, 1.4, 2.0):
        found.append(_effect(f"amplifier gain x {factor:g}", "amplifier_gain", factor=factor))
    for volts in (-0.1, 0.02, 0.1):
        found.append(_effect(f"amplifier offset {volts * 1e3:g} mV", "amplifier_offset", offset_V=volts))
    for degrees in (0.1, 0.25, 0.5, 1.0):
        found.append(_effect(f"backlash {degrees:g} deg", "backlash", width_rad=math.radians(degrees)))
    found += _sensing() + _forces()
    for period in (2e-4, 5e-4, 1e-3):
        found.append(Condition(f"{1e-3 / period:g} kHz", period_s=period))
    if axis.choices["drive.type"] != "voltage_motor" or axis.law("actuator") == "none":
        found = [c for c in found if all(axis.has(key) for key in c.factors)]
    return found


def _effect(name, effect, **parameters):
    return Condition(name, effects={effect: parameters})


def _sensing():
    """Conditions of the sensors."""
    found = [Condition(f"current noise {1e3 * a:g} mA", noise={"current_A": a}) for a in (3e-4, 1e-3, 3e-3, 5e-3, 2e-2)]
    found += [
        Condition(f"current offset {1e3 * a:g} mA", values={"sensors.current.offset": a}) for a in (-2e-3, 2e-3, 2e-2)
    ]
    found += [
        Condition("current converter of 10 bits", values={"sensors.current.bits": 10}),
        Condition("current filter 1 kHz", values={"sensors.current.bandwidth": 1e3}),
        Condition("current filter 300 Hz", values={"sensors.current.bandwidth": 300.0}),
        Condition("encoder noise 25 nm", noise={"encoder_m": 2.5e-8}),
        Condition("encoder count 100 nm", values={"sensors.encoder.resolution": 1e-7}),
        Condition("interpolation error 50 nm", values={"sensors.encoder.interpolation_error": [5e-8, 2e-8]}),
        Condition("amplifier noise 5 mV", noise={"voltage_V": 5e-3}),
        _effect("samples lost 5 %", "sampling_jitter", lost_fraction=0.05),
        _effect("samples late 50 us", "sampling_jitter", late_s=5e-5, jitter_s=1e-5),
        _effect("floor vibration 20 nm at 30 Hz", "floor_vibration", frequencies_hz=[30.0], amplitudes_m=[2e-8]),
    ]
    return found


def _forces():
    """Conditions of forces, friction and mixtures."""
    tilt = {"gravity_tilt": {"angle_rad": 0.1}}
    return [
        Condition("tilt 0.1 rad", effects=tilt),
        Condition("tilt 0.1 rad, mass x 6", {MASS: 6.0}, effects=tilt),
        Condition(
            "payload 6.12 kg and drive compliance 0.33",
            effects={"payload_change": {"mass_kg": 6.12}, "drive_compliance": {"stiffness_factor": 0.33}},
        ),
        _effect("payload 6.12 kg", "payload_change", mass_kg=6.12),
        _effect("payload 15 kg", "payload_change", mass_kg=15.0),
        _effect("drive compliance 0.33", "drive_compliance", stiffness_factor=0.33),
        _effect("drive compliance 0.15", "drive_compliance", stiffness_factor=0.15),
        _effect("cable spring 20 kN/m", "cable_spring", stiffness_N_m=2e4),
        _effect("torque ripple 20 uN m", "torque_ripple", amplitude_Nm=2e-5, cycles_per_turn=6.0),
        _effect("screw pitch error 0.3 um", "screw_pitch_error", amplitude_m=3e-7),
        _effect("direction asymmetry 0.2", "direction_asymmetry", asymmetry=0.2),
        _effect("frictional lag 5 ms", "frictional_lag", time_s=5e-3),
        _effect("resistance + 30 %", "resistance_rise", initial=0.3, time_s=1e5),
        Condition("delay 0.3 ms, mass x 3", {MASS: 3.0}, effects={"transport_delay": {"delay_s": 3e-4}}),
        Condition(
            "friction x 2, mass x 3, stiffness / 2",
            {MASS: 3.0, STIFFNESS: 0.5, "contacts.actuator.static": 2.0, "contacts.actuator.coulomb": 2.0},
        ),
        Condition(
            "backlash 0.5 deg, current noise 1 mA",
            effects={"backlash": {"width_rad": math.radians(0.5)}},
            noise={"current_A": 1e-3},
        ),
        Condition("current noise 1 mA, resistance x 1.3", {"drive.resistance": 1.3}, noise={"current_A": 1e-3}),
    ]


def random_machine(axis, number, factor=2.0, draws=50):
    """Machine ``number``: every number of the axis within ``factor`` of the file's, log-uniform, as a `Condition`.

    Torque constant and back-EMF, which are one number of a motor, keep their ratio, and static friction its ratio to
    Coulomb's where that would fall below 1. A machine that swings by itself at 0 V, which friction that falls with
    speed allows, is drawn again. Raises RuntimeError if none of ``draws`` [1] rests.
    """
    generator = np.random.default_rng([int(number), 17])
    for _ in range(draws):
        condition = Condition(f"random machine {number} within {factor:g}", _draw(axis, generator, factor))
        if rests(condition.machine(axis), number):
            return condition
    raise RuntimeError(f"no machine of {draws} rests at 0 V")


def _draw(axis, generator, factor):
    def one():
        return float(np.exp(generator.uniform(-math.log(factor), math.log(factor))))

    factors = {
        key: one() for key in (MASS, STIFFNESS, "transmission.damping", INERTIA, "drive.resistance", "drive.inductance")
    }
    factors |= dict.fromkeys(MOTOR, one())
    for contact in ("actuator", "guideway"):
        for name in ("stiffness", "static", "coulomb", "stribeck_velocity", "attraction", "viscous"):
            key = f"contacts.{contact}.{name}"
            if axis.has(key):
                factors[key] = one()
    static, coulomb = "contacts.actuator.static", "contacts.actuator.coulomb"
    if coulomb in factors and axis.value(static) * factors[static] < axis.value(coulomb) * factors[coulomb]:
        factors[coulomb] = factors[static]
    return {key: value for key, value in factors.items() if axis.has(key)}


def rests(machine, seed, seconds=1.0, moved=1e-7):
    """Whether the machine comes to rest at 0 V after a push of 0.5 V: less than ``moved`` [m] in the last quarter.

    ``seed`` [1]; ``seconds``: time that is simulated [s].
    """
    rows = round(seconds / machine.value("period"))
    plant, controller = make_plant(machine, NoiseSpec(encoder_m=0.0, voltage_V=0.0)), make_controller("none", machine)
    push, none = np.zeros(rows), np.zeros(rows)
    push[: rows // 20] = 0.5
    trace = np.empty((rows, len(TRACE)))
    run_loop(
        plant,
        new_state(plant, seed, friction=usual_start(plant)),
        new_work(plant),
        new_readings(),
        controller.parameters,
        controller.memory,
        none,
        push,
        none,
        trace,
    )
    return float(np.ptp(trace[-rows // 4 :, TRACE.index("stage_m")])) < moved
