"""From an axis file to the records of the compiled step."""

import math
from dataclasses import asdict, dataclass

import numpy as np

from microstage_ros.model.actuators import ACTUATORS, actuator_of
from microstage_ros.model.effects import apply_effects, check_effects
from microstage_ros.model.friction.contact import OTHER_LAWS, RIGID_LAWS, blocks_of, law_values
from microstage_ros.model.friction.registry import law_named
from microstage_ros.model.plant_record import PLANT, READINGS, STATE
from microstage_ros.model.sensors import position_sensor_of
from microstage_ros.model.sensors.current import current_filter
from microstage_ros.numerics.random import seed_state
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.contact import NO_TABLE, regroup, slide, sliding_table
from microstage_ros.solver.event_step import lead_error
from microstage_ros.solver.linear_core import forget, new_work  # noqa: F401  (callers make all records here)
from microstage_ros.solver.variability import TIME_STEP, TRAVEL_STEP

LAW_LEVEL = 4                  # chunks of T/16 for laws that are not made of blocks
#: Fields of a plant by which an effect acts on the readings.
SENSING = ("late", "jitter", "lost", "sde_amplitude", "scale", "drift_amplitude", "drift_rate", "drift_expansion",
           "air_temperature_rate",
           "air_pressure_rate", "air_temperature_swing", "air_pressure_swing", "lines", "stage_temperature_rise")
BRISTLE = 100.0                # Coulomb contact: natural frequency of its bristle times the control period


@dataclass(frozen=True)
class NoiseSpec:
    """Standard deviations of a run's noise; 0 turns one off. Names as in run files.

    None takes the axis file's own figure: ``sensors.encoder.noise``, ``drive.noise``, ``sensors.current.noise``,
    ``sensors.interferometer.noise``, ``variability.relative``.
    """

    encoder_m: float | None = None
    voltage_V: float | None = None
    current_A: float | None = None
    interferometer_m: float | None = None
    friction_relative: float | None = None

    @classmethod
    def none(cls):
        """No noise and no random friction."""
        return cls(0.0, 0.0, 0.0, 0.0, 0.0)

    def as_dict(self):
        """Plain numbers, for result files."""
        return asdict(self)


def make_plant(axis, noise=None, effects=None):
    """The machine as one record (`records.PLANT`): parameters, noise and effects (axis file's and the run's).

    ``noise``: `NoiseSpec`, default the axis's own figures. ``effects``: {id: parameters}; an id given in both
    places is taken from ``effects``. Raises InputError.
    """
    noise = noise or NoiseSpec()
    plant = np.zeros(1, PLANT)[0]
    plant["period"] = axis.value("period")
    _fill_transmission(plant, axis)
    _fill_drive(plant, axis)
    plant["mass"], plant["push"] = axis.value("stage.mass"), -axis.value("stage.offset_force")
    for name, inertia in (("actuator", _screw_inertia(plant)), ("guideway", _moving_mass(plant))):
        _fill_contact(plant[name], axis, name, inertia, float(plant["period"]))
        if plant[name]["law"]:
            plant["base_level"] = LAW_LEVEL
    _fill_noise(plant, axis, noise)
    _fill_sensors(plant, axis)
    plant["air_compensated"], plant["air_swing_time"], plant["drift_time"] = 1, 1.0, 1.0
    plant["rise_time"], plant["stage_temperature_time"] = 1.0, 1.0
    merged = {**axis.effects, **check_effects(effects or {})}
    apply_effects(plant, merged)
    _set_flags(plant)
    if plant["delay"] > 60 * plant["period"]:
        raise InputError("effects: transport_delay.delay_s", float(plant["delay"]),
                         f"at most 60 periods ({60 * plant['period']:g} s)")
    return plant


def new_state(plant, seed=0, position=0.0, friction="virgin", speed=0.0):
    """State at ``position`` [m], at rest or moving with ``speed`` [m/s], all friction sliding.

    ``seed``: of the noise [1], an integer >= 0.
    ``friction``: ``relaxed`` (or ``virgin``, the same), or ``random`` (unknown history); of no account in motion.
    """
    state = np.zeros(1, STATE)[0]
    state["x"], state["theta"] = position, position / plant["ratio"]
    state["random"] = seed_state(seed)
    state["side"] = 0 if plant["gap"] > 0.0 else 1
    state["heat"] = plant["rise_initial"]
    generator = np.random.default_rng([int(seed), 1])
    history = generator.uniform(-1.0, 1.0)
    for name in ("actuator", "guideway"):
        _start_contact(plant, plant[name], state[name], generator, history if friction == "random" else 0.0)
    if plant["leads"] or plant["lead_slope"]:
        for _ in range(20):        # the screw angle whose nut stands at the stage
            state["theta"] = (position - lead_error(plant, float(state["theta"] / plant["gear"]))) / plant["ratio"]
    if plant["gap"] > 0.0 and friction == "random":
        state["theta"] += generator.uniform(-0.5, 0.5) * plant["gap"] / plant["ratio"]
    state["last_encoder"] = position
    ACTUATORS[int(plant["drive"])].start(plant, state)
    if speed != 0.0:
        state["v"], state["omega"] = speed, speed / plant["ratio"]
        slide(plant["actuator"], state["actuator"], state["omega"] / plant["gear"])
        slide(plant["guideway"], state["guideway"], speed)
    return state


def has_random_friction(plant):
    """Whether the limits of one of the contacts vary at random."""
    return bool(plant["actuator"]["random"] > 0.0 or plant["guideway"]["random"] > 0.0)


def usual_start(plant):
    """State of the contacts at the start unless something else is asked for: loaded where the friction is random."""
    return "random" if has_random_friction(plant) else "relaxed"


def new_readings():
    """An empty record of readings."""
    return np.zeros(1, READINGS)[0]


def _set_flags(plant):
    """What the compiled step may leave out."""
    plant["varies"] = int(plant["modulated"] or has_random_friction(plant))
    extra = (
        plant["smooth"]
        or plant["leads"]
        or plant["lead_slope"]
        or plant["cable"]
        or plant["gap"]
        or plant["rigid"]
        or plant["flexure"]
    )
    plant["plain"] = int(not extra)
    plant["random_share_root"], plant["random_rest_root"] = (
        math.sqrt(plant["random_share"]),
        math.sqrt(1.0 - plant["random_share"]),
    )
    plant["rate"] = 1.0 / plant["period"]
    plant["simple"] = int(not plant["electrical"] and not plant["shaped"] and plant["base_level"] == 0)
    plant["sensing"] = int(any(np.any(plant[name]) for name in SENSING))
    plant["per_gear"] = 1.0 / plant["gear"]
    for name in ("quantum", "count"):
        size = plant["quantum" if name == "quantum" else "encoder_count"]
        plant[f"per_{name}"] = 1.0 / size if size else 0.0
    for name in ("actuator", "guideway"):
        contact = plant[name]
        contact["follows"] = int(contact["lag"] > 0.0 or (name == "guideway" and contact["drops"]))
        contact["smooth_slip"] = int(math.isfinite(contact["attraction"]) and contact["lag"] == 0.0)
    a, g = plant["actuator"], plant["guideway"]
    special = a["law"] or g["law"] or a["follows"] or g["follows"] or g["drops"] or not a["smooth_slip"]
    plant["quick"] = int(plant["simple"] and plant["plain"] and not special)


def _fill_transmission(plant, axis):
    gear, pitch = axis.value("transmission.gear_ratio"), axis.value("transmission.pitch")
    plant["gear"], plant["screw_ratio"] = gear, pitch / (2 * math.pi)
    plant["ratio"] = plant["screw_ratio"] / gear
    plant["rigid"] = int(axis.choices["transmission.type"] == "rigid")
    if not plant["rigid"]:
        plant["stiffness"], plant["damping"] = axis.value("transmission.stiffness"), axis.value("transmission.damping")


def _fill_drive(plant, axis):
    actuator = actuator_of(axis)
    actuator.check(axis)
    span, bits = actuator.converter(axis)
    plant["dac_range"], plant["gain"], plant["limit"] = span, 1.0, actuator.command_limit(axis)
    plant["quantum"] = 2.0 * span / 2.0**bits if bits else 0.0
    plant["flexure"], plant["flexure_damping"] = (
        axis.value("stage.flexure_stiffness"),
        axis.value("stage.flexure_damping"),
    )
    plant["drive"], plant["shaped"], plant["pulls"] = (
        actuator.number,
        int(actuator.shape is not None),
        int(actuator.torque is not None),
    )
    plant["smooth"] = plant["pulls"]
    actuator.fill(plant, axis)


def _moving_mass(plant):
    if not plant["rigid"]:
        return float(plant["mass"])
    return float(plant["mass"] + plant["inertia"] / plant["ratio"] ** 2)


def _screw_inertia(plant):
    """Inertia that the actuator's contact torque meets, per unit of screw acceleration."""
    return float(plant["gear"] * (plant["inertia"] + (plant["mass"] * plant["ratio"] ** 2 if plant["rigid"] else 0.0)))


def _fill_contact(contact, axis, name, inertia, period):
    law, key = axis.law(name), f"contacts.{name}"
    contact["level"], contact["attraction"], contact["velocity"], contact["exponent"] = 1.0, math.inf, 1.0, 1.0
    contact["first_cell"] = NO_TABLE
    if law == "none":
        return
    contact["viscous"] = axis.value(f"{key}.viscous")
    if law in OTHER_LAWS:
        _fill_law(contact, law_values(axis, name), law_named(law))
        return
    if law in RIGID_LAWS:
        top = max(axis.value(f"{key}.coulomb"), 1e-12)
        frequency = BRISTLE / period
        contact["blocks"], contact["weight"][0], contact["kappa"][0] = 1, 1.0, inertia * frequency**2
        contact["stick_damping"] = 2.0 * inertia * frequency
        contact["static"] = contact["coulomb"] = top
    else:
        k, alpha = blocks_of(axis, name)
        contact["blocks"] = len(k)
        contact["weight"][: len(k)], contact["kappa"][: len(k)] = alpha, k / alpha
        contact["static"] = contact["coulomb"] = axis.value(f"{key}.static")
    if axis.has(f"{key}.stribeck_velocity"):
        contact["drops"], contact["static"] = 1, axis.value(f"{key}.static")
        for field, leaf in (("coulomb", "coulomb"), ("velocity", "stribeck_velocity"),
                            ("exponent", "stribeck_exponent")):
            contact[field] = axis.value(f"{key}.{leaf}")
        contact["first_cell"], contact["sliding"] = sliding_table(*(float(contact[k])
                                                                    for k in ("static", "coulomb", "velocity",
                                                                              "exponent")))
    if axis.has(f"{key}.attraction"):
        contact["attraction"] = axis.value(f"{key}.attraction")


def _fill_law(contact, values, law):
    """A law of the library that is not made of blocks; its viscous part goes to the linear core."""
    packed = law.pack({**values, "viscous": 0.0})
    contact["law"], contact["law_parameters"][: len(packed)] = law.number + 1, packed
    contact["static"] = contact["coulomb"] = values["static"]


def _fill_noise(plant, axis, noise):
    relative = axis.value("variability.relative") if noise.friction_relative is None else noise.friction_relative
    for name in ("actuator", "guideway"):
        plant[name]["random"] = relative if plant[name]["blocks"] or plant[name]["law"] else 0.0
    for field in ("length", "time"):
        plant[f"random_{field}"] = axis.value("variability.travel_length" if field == "length"
                                              else "variability.time_length")
    plant["random_travel_step"] = TRAVEL_STEP * plant["random_length"]
    plant["random_time_step"] = TIME_STEP * plant["random_time"]
    plant["random_share"], plant["random_clip"] = axis.value("variability.travel_share"), axis.value("variability.clip")
    for field, key, given in (("encoder_noise", "sensors.encoder.noise", noise.encoder_m),
                              ("current_noise", "sensors.current.noise", noise.current_A),
                              ("amplifier_noise", "drive.noise", actuator_of(axis).given_noise(noise.voltage_V)),
                              ("interferometer_noise", "sensors.interferometer.noise", noise.interferometer_m)):
        plant[field] = axis.value(key) if given is None else given
    plant["amplifier_noise"] *= plant["gain"]
    plant["encoder_count"] = axis.value("sensors.encoder.resolution")


def _fill_sensors(plant, axis):
    """What encoder and current sensor do beyond noise and counts."""
    error = np.array(axis.value("sensors.encoder.interpolation_error"))
    if len(error) > 2:
        raise InputError(f"{axis.place}: sensors.encoder.interpolation_error", len(error), "at most two amplitudes")
    plant["interpolation"][: len(error)], plant["interpolates"] = error, int(np.any(error))
    plant["signals_per_metre"] = 1.0 / axis.value("sensors.encoder.signal_period")
    plant["signal_number"] = 2 * math.pi / axis.value("sensors.encoder.signal_period")
    sensor = position_sensor_of(axis)
    plant["position_sensor"] = sensor.number
    sensor.fill(plant, axis)
    if not actuator_of(axis).measures_current:
        if actuator_of(axis).holds_position:     # its first-order state is no current: the reading is NaN
            plant["senses_current"], plant["current_offset"] = 1, math.nan
        return
    offset, span, bits, bandwidth, skew = (
        axis.value(f"sensors.current.{key}") for key in ("offset", "range", "bits", "bandwidth", "skew"))
    if bits and not span:
        raise InputError(f"{axis.place}: sensors.current.range", span,
                         "the converter's range in A, where bits are given")
    if not skew < plant["period"]:
        raise InputError(f"{axis.place}: sensors.current.skew", skew,
                         f"less than a period ({float(plant['period']):g} s)")
    plant["current_offset"], plant["current_range"] = offset, span
    plant["current_quantum"] = 2.0 * span / 2.0**bits if bits else 0.0
    plant["per_current_quantum"] = 1.0 / plant["current_quantum"] if bits else 0.0
    period, settling = float(plant["period"]), float(plant["inductance"] / plant["resistance"])
    plant["current_filter"] = current_filter(period, period, settling, bandwidth)
    plant["current_sample"] = current_filter(period - skew, period, settling, bandwidth)
    plant["senses_current"] = int(bandwidth > 0.0 or skew > 0.0 or offset != 0.0)


def _start_contact(plant, contact, c, generator, history):
    n = int(contact["blocks"])
    c["stuck"][:n], c["slip_offset"] = 1.0, 1.0
    if contact["random"] > 0.0:
        share = float(plant["random_share"])
        c["q_travel"] = contact["random"] * math.sqrt(share) * generator.standard_normal()
        c["q_time"] = contact["random"] * math.sqrt(1.0 - share) * generator.standard_normal()
        c["q"] = np.clip(c["q_travel"] + c["q_time"], -plant["random_clip"], plant["random_clip"])
    c["factor"] = contact["level"] * (1.0 + c["q"])
    if n and history:
        top = float(c["factor"] * min(contact["static"], contact["coulomb"]))
        reach = 0.6 * top / float(contact["kappa"][:n].min()) * history
        c["force"][:n] = np.clip(contact["kappa"][:n] * reach, -0.95 * top, 0.95 * top)
    regroup(contact, c)
