"""Amplifier, winding and drive train in the stage-against-motor channel (all columns in metres of stage)."""

import dataclasses
import math

import numpy as np
from scipy.signal import lfilter

from microstage_ros.diagnosis.catalogue.form import Form, one, wave
from microstage_ros.model.effects import REGISTRY

DEAD_WIDTHS = (0.5e-3, 1e-3, 2e-3, 5e-3, 10e-3, 20e-3, 40e-3, 80e-3)  # V
HEAT_TIMES = (2.0, 6.0, 20.0, 60.0)                                    # s
STIFFNESS_FACTORS = tuple(round(1.25**n, 3 if n < -8 else 2) for n in range(-14, 0))
MASS_FACTORS = tuple(round(1.12**n, 2) for n in (*range(-5, 0), *range(1, 14)))
FLANK_FORCES = (0.02, 0.1, 0.25)                                       # N: over which a flank gives way
SCREW_HARMONICS = (1, 2, 3)
# g − 1 of a gain above one: what is assumed until it is fitted, and the least after; derived: a tenth leaves all but
# the last tenth of the voltage unlimited, and a divisor is never nothing
FIRST_EXCESS, LEAST_EXCESS = 0.1, 1.0e-3
# m, of a term that repeats within a turn; derived: five times the largest that the effect draws
# (`model.effects.drive.ScrewPitchError`)
MOST_PITCH_ERROR = 2.0e-5
MOST_LEAD_ERROR = REGISTRY["screw_pitch_error"].parameters["cumulative"].maximum    # of the lead


def amplifier_offset(channel, frame):
    """Constant voltage, integrated."""
    return channel.integral(np.ones(len(channel.prepared.time)))[:, None]


def amplifier_gain(channel, frame):
    """u → factor · u; β = factor − 1."""
    return channel.integral(channel.prepared.answered)[:, None]


def gain_within_the_limit(excess=FIRST_EXCESS):
    """The same of an amplifier that has no more to give than its limit U: (clip(g u, ±U) − u)/(g − 1), g = 1 +
    ``excess`` [1] above one."""
    def columns(channel, frame):
        command, most = channel.prepared.answered, frame.drive.voltage_limit
        return channel.integral((np.clip((1.0 + excess) * command, -most, most) - command) / excess)[:, None]
    return columns


def _gain_about(beta):
    """`LIMITED_GAIN` with the columns of the excess β that was fitted."""
    excess = max(float(beta[0]), LEAST_EXCESS)
    return dataclasses.replace(LIMITED_GAIN, variant=f"within the limit, {excess:.3g}",
                               columns=gain_within_the_limit(excess))


def amplifier_deadband(width):
    """u → sgn u · max(|u| − h, 0), u with the amplifier's offset: what is missing is u clipped to ±h; scaled to volts
    of h, the ``width`` [V]."""
    def columns(channel, frame):
        return -channel.integral(np.clip((channel.prepared.answered + frame.drive.offset) / width, -1.0, 1.0))[:, None]
    return columns


def resistance_rise(time):
    """R (1 + h): h starts at some value and relaxes, and rises with the heat R i²: β = (initial, rise per joule).

    ``time``: constant of the winding's heat [s].
    """
    def columns(channel, frame):
        p, r = channel.prepared, frame.drive.resistance
        keep = np.exp(-p.period / time)
        heat = lfilter([p.period], [1.0, -keep], r * p.settled**2)
        voltage = r * p.settled
        return -channel.integral(np.stack([voltage * np.exp(-p.time / time), voltage * heat], axis=1))
    return columns


def screw_pitch_error(harmonic):
    """Lead error: sines of ``harmonic`` [1] screw angles, and a relative error of the lead; β = (sin, cos,
    cumulative)."""
    def columns(channel, frame):
        angle = 2.0 * np.pi * harmonic * channel.prepared.position / frame.drive.pitch
        return np.stack([channel.mean(np.sin(angle)), channel.mean(np.cos(angle)), channel.position], axis=1)
    return columns


def backlash(force):
    """The stage hangs back by half the gap on the flank that drives; β = the gap [m].

    ``force``: over which a flank gives way [N].
    """
    def columns(channel, frame):
        return -0.5 * channel.mean(np.tanh(channel.prepared.guideway / force))[:, None]
    return columns


def windup_compliance(channel, frame):
    """Wind-up [m] in proportion to the load; β = 1/factor − 1."""
    return -channel.load[:, None] / frame.drive.stiffness


def drive_compliance(factor):
    """Wind-up and resonance with K_c × ``factor`` [1], minus nominal; β = 1 at this factor."""
    def columns(channel, frame):
        return channel.change(stiffness=factor)[:, None]
    return columns


def payload_resonance(factor, load=None):
    """Mass × ``factor`` [1] and guideway force × ``load`` [1], by default the same, minus nominal; β = 1 at these."""
    def columns(channel, frame):
        return channel.change(mass=factor, load=factor if load is None else load)[:, None]
    return columns


def of_voltage(channel, frame):
    """Any function of the command (generic): hats over the size of u, odd and even."""
    knots = np.array([0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0])
    u = channel.prepared.answered
    hats = np.stack([np.interp(np.abs(u), knots, row) for row in np.eye(len(knots))[1:]], axis=1)
    return channel.integral(np.concatenate([hats * np.sign(u)[:, None], hats], axis=1))


def _factor_sizes(name, unit, factor, scale=1.0, extra=None):
    def sizes(beta, covariance, frame):
        unitless = 1.0 + float(beta[0]) * (1.0 / factor - 1.0)  # compliance is linear in 1/K
        value = 1.0 / max(unitless, 1e-3)
        stderr = abs(value**2 * (1.0 / factor - 1.0)) * np.sqrt(covariance[0, 0])
        return {name: (value, float(stderr), unit)}, {name: value, **(extra or {})}
    return sizes


def _mass_sizes(factor):
    def sizes(beta, covariance, frame):
        mass = frame.drive.mass * (factor - 1.0)
        return ({"mass_kg": (float(mass * beta[0]), float(abs(mass) * np.sqrt(covariance[0, 0])), "kg")},
                {"mass_kg": float(mass * beta[0])})
    return sizes


def _load_sizes(beta, covariance, frame):
    m = frame.drive.mass
    return ({"mass_kg": (float(m * beta[0]), float(m * np.sqrt(covariance[0, 0])), "kg")},
            {"mass_kg": float(m * beta[0])})


def _heat_sizes(time):
    def sizes(beta, covariance, frame):
        sigma = np.sqrt(np.diag(covariance))
        return (
            {
                "rise_per_joule": (float(beta[1]), float(sigma[1]), "1/J"),
                "initial": (float(beta[0]), float(sigma[0]), "1"),
                "time_s": (time, time, "s"),
            },
            {"rise_per_joule": max(float(beta[1]), 0.0), "initial": float(np.clip(beta[0], -0.5, 2.0)), "time_s": time},
        )
    return sizes


def _lead_sizes(harmonic):
    def sizes(beta, covariance, frame):
        amplitude, sigma, phase, sigma_phase = wave(beta[:2], covariance[:2, :2])
        return ({"amplitude_m": (amplitude, sigma, "m"), "phase_rad": (phase, sigma_phase, "rad"),
                 "cumulative": (float(beta[2]), float(np.sqrt(covariance[2, 2])), "1")},
                {"amplitude_m": amplitude, "cycles_per_turn": float(harmonic), "phase_rad": phase,
                 "cumulative": float(np.clip(beta[2], -0.05, 0.05))})
    return sizes


def _heats(beta):
    """Loss warms a winding: one that cooled by it is another gain."""
    return beta[1] > 0.0


def _is_a_screw(beta):
    """No screw's lead is off by more than its effect allows: what goes with the travel so is another gain. Nor does it
    wave by more than `MOST_PITCH_ERROR`: half a turn shows any smooth course as a part of a wave."""
    return abs(beta[2]) < MOST_LEAD_ERROR and math.hypot(beta[0], beta[1]) < MOST_PITCH_ERROR


def _gap_sizes(beta, covariance, frame):
    r = frame.drive.radius
    width = float(beta[0] / r)
    return {"width_rad": (width, float(np.sqrt(covariance[0, 0]) / r), "rad")}, {"width_rad": max(width, 0.0)}


def _compliance_sizes(beta, covariance, frame):
    factor = 1.0 / max(1.0 + float(beta[0]), 1e-3)
    return ({"stiffness_factor": (factor, float(factor**2 * np.sqrt(covariance[0, 0])), "1")},
            {"stiffness_factor": factor})


def _yields_more(beta):
    """A drive that yielded less than the file's would be none of the effect, which is a softer one."""
    return beta[0] > 0.0


def _near_one(smallest=False):
    """β must be near 1 for the form's own size to be the right one; the smallest forms are linear down to 0."""
    return lambda beta: (0.0 if smallest else 0.5) < beta[0] < 1.8


LIMITED_GAIN = Form("amplifier_gain", "windup", "within the limit", gain_within_the_limit(),
                    one("factor", "1", value=lambda b: 1.0 + b), lambda b: b[0] > 0.0, about=_gain_about)
FORMS = (
    Form("amplifier_offset", "windup", "", amplifier_offset, one("offset_V", "V")),
    Form("amplifier_gain", "windup", "", amplifier_gain, one("factor", "1", value=lambda b: 1.0 + b)),
    LIMITED_GAIN,
    *(
        Form(
            "amplifier_deadband",
            "windup",
            f"{h:g}",
            amplifier_deadband(h),
            one("half_width_V", "V"),
            lambda b: b[0] > 0,
        )
        for h in DEAD_WIDTHS
    ),
    *(Form("resistance_rise", "windup", f"{t:g}", resistance_rise(t), _heat_sizes(t), _heats) for t in HEAT_TIMES),
    *(
        Form("screw_pitch_error", "windup", f"{n}", screw_pitch_error(n), _lead_sizes(n), _is_a_screw)
        for n in SCREW_HARMONICS
    ),
    *(Form("backlash", "windup", f"{f:g}", backlash(f), _gap_sizes, lambda b: b[0] > 0) for f in FLANK_FORCES),
    Form("drive_compliance", "windup", "", windup_compliance, _compliance_sizes, _yields_more),
    *(
        Form(
            "drive_compliance",
            "resonance",
            f"{f:g}",
            drive_compliance(f),
            _factor_sizes("stiffness_factor", "1", f),
            _near_one(0.75 < f),
        )
        for f in STIFFNESS_FACTORS
    ),
    Form("payload_change", "windup", "", windup_compliance, _load_sizes, lambda b: b[0] > -1.0),   # there is a mass
    *(
        Form("payload_change", "resonance", f"{f:g}", payload_resonance(f), _mass_sizes(f), _near_one(0.75 < f < 1.3))
        for f in MASS_FACTORS
    ),
    Form("generic:voltage", "windup", "", of_voltage),
)
