"""Whether the signals of a simulated machine carry an effect at all, judged without the method that is examined.

The change that an effect makes to the logged signals is the difference of two simulations with the same random numbers,
with and without it. It is compared with the scatter of healthy logs of the same programme: other runs, and other states
of assembly where the case has them, or where its baseline is a single log, which cannot tell. Both are reduced to parts
of the run's time: mean, range, and the logarithm of the roughness of each signal there.
"""

import numpy as np
from scipy.stats import norm

from microstage_ros.diagnosis.validation import simulated_logs

PARTS = 24                 # of the run's time
HEALTHY = 8                # healthy logs that tell the scatter
FALSE_ALARMS = 1.0 / 60.0  # that are asked of the method on a healthy machine, over all effects
MISSED = 0.15              # that are allowed of the method among effects that can show
LEFT = 0.02                # of the travel
SIGNALS = ("following_error", "velocity", "current", "torque", "voltage")
SMOOTHEST = 1e-3           # of a signal's deviation: roughness below it is none
#: Detectability limit in standard deviations of the scatter: capability of detection by ISO 11843-1 at these two rates.
LIMIT = float(norm.isf(0.5 * FALSE_ALARMS / len(simulated_logs.EFFECTS)) + norm.isf(MISSED))


def distance(case, number):
    """Largest change [1] by effect ``number`` of a `LogCase` over signals and parts of the run, in standard deviations
    of the healthy scatter."""
    _, before, after, extra = case.steps[number]
    runs = len(case.now[0].runs)

    def reduced(machine, stream, extra):
        rng = np.random.default_rng([case.number, stream])
        cycles, programme = simulated_logs.cycles_of(machine), np.random.default_rng(case.number)
        log = simulated_logs.log_of(machine, runs, cycles, rng, case.degrade, extra, "", programme)
        return features(log)

    assembled_anew = case.reassembled or case.files == 1        # one log cannot tell that nothing was taken apart since
    change = reduced(after, 0, extra) - reduced(before, 0, {})
    healthy = []
    for k in range(HEALTHY):
        anew = np.random.default_rng([case.number, 100 + k])
        state = simulated_logs.reassembled(before, anew) if assembled_anew else before
        healthy.append(reduced(state, 1 + k, {}))
    variance = np.var(healthy, axis=0, ddof=1)
    # eight logs tell a variance to a half: the other parts of the run help
    variance = 0.5 * (variance + variance.mean(axis=-1, keepdims=True))
    return float(np.max(np.abs(change) / np.sqrt(variance * (1.0 + 1.0 / case.files) + 1e-300), initial=0.0))


def features(log):
    """Mean, range [unit of the signal] and log roughness [1] of each signal in each part of the run, mean over runs:
    (signals × 3, PARTS).

    Where no set point is logged, nobody knows which motion was asked for: then a run counts from its first motion, and
    of position and speed only the roughness tells.
    """
    rows = []
    asked = "following_error" in log.signals
    signals = {name: log.signals[name] for name in SIGNALS if name in log.signals}
    if not asked and "position" in log.signals:
        signals["position"] = log.signals["position"]
    edge = np.linspace(0.0, 1.0, PARTS + 1)
    for name, values in signals.items():
        parts, least = [], SMOOTHEST * float(np.std(values))
        level_counts = asked or name not in ("velocity", "position")
        for run in np.unique(log.run):
            own = np.flatnonzero(log.run == run)
            own = own[0 if asked else _first_motion(log, own):]
            time = log.time[own]
            share = (time - time[0]) / max(time[-1] - time[0], 1e-300)
            pieces = np.split(values[own], np.searchsorted(share, edge[1:-1]))
            rough = [0.5 * np.log(np.mean(np.diff(p, 2) ** 2) + least**2) if len(p) > 4 else 0.0 for p in pieces]
            level = [(p.mean(), np.ptp(p)) if len(p) and level_counts else (0.0, 0.0) for p in pieces]
            parts.append([[m for m, _ in level], [r for _, r in level], rough])
        rows.extend(np.mean(parts, axis=0))
    return np.array(rows)


def _first_motion(log, own):
    """Row, counted from the run's first, at which the axis has left its place by `LEFT` of the run's travel."""
    x = log.signals["position"][own] if "position" in log.signals else np.cumsum(log.signals["velocity"][own])
    return int(np.argmax(np.abs(x - x[0]) > LEFT * np.ptp(x)))
