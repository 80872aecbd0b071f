"""Effects put into a simulated foreign machine, each of a random size that real machines have.

What they do to the machine's equations: `foreign_machine`; to what is read from it: `simulated_logs`.
"""

#: Effects that may be drawn.
EFFECTS = (
    "friction_level_change",
    "viscous_change",
    "direction_asymmetry",
    "gravity_tilt",
    "cable_spring",
    "position_dependent_friction",
    "torque_ripple",
    "payload_change",
    "rising_static_friction",
    "backlash",
    "transport_delay",
    "floor_vibration",
    "amplifier_gain",
    "scale_error",
    "nonlinear_viscous",
    "drive_compliance",
    "screw_pitch_error",
    "actuator_lag",
    "presliding_creep",
    "sampling_jitter",
    "amplifier_offset",
    "amplifier_deadband",
    "resistance_rise",
    "frictional_lag",
    "encoder_sde",
    "thermal_drift",
    "refractive_index",
)


def with_effect(machine, effect, rng, strength=1.0):
    """(machine with the effect, its size in the diagnosis' terms, extra of the logs); ``strength``: times the usual
    [1]."""
    v, k = machine.values, strength
    level, sign = v["level"], float(rng.choice([-1.0, 1.0]))
    if effect == "friction_level_change":
        factor = 1.0 + k * rng.uniform(0.25, 0.9) if sign > 0 else 1.0 / (1.0 + k * rng.uniform(0.3, 0.9))
        return machine.changed(level=level * factor, viscous=v["viscous"] * factor), {"factor": factor}, {}
    if effect == "viscous_change":
        more = k * rng.uniform(0.4, 1.0) * level / machine.top
        return machine.changed(viscous=v["viscous"] + more), {"coefficient_change": more * machine.at_top()}, {}
    if effect == "nonlinear_viscous":
        more = k * rng.uniform(0.5, 1.2) * level / machine.top**2
        return machine.changed(quad=more), {"coefficient": more}, {}
    if effect == "direction_asymmetry":
        asym = sign * k * rng.uniform(0.2, 0.45)
        return machine.changed(asym=v["asym"] + asym), {"asymmetry": asym}, {}
    if effect == "gravity_tilt":
        force = sign * k * rng.uniform(0.25, 0.7) * level
        return machine.changed(const=v["const"] + force), {"force": force}, {}
    if effect == "cable_spring":
        stiffness = k * rng.uniform(0.25, 0.7) * level / v["half"]
        return machine.changed(spring=stiffness), {"stiffness": stiffness}, {}
    if effect == "position_dependent_friction":
        if rng.uniform() < 0.5:
            return machine.changed(wave1=v["wave1"] + sign * k * rng.uniform(0.2, 0.5)), {}, {}
        return machine.changed(bump=k * rng.uniform(0.3, 0.8), bump_at=rng.uniform(0.3, 0.7) * machine.high), {}, {}
    if effect == "torque_ripple":
        return machine.changed(ripple=v["ripple"] + k * rng.uniform(0.15, 0.5) * level), {}, {}
    if effect == "payload_change":
        factor = 1.0 + k * rng.uniform(0.4, 1.2)
        return machine.changed(m=v["m"] * factor), {"inertia_factor": factor}, {}
    if effect == "rising_static_friction":
        return machine.changed(rise=v["rise"] + k * rng.uniform(0.3, 0.8)), {}, {}
    if effect == "backlash":
        width = k * rng.uniform(0.002, 0.01) * machine.high
        return machine.changed(gap=width), {"width_m": width}, {}
    if effect == "transport_delay":
        delay = k * rng.uniform(0.004, 0.02)
        return machine.changed(delay=delay), {"delay_s": delay}, {}
    if effect == "amplifier_gain":
        factor = 1.0 / (1.0 + k * rng.uniform(0.25, 0.6))
        return machine.changed(gain=factor), {"factor": factor}, {}
    if effect == "floor_vibration":
        return machine, {}, {"vibration": k * rng.uniform(3.0, 10.0)}
    if effect == "scale_error":
        relative = sign * k * rng.uniform(0.002, 0.01)
        return machine, {"relative": -relative}, {"scale": relative}  # by which the reading is too long
    return _in_the_loop(machine, effect, rng, k) or _in_the_readings(machine, effect, rng, k, sign)


def _in_the_loop(machine, effect, rng, k):
    """Effects that only some loops and samplings show."""
    if effect == "actuator_lag":
        return machine.changed(lag=k * rng.uniform(0.15, 0.5) * machine.values["m"] / machine.values["kv"]), {}, {}
    if effect == "frictional_lag":
        return machine.changed(memory=k * rng.uniform(0.01, 0.05)), {}, {}
    return None


def _in_the_readings(machine, effect, rng, k, sign):
    """Effects behind the motor's encoder, in the amplifier behind its force loop, and in what is read and when."""
    size = k * rng.uniform(0.0005, 0.003) * machine.high
    if effect == "drive_compliance":
        return machine, {}, {"softness": k * rng.uniform(0.001, 0.005) * machine.high / machine.values["level"]}
    if effect == "screw_pitch_error":
        return machine, {"amplitude_m": size}, {"pitch": size, "pitch_phase": rng.uniform(0.0, 6.28)}
    if effect == "presliding_creep":
        return machine, {"amplitude_m": size}, {"creep": size}
    if effect == "sampling_jitter":
        return machine, {}, {"jitter": k * rng.uniform(0.1, 0.4)}
    if effect == "encoder_sde":
        return machine, {}, {"sde": k * rng.uniform(0.05e-6, 0.3e-6)}
    share = k * rng.uniform(0.1, 0.4)
    if effect == "amplifier_offset":
        return machine, {"offset_V": -sign * share}, {"offset": sign * share}  # of what is asked for
    if effect == "amplifier_deadband":
        return machine, {"half_width_V": share}, {"dead": share}
    if effect == "resistance_rise":
        return machine, {"initial": share}, {"warm": share}
    return machine, {}, {}          # thermal_drift, refractive_index: a loop closed on its own reading shows nothing
