"""Iterative learning and repetitive control: what a fixed law can gain where a motion repeats.

A voltage is added along the program and learned from the error of the encoder in the trial before,

    u <- Q [u + k_p e(t + T_l) + k_d e'(t + T_l)],   Q: Butterworth low-pass of second order, forwards and backwards

beside the PID with feed-forward. ``iterative_learning``: the law starts anew before every trial, the axis where it came
to rest. ``repetitive``: the program goes round, law and axis go on, which makes the same update the plug-in repetitive
controller with a non-causal filter. Sources: D. Bristow, M. Tharayil, A. Alleyne, A survey of iterative learning
control, IEEE Control Systems Magazine 26 (2006) 96-114; R. Longman, Iterative learning control and repetitive control
for engineering practice, International Journal of Control 73 (2000) 930-954.
"""

import functools

import numpy as np

KINDS = ("iterative_learning", "repetitive")
BASE = "pid_feedforward"
#: Gains of the learning: name to the bounds of a search, V/m, V s/m, s, Hz.
BOUNDS = {
    "learn_proportional": (1e4, 2e6),
    "learn_damping": (1e1, 1e4),
    "learn_lead": (1e-4, 1e-2),
    "learn_cutoff": (10.0, 500.0),
}
TRIALS = 6  # of which the last is judged


def update(added, error, gains, period, limit):
    """The voltage [V] of the next trial, from that of the last, ``added``, and its ``error`` [m]; each of shape
    (n,). ``gains``: of `BOUNDS`, SI; ``period`` [s]; the voltage stays within ± ``limit`` [V]."""
    from scipy.signal import sosfiltfilt  # half a second to load

    lead = round(gains["learn_lead"] / period)
    wanted = gains["learn_proportional"] * error + gains["learn_damping"] * np.gradient(error, period)
    return np.clip(sosfiltfilt(_filter(gains["learn_cutoff"], period), added + np.roll(wanted, -lead)), -limit, limit)


@functools.lru_cache(maxsize=8)
def _filter(cutoff, period):
    from scipy.signal import butter

    return butter(2, min(cutoff, 0.45 / period), fs=1.0 / period, output="sos")


def run_trials(kind, cell, reference, led, gains, period, trials=TRIALS):
    """True error [m], shape (n,), of the last trial of the program, ``reference`` [m] with ``led`` rows before it.

    ``cell`` : function (reference [m], added [V], start anew) → (encoder [m], stage [m]), which goes on from call to
    call. ``gains``: of `BOUNDS`, SI; ``period`` [s]; ``led`` and ``trials`` [1].
    """
    program = reference[led:]
    added = np.zeros(len(program))
    for trial in range(trials):
        anew = trial == 0 or kind == "iterative_learning"
        before = led if anew else 0
        path = reference if anew else program
        encoder, stage = cell(path, np.concatenate([np.zeros(before), added]), anew)
        error = (path - encoder)[before:]
        if trial < trials - 1:
            added = update(added, error, gains, period, cell.limit)
    return stage[before:] - program
