"""Logs of simulated foreign machines, degraded as real ones are: 25–1000 Hz, no sign, no voltage, quantised, few runs.

A case draws a machine, its signals, its healthy spread (run to run, and a reassembly between baseline and now, within
the baseline too or not), and at most two effects with their sizes. All from one seed.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.validation import foreign_machine as machines
from microstage_ros.records.logs.description import description_of
from microstage_ros.records.logs.log import Log

#: effect → (parameters drawn, how); sizes relative to the friction level F unless the name says otherwise.
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
#: Sets of signals: names of what is logged, and whether the effort has its sign.
SIGNALS = {
    "reference position current": (("reference", "position", "current"), True),
    "error |current|": (("reference", "following_error", "current"), False),
    "reference position": (("reference", "position"), True),
    "speed torque": (("velocity", "torque"), True),
    "position current": (("position", "current"), True),
    "position |current|": (("position", "current"), False),
    "position current voltage": (("position", "current", "voltage"), True),
    "reference position voltage": (("reference", "position", "voltage"), True),
}


@dataclasses.dataclass
class Machine:
    """A drawn machine; forces in N, lengths in m."""

    law: str
    controller: str
    profile: str
    values: dict
    low: float
    high: float
    top: float
    sharp: float
    dwell: float

    def vector(self):
        """Parameters in the order of `foreign_machine.run`."""
        names = (
            "m",
            "level",
            "stribeck",
            "vs",
            "viscous",
            "asym",
            "const",
            "spring",
            "middle",
            "half",
            "wave1",
            "wave2",
            "bump",
            "bump_at",
            "bump_width",
            "ripple",
            "order",
            "phase",
            "ripple2",
            "order2",
            "lead",
            "rise",
            "kp",
            "kv",
            "ki",
            "ff",
            "gain",
            "gap",
            "delay",
            "jitter_level",
            "walk",
            "quad",
            "lag",
            "memory",
        )
        return np.array([float(self.values[name]) for name in names])

    def at_top(self):
        """Viscous friction at top speed over coefficient times speed: 1, less with a power law."""
        return (self.top / (10.0 * self.values["vs"])) ** -0.3 if self.law == "power" else 1.0

    def changed(self, **changes):
        """The machine with other values."""
        return dataclasses.replace(self, values={**self.values, **changes})


@dataclasses.dataclass(frozen=True)
class LogCase:
    """One drawn case: the logs, what LOG.yaml says, and the truth.

    ``steps``: per effect the machine before and after it and what it does to the readings. ``degrade``: how the logs
    are spoilt.
    """

    number: int
    truth: tuple
    sizes: dict
    signals: str
    rate: float
    runs: int
    files: int
    reassembled: bool
    machine: object
    baseline: tuple
    now: tuple
    description: object
    effort_factor: float = 1.0
    steps: tuple = ()
    degrade: dict = dataclasses.field(default_factory=dict)


def draw_machine(rng):
    """A machine of a random make."""
    stroke = float(10 ** rng.uniform(np.log10(0.02), np.log10(0.4)))
    lead = float(rng.choice([0.002, 0.005, 0.010, 0.020]))
    top = stroke / rng.uniform(0.8, 4.0)
    sharp = top / rng.uniform(0.1, 0.4)
    level = float(10 ** rng.uniform(0.7, 2.0))
    m = level / sharp * 10 ** rng.uniform(-0.5, 0.5)
    bandwidth = rng.uniform(60.0, 250.0)
    controller = str(rng.choice(machines.CONTROLLERS))
    profile = str(rng.choice(machines.PROFILES, p=[0.45, 0.2, 0.2, 0.15]))
    values = {"m": m, "level": level, "stribeck": rng.uniform(0.0, 0.4), "vs": 0.03 * top, "viscous": level * rng.uniform(0.05, 0.6) / top,
              "asym": rng.normal(0.0, 0.05), "const": level * rng.choice([0.0, 0.0, rng.normal(0.0, 0.3)]), "spring": 0.0,
              "middle": 0.5 * stroke, "half": 0.5 * stroke, "wave1": rng.normal(0.0, 0.05), "wave2": rng.normal(0.0, 0.05), "bump": 0.0,
              "bump_at": 0.5 * stroke, "bump_width": 0.05 * stroke, "ripple": level * rng.uniform(0.0, 0.08), "order": float(rng.choice([1, 2, 4, 7])),
              "phase": rng.uniform(0, 6.28), "ripple2": level * rng.uniform(0.0, 0.04), "order2": 1.0, "lead": lead, "rise": 0.0,
              "kp": bandwidth / 6.0, "kv": m * bandwidth, "ki": bandwidth / 8.0, "ff": rng.uniform(0.7, 1.0), "gain": 1.0, "gap": 0.0,
              "delay": 0.0, "jitter_level": 0.0, "walk": rng.uniform(0.0, 0.03), "quad": 0.0, "lag": 0.0, "memory": 0.0}
    return Machine(
        str(rng.choice(machines.LAWS)), controller, profile, values, 0.0, stroke, top, sharp, rng.uniform(0.2, 1.5)
    )


def reassembled(machine, rng, strength=1.0):
    """The machine taken apart and put together again: levels, pattern, phases a little different."""
    v = machine.values
    s = strength
    return machine.changed(
        level=v["level"] * np.exp(s * rng.normal(0, 0.03)),
        viscous=v["viscous"] * np.exp(s * rng.normal(0, 0.05)),
        asym=v["asym"] + s * rng.normal(0, 0.015),
        wave1=v["wave1"] + s * rng.normal(0, 0.01),
        wave2=v["wave2"] + s * rng.normal(0, 0.01),
        ripple=abs(v["ripple"] * (1 + s * rng.normal(0, 0.15))),
        ripple2=abs(v["ripple2"] * (1 + s * rng.normal(0, 0.15))),
        phase=v["phase"] + (rng.uniform(0, 6.28) if s > 0 else 0.0),
        const=v["const"] + s * v["level"] * rng.normal(0, 0.01),
    )


def with_effect(machine, effect, rng, strength=1.0):
    """(machine with the effect, its size as the diagnosis tells it, extra of the logs)."""
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
        return machine.changed(gain=factor), {"factor": 1.0 / factor}, {}
    if effect == "floor_vibration":
        return machine, {}, {"vibration": k * rng.uniform(3.0, 10.0)}
    if effect == "scale_error":
        relative = sign * k * rng.uniform(0.002, 0.01)
        return machine, {"relative": relative}, {"scale": relative}
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
        return machine, {"offset_V": sign * share}, {"offset": sign * share}
    if effect == "amplifier_deadband":
        return machine, {"half_width_V": share}, {"dead": share}
    if effect == "resistance_rise":
        return machine, {"initial": share}, {"warm": share}
    return machine, {}, {}          # thermal_drift, refractive_index: a loop closed on its own reading shows nothing


def draw_case(number, seed, kind="mixed", effect="", signals="", strength=1.0):
    """`LogCase` number ``number`` of a seed. ``kind``: healthy, one, two or mixed."""
    rng = np.random.default_rng([seed, number])
    machine = draw_machine(rng)
    chosen = kind if kind != "mixed" else str(rng.choice(["healthy", "one", "one", "one", "two"]))
    count = {"healthy": 0, "one": 1, "two": 2}[chosen]
    truth = (effect,) if effect else tuple(rng.choice(EFFECTS, count, replace=False))
    name = signals or str(rng.choice(list(SIGNALS)))
    rate = float(rng.choice([25.0, 50.0, 100.0, 250.0, 500.0, 1000.0]))
    runs, files = int(rng.choice([3, 5, 8, 15])), int(rng.choice([1, 1, 2, 4]))
    apart = bool(rng.uniform() < 0.5)
    degrade = _degrade(rng, machine, name, rate)
    sizes, extra, faulty, steps = {}, {}, reassembled(machine, rng) if apart else machine, []
    for one in truth:
        before = faulty
        faulty, size, more = with_effect(faulty, one, rng, strength)
        steps.append((str(one), before, faulty, more))
        sizes[one] = size
        extra |= more
    cycles = cycles_of(machine)
    baseline = []
    for k in range(files):
        state = reassembled(machine, rng) if apart and k else machine
        baseline.append(log_of(state, max(runs // files, 2), cycles, rng, degrade, {}, f"baseline_{k}"))
    now = [log_of(faulty, int(rng.choice([1, 3, 5])), cycles, rng, degrade, extra, "now")]
    description = description_of({"time": {"column": "t", "unit": "s"}, **{
        q: {"column": q, "unit": {"current": "A", "torque": "N m", "velocity": "m/s", "voltage": "V"}.get(q, "m"), **({} if degrade["signed"] or q != "current" else {"signed": False})}
        for q in SIGNALS[name][0]}, "run": ["run"], "position_at": "load" if degrade["load_side"] else "motor", "lead": {"value": machine.values["lead"], "unit": "m"}}, f"case {number}")
    return LogCase(number, truth, sizes, name, rate, runs, files, apart, machine, tuple(baseline), tuple(now), description,
                   _unit_of_effort(degrade), tuple(steps), degrade)


def _unit_of_effort(degrade):
    """What a newton is in the logged effort: amperes (newton metres) of the scaled force, or volts of resistance."""
    kinds = [name for name in ("torque", "current", "voltage") if name in degrade["names"]]
    return degrade["ohmic"] / degrade["force_of_1_V"] if kinds == ["voltage"] else degrade["gain"]


def cycles_of(machine):
    """Cycles there and back in one run."""
    return 2 if machine.profile != "random" else 3


def _degrade(rng, machine, name, rate):
    """How the logs of a case are spoilt: noise, quantum, constants."""
    level = machine.values["level"]
    return {"names": SIGNALS[name][0], "signed": SIGNALS[name][1], "rate": rate, "gain": 10 ** rng.uniform(-1.5, 0.5) / level,
            "noise": rng.uniform(0.01, 0.08) * level, "quantum": rng.choice([0.0, 0.01, 0.03]) * level,
            "place_noise": machine.high * 10 ** rng.uniform(-5.0, -3.7), "run": rng.uniform(0.003, 0.015), "load_side": bool(rng.uniform() < 0.5),
            "temperature": rng.uniform(0.0, 0.02), "ohmic": rng.uniform(0.4, 1.0), "force_of_1_V": level}


def log_of(machine, runs, cycles, rng, degrade, extra, source, programme=None):
    """One `Log` of several runs. ``programme``: generator of random targets, where they are not to come from
    ``rng``."""
    parts = []
    step = max(int(round(1.0 / degrade["rate"] / machines.DT)), 1)
    for run in range(runs):
        warm = machine.changed(
            jitter_level=rng.normal(0, degrade["run"]),
            viscous=machine.values["viscous"] * (1 + rng.normal(0, degrade["temperature"])),
        )
        reference = machines.reference_of(warm.profile, warm.low, warm.high, warm.top, warm.sharp, warm.dwell, cycles, programme or rng)
        out = machines.run(reference, machines.DT, warm.vector(), machines.LAWS.index(warm.law), machines.CONTROLLERS.index(warm.controller),
                           int(rng.integers(2**31)))
        rows = np.arange(int(rng.integers(step)), len(reference), step)
        window = max(step // 2, 1)
        effort = np.convolve(out[:, 2], np.ones(window) / window, mode="same")[rows]
        effort = effort + rng.normal(0, degrade["noise"], len(rows))
        place = out[rows, 3] if degrade["load_side"] else out[rows, 0]
        place = _read(place, out, reference, rows, machine, degrade, extra, rng)
        place = place + rng.normal(0, degrade["place_noise"], len(rows))
        if degrade["quantum"]:
            effort = np.round(effort / degrade["quantum"]) * degrade["quantum"]
        parts.append((rows * machines.DT, reference[rows], place, out[rows, 1] + rng.normal(0, 0.005 * machine.top, len(rows)), effort * degrade["gain"],
                      np.full(len(rows), run), effort))
    time, reference, place, speed, effort, run, force = (np.concatenate(c) for c in zip(*parts))
    every = {"reference": reference, "position": place, "following_error": reference - place, "velocity": speed,
             "current": effort if degrade["signed"] else np.abs(effort), "torque": effort, "voltage": _voltage(machine, force, speed, degrade, extra, rng)}
    if "voltage" in degrade["names"]:
        # behind the amplifier: what flows, not what was asked for
        every["current"] = effort * machine.values["gain"]
    signals = {name: every[name] for name in degrade["names"]}
    if "following_error" in signals and "position" not in signals:
        signals["position"] = signals["reference"] - signals["following_error"]
    if {"reference", "position"} <= set(signals) and "following_error" not in signals:
        signals["following_error"] = signals["reference"] - signals["position"]
    kind = next((n for n in ("torque", "current", "voltage") if n in signals), "")
    return Log(source, time, signals, run.copy(), run, np.zeros(len(time), int), [(float(r),) for r in range(runs)], [()], None, "m", kind,
               {"torque": "N m", "current": "A", "voltage": "V"}.get(kind, ""), degrade["signed"], {"lead": machine.values["lead"]}, [], step * machines.DT)


def _read(place, out, reference, rows, machine, degrade, extra, rng):
    """The position as the log has it at ``rows``: with what lies between motor and stage, and with errors of the
    reading."""
    values = machine.values
    if "vibration" in extra:
        place = place + extra["vibration"] * degrade["place_noise"] * np.sin(2 * np.pi * 0.31 * degrade["rate"] * rows * machines.DT)
    if "scale" in extra:
        place = place + extra["scale"] * (place - values["middle"])
    if "jitter" in extra:
        late = np.random.default_rng([len(rows), int(rows[0])]).normal(0, extra["jitter"] / degrade["rate"], len(rows))
        place = place + late * out[rows, 1]
    if "sde" in extra:
        place = place + extra["sde"] * np.sin(2 * np.pi * place / 20e-6)
    if not degrade["load_side"]:
        return place
    if "softness" in extra:
        place = place - extra["softness"] * out[rows, 2]
    if "pitch" in extra:
        place = place + extra["pitch"] * np.sin(2 * np.pi * place / values["lead"] + extra["pitch_phase"])
    if "creep" in extra:
        moving = np.abs(np.gradient(reference, machines.DT)) > 1e-3 * machine.top
        index = np.arange(len(reference))
        last = np.maximum.accumulate(np.where(moving, index, 0))
        way = np.sign(reference[last] - reference[np.maximum(last - 20, 0)])
        place = place + (extra["creep"] * way * np.log1p((index - last) * machines.DT / 0.05))[rows]
    return place


def _voltage(machine, force, speed, degrade, extra, rng):
    """Voltage of the amplifier behind a force of the motor: 1 V of resistance and of back-EMF together at the friction
    level and top speed.

    u = (R i + K v) / gain + offset + dead zone sgn i, the force loop being faster than the log; one volt is the usual
    level.
    """
    ohmic = degrade["ohmic"] * force / degrade["force_of_1_V"] * machine.values["gain"]
    induced = (1.0 - degrade["ohmic"]) * speed / machine.top
    out = (ohmic * (1.0 + extra.get("warm", 0.0)) + induced) / machine.values["gain"] + extra.get("offset", 0.0) + extra.get("dead", 0.0) * np.sign(ohmic)
    return out + rng.normal(0, 0.003, len(force))
