"""Logs of simulated foreign machines, degraded as real ones are: 25–1000 Hz, no sign, no voltage, quantised, few runs.

A case draws a machine, its signals, its healthy spread (run to run, and a reassembly between baseline and now, within
the baseline too or not), and at most two effects with their sizes. All from one seed.
"""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.validation import foreign_machine as machines
from microstage_ros.diagnosis.validation.foreign_effects import EFFECTS, with_effect
from microstage_ros.records.logs.description import description_of
from microstage_ros.records.logs.log import Log

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
#: Units of what is logged and is no length.
UNITS = {"current": "A", "torque": "N m", "velocity": "m/s", "voltage": "V"}


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
        """Parameters in the order of `foreign_machine.run`, shape (n,)."""
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
    values = {"m": m, "level": level, "stribeck": rng.uniform(0.0, 0.4), "vs": 0.03 * top,
              "viscous": level * rng.uniform(0.05, 0.6) / top, "asym": rng.normal(0.0, 0.05),
              "const": level * rng.choice([0.0, 0.0, rng.normal(0.0, 0.3)]), "spring": 0.0, "middle": 0.5 * stroke,
              "half": 0.5 * stroke, "wave1": rng.normal(0.0, 0.05), "wave2": rng.normal(0.0, 0.05), "bump": 0.0,
              "bump_at": 0.5 * stroke, "bump_width": 0.05 * stroke, "ripple": level * rng.uniform(0.0, 0.08),
              "order": float(rng.choice([1, 2, 4, 7])), "phase": rng.uniform(0, 6.28),
              "ripple2": level * rng.uniform(0.0, 0.04), "order2": 1.0, "lead": lead, "rise": 0.0,
              "kp": bandwidth / 6.0, "kv": m * bandwidth, "ki": bandwidth / 8.0, "ff": rng.uniform(0.7, 1.0),
              "gain": 1.0, "gap": 0.0, "delay": 0.0, "jitter_level": 0.0, "walk": rng.uniform(0.0, 0.03),
              "quad": 0.0, "lag": 0.0, "memory": 0.0}
    return Machine(
        str(rng.choice(machines.LAWS)), controller, profile, values, 0.0, stroke, top, sharp, rng.uniform(0.2, 1.5)
    )


def reassembled(machine, rng, strength=1.0):
    """The machine taken apart and put together again: levels, pattern, phases a little different, by ``strength``
    [1]."""
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


def draw_case(number, seed, kind="mixed", effect="", signals="", strength=1.0):
    """`LogCase` number ``number`` [1] of a ``seed`` [1], effects ``strength`` [1] times the usual. ``kind``: healthy,
    one, two or mixed."""
    rng = np.random.default_rng([seed, number])
    machine = draw_machine(rng)
    chosen = kind if kind != "mixed" else str(rng.choice(["healthy", "one", "one", "one", "two"]))
    count = {"healthy": 0, "one": 1, "two": 2}[chosen]
    truth = (effect,) if effect else tuple(rng.choice(EFFECTS, count, replace=False))
    name = signals or str(rng.choice(list(SIGNALS)))
    rate = float(rng.choice([25.0, 50.0, 100.0, 250.0, 500.0, 1000.0]))
    runs, files = int(rng.choice([3, 5, 8, 15])), int(rng.choice([1, 1, 2, 4]))
    assembled_anew = bool(rng.uniform() < 0.5)
    degrade = _degrade(rng, machine, name, rate)
    sizes, extra, faulty, steps = {}, {}, reassembled(machine, rng) if assembled_anew else machine, []
    for one in truth:
        before = faulty
        faulty, size, more = with_effect(faulty, one, rng, strength)
        steps.append((str(one), before, faulty, more))
        sizes[one] = size
        extra |= more
    cycles = cycles_of(machine)
    baseline = []
    for k in range(files):
        state = reassembled(machine, rng) if assembled_anew and k else machine
        baseline.append(log_of(state, max(runs // files, 2), cycles, rng, degrade, {}, f"baseline_{k}"))
    now = [log_of(faulty, int(rng.choice([1, 3, 5])), cycles, rng, degrade, extra, "now")]
    return LogCase(number, truth, sizes, name, rate, runs, files, assembled_anew, machine, tuple(baseline), tuple(now),
                   _description(number, machine, degrade), _unit_of_effort(degrade), tuple(steps), degrade)


def _description(number, machine, degrade):
    """The description that an operator would write for these logs."""
    signals = {name: {"column": name, "unit": UNITS.get(name, "m")} for name in degrade["names"]}
    if "current" in signals and not degrade["signed"]:
        signals["current"]["signed"] = False
    return description_of(
        {"time": {"column": "t", "unit": "s"}, **signals, "run": ["run"],
         "position_at": "load" if degrade["load_side"] else "motor",
         "lead": {"value": machine.values["lead"], "unit": "m"}}, f"case {number}")


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
    return {"names": SIGNALS[name][0], "signed": SIGNALS[name][1], "rate": rate,
            "gain": 10 ** rng.uniform(-1.5, 0.5) / level,
            "noise": rng.uniform(0.01, 0.08) * level, "quantum": rng.choice([0.0, 0.01, 0.03]) * level,
            "place_noise": machine.high * 10 ** rng.uniform(-5.0, -3.7), "run": rng.uniform(0.003, 0.015),
            "load_side": bool(rng.uniform() < 0.5), "temperature": rng.uniform(0.0, 0.02),
            "ohmic": rng.uniform(0.4, 1.0), "force_of_1_V": level}


def log_of(machine, runs, cycles, rng, degrade, extra, source, programme=None):
    """One `Log` of several ``runs`` [1], each of ``cycles`` [1]. ``programme``: generator of random targets, where
    they are not to come from ``rng``."""
    parts = []
    step = max(int(round(1.0 / degrade["rate"] / machines.DT)), 1)
    for number in range(runs):
        warm = machine.changed(
            jitter_level=rng.normal(0, degrade["run"]),
            viscous=machine.values["viscous"] * (1 + rng.normal(0, degrade["temperature"])),
        )
        reference = machines.reference_of(warm.profile, warm.low, warm.high, warm.top, warm.sharp, warm.dwell, cycles,
                                          programme or rng)
        out = machines.run(reference, machines.DT, warm.vector(), machines.LAWS.index(warm.law),
                           machines.CONTROLLERS.index(warm.controller), int(rng.integers(2**31)))
        rows = np.arange(int(rng.integers(step)), len(reference), step)
        window = max(step // 2, 1)
        effort = np.convolve(out[:, 2], np.ones(window) / window, mode="same")[rows]
        effort = effort + rng.normal(0, degrade["noise"], len(rows))
        place = out[rows, 3] if degrade["load_side"] else out[rows, 0]
        place = _read(place, out, reference, rows, machine, degrade, extra, rng)
        place = place + rng.normal(0, degrade["place_noise"], len(rows))
        if degrade["quantum"]:
            effort = np.round(effort / degrade["quantum"]) * degrade["quantum"]
        speed = out[rows, 1] + rng.normal(0, 0.005 * machine.top, len(rows))
        parts.append((rows * machines.DT, reference[rows], place, speed, effort * degrade["gain"],
                      np.full(len(rows), number), effort))
    time, reference, place, speed, effort, run, force = (np.concatenate(c) for c in zip(*parts))
    every = {"reference": reference, "position": place, "following_error": reference - place, "velocity": speed,
             "current": effort if degrade["signed"] else np.abs(effort), "torque": effort,
             "voltage": _voltage(machine, force, speed, degrade, extra, rng)}
    if "voltage" in degrade["names"]:
        # behind the amplifier: what flows, not what was asked for
        every["current"] = effort * machine.values["gain"]
    signals = {name: every[name] for name in degrade["names"]}
    if "following_error" in signals and "position" not in signals:
        signals["position"] = signals["reference"] - signals["following_error"]
    if {"reference", "position"} <= set(signals) and "following_error" not in signals:
        signals["following_error"] = signals["reference"] - signals["position"]
    kind = next((n for n in ("torque", "current", "voltage") if n in signals), "")
    return Log(source, time, signals, run.copy(), run, np.zeros(len(time), int), [(float(r),) for r in range(runs)],
               [()], None, "m", kind, UNITS.get(kind, ""), degrade["signed"], {"lead": machine.values["lead"]}, [],
               step * machines.DT)


def _read(place, out, reference, rows, machine, degrade, extra, rng):
    """The position as the log has it at ``rows``: with what lies between motor and stage, and with errors of the
    reading."""
    values = machine.values
    if "vibration" in extra:
        wave = np.sin(2 * np.pi * 0.31 * degrade["rate"] * rows * machines.DT)
        place = place + extra["vibration"] * degrade["place_noise"] * wave
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
    out = (ohmic * (1.0 + extra.get("warm", 0.0)) + induced) / machine.values["gain"]
    out = out + extra.get("offset", 0.0) + extra.get("dead", 0.0) * np.sign(ohmic)
    return out + rng.normal(0, 0.003, len(force))
