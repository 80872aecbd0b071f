"""The watch examined on simulated axes: false alarms on healthy ones, and how soon an effect that sets in is noticed.

Each axis is simulated with its own seed through programmes of scans, moves and sines
(`diagnosis.validation.simulated_records`), under fixed controllers that the watch is not given. It learns
from its first windows; then either nothing changes, or an effect is there from one window on.
"""

import dataclasses

from microstage_ros.diagnosis.validation.simulated_records import Hidden, make_case
from microstage_ros.metrology.rates import rate
from microstage_ros.monitoring.health import Reference, Watch
from microstage_ros.monitoring.traits import Machine
from microstage_ros.monitoring.windows import windows_of

EFFECTS = {
    "friction_level_change": {"factor": 1.25},
    "viscous_change": {"factor": 1.5},
    "gravity_tilt": {"angle_rad": 0.05},
    "amplifier_gain": {"factor": 1.03},
    "payload_change": {"mass_kg": 2.0},
}
"""What sets in, each of a size that matters to the machine's work."""
EXAMINED_WINDOW = 5.0  # s: the programmes are some 28 s long, and one window should not hold all of them


@dataclasses.dataclass(frozen=True)
class Outcome:
    """One axis: what set in (empty: nothing), windows judged, windows to the alarm (None: none), its trait."""

    effect: str
    windows: int
    delay: int
    trait: str


def windows_of_axis(machine, axis, seed, count, window_s, hidden=None):
    """Traits of ``count`` [1] windows of one simulated axis, healthy or with an effect; ``seed`` [1].

    ``hidden``: the effect as a `Hidden`; None: healthy.
    """
    found, number = [], 0
    while len(found) < count:
        learn, _, base = make_case(axis, hidden or Hidden("healthy"), int(seed) * 1000 + number)
        for record in learn if hidden else base:
            found += [machine.traits(window) for _, window in windows_of(record, window_s)]
        number += 1
    return found[:count]


def examine(axis, effect, seed, healthy=20, judged=20, window_s=EXAMINED_WINDOW, per_month=1.0):
    """`Outcome` of one axis: ``healthy`` windows [1] to learn from, ``judged`` windows [1]; ``seed`` [1].

    ``per_month``: false alarms that are allowed in a month of motion [1].
    """
    machine = Machine(axis)
    watch = Watch(Reference.of(windows_of_axis(machine, axis, 2 * seed, healthy, window_s), window_s), per_month)
    hidden = Hidden(effect, (effect,), {effect: EFFECTS[effect]}) if effect else None
    for number, traits in enumerate(windows_of_axis(machine, axis, 2 * seed + 1, judged, window_s, hidden)):
        health = watch.judge(number * window_s, traits)
        alarmed = [h for h in health.values() if h.alarm]
        if alarmed:
            return Outcome(effect, judged, number + 1, max(alarmed, key=lambda h: h.score).trait)
    return Outcome(effect, judged, None, "")


def table(outcomes):
    """{effect or "healthy": {"noticed": `Rate`, "windows": median delay or None}} of a list of `Outcome`."""
    rows = {}
    for effect in sorted({o.effect for o in outcomes}):
        own = [o for o in outcomes if o.effect == effect]
        delays = sorted(o.delay for o in own if o.delay is not None)
        rows[effect or "healthy"] = {
            "noticed": rate(len(delays), len(own)),
            "windows": delays[len(delays) // 2] if delays else None,
        }
    return rows
