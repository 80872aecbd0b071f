"""What margin at the amplifier costs the observer law, and what the law does in its place.

The doubts in voltage and encoder and the bandwidth of the regulator are swept; each setting is run through the program
of `campaign` on the nominal machine and on others. Frozen: doubts, gains and the nominal drive stay those of the
setting, so that the loop is the linear one whose margins `tuning.margins` tells. Learning: the law as it is shipped,
started with the setting's doubts; its margins are those of the start. Last, its answer to a gain that jumps.

``seed``, ``seeds`` (k,) are counts [1]; ``gains`` {name: number in the unit of its `control.gains.Gain`}.
"""

from dataclasses import dataclass

from microstage_ros.control.laws.controller import controller_parameters
from microstage_ros.control.robustness.campaign import examine
from microstage_ros.control.robustness.conditions import conditions
from microstage_ros.control.runs.trials import gain_jump_trial
from microstage_ros.control.tuning.margins import controller_margins
from microstage_ros.control.tuning.tuning import GUARDED

LAW = "self_tuning_observer"
FROZEN, LEARNING = "frozen", "learning"
#: What it does, doubt in the voltage and in the encoder over the shipped ones, bandwidth of the regulator over its own.
SETTINGS = (
    *((FROZEN, voltage, 1.0, 1.0) for voltage in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)),
    *((FROZEN, voltage, 1.0, 0.5) for voltage in (1.0, 4.0, 6.0)),
    *((FROZEN, voltage, 4.0, 1.0) for voltage in (1.0, 4.0, 6.0)),
    *((LEARNING, *doubts, 1.0) for doubts in ((1.0, 1.0), (5.0, 1.0), (6.0, 3.0), (6.0, 4.0))),
)
MACHINES = (
    "nominal",
    "friction x 0.5",
    "mass x 3",
    "mass x 6",
    "stiffness x 0.33",
    "rotor inertia x 4",
    "cable spring 20 kN/m",
    "amplifier gain x 1.4",
    "delay 0.3 ms",
)
FACTORS = (0.4, 0.5, 0.7, 1.4, 2.0, 2.5)  # of the amplifier's gain, in a jump
SINE = (1e-5, 0.25, 2.0)  # m, Hz, s: amplitude and frequency, and when the gain jumps
HEADS = [
    "drive, doubts, gains",
    "doubt in the voltage",
    "in the encoder",
    "bandwidth",
    "gain margin (dB)",
    "phase (deg)",
    "settled (nm)",
    *MACHINES,
]
JUMP_HEADS = ["law", "figure", *(f"x {factor:g}" for factor in FACTORS)]


@dataclass(frozen=True)
class Cost:
    """One setting, worst of the seeds.

    Attributes
    ----------
    setting : of `SETTINGS`. gain_db, phase_deg : least margins in the regimes `GUARDED` [dB, degrees], infinite where
    the loop never crosses. settled : error at the end of a move on the nominal machine [m]. largest, sine : largest
    error, and peak in the sine of 10 um, on each of `MACHINES` [m].
    """

    setting: tuple
    gain_db: float
    phase_deg: float
    settled: float
    largest: tuple
    sine: tuple


def gains_of(axis, setting):
    """Gains of the observer law in a ``setting`` of `SETTINGS`, whose factors are over the shipped ones [1]."""
    does, voltage, encoder, bandwidth = setting
    gains = {
        "voltage_doubt": voltage,
        "encoder_doubt": encoder,
        "proportional": bandwidth * float(controller_parameters(LAW, axis, {})["pid"]["proportional"]),
    }
    if does == LEARNING:
        return gains
    none = ("supervised", "speed", "back_off", "widest_gap", "resistance_spread", "zero_spread", "emf_spread")
    return gains | dict.fromkeys(none, 0.0)


def cost_of_margins(axis, setting, seeds):
    """`Cost` of a ``setting`` of `SETTINGS` [1]."""
    gains = gains_of(axis, setting)
    margins = [m for m in controller_margins(axis, controller_parameters(LAW, axis, gains)) if m.regime in GUARDED]
    known = {condition.name: condition for condition in conditions(axis)}
    runs = {name: [examine(axis, known[name], seed, LAW, gains) for seed in seeds] for name in MACHINES}
    return Cost(
        setting,
        min(m.gain_db if m.stable else 0.0 for m in margins),
        min(m.phase_deg if m.stable else 0.0 for m in margins),
        max(run.worst_settled for run in runs["nominal"]),
        tuple(max(run.largest for run in runs[name]) for name in MACHINES),
        tuple(max(run.moving for run in runs[name]) for name in MACHINES),
    )


def row(cost):
    """Cells of a table below `HEADS`."""
    does, *setting = cost.setting
    return [
        does,
        *(f"{value:g}" for value in setting),
        f"{cost.gain_db:.1f}",
        f"{cost.phase_deg:.0f}",
        f"{cost.settled * 1e9:.3g}",
        *(f"{largest * 1e6:.2g}, {sine * 1e9:.3g}" for largest, sine in zip(cost.largest, cost.sine)),
    ]


def jump_rows(axis, seeds, laws=(LAW, "self_tuning")):
    """Rows below `JUMP_HEADS`: largest error after a jump of the amplifier's gain in a sine, and at its end [nm].

    ``laws``: names, shape (n,).
    """
    found = []
    for law in laws:
        jumps = [[gain_jump_trial(axis, law, factor, seed, *SINE) for seed in seeds] for factor in FACTORS]
        for k, words in enumerate(("after the jump (nm)", "last fifth (nm)")):
            found.append([law, words, *(f"{max(jump[k] for jump in each) * 1e9:.3g}" for each in jumps)])
    return found
