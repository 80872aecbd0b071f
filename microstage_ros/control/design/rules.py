"""Gains by rule from the axis's own numbers: the start of every tuning, and what holds at other periods.

In volts, an axis is M_v dv/dt + E v = U - friction, with M_v = R J N / (k_M r) + m R r / (k_M N) [V s^2/m] for a
motor and m / gain for a force drive. Three bandwidths make a controller:

    K_D = b M_v,   K_P = w_p K_D,   K_I = w_i K_P

An encoder-only law needs a filter and has to leave the drive train's resonance alone; the observer law knows
the motor's speed from its back-EMF and may be five times as stiff. Longer periods lower the bandwidths.

Of every function here ``model`` is a feed-forward record (`control.feedforward.axis.PARAMETERS`, SI) and ``period`` the
control period [s]; gains are {name: number in the unit of its `control.gains.Gain`}.
"""

import math

from microstage_ros.control.observer.flexible_mode import held_gains

ENCODER_PERIOD = 5.0e-4  # s; up to it the encoder-only bandwidths hold
ENCODER = {"b": 381.0, "w_p": 345.0, "w_i": 130.0, "lag": 1.62e-3}
TUNED_PERIOD = 1.0e-4  # s; up to it the self-tuning laws may double K_I and K_D, from `ENCODER_PERIOD` on not
SAMPLING_LAG = 1.5  # periods, of reading, difference and hold: what is left of `lag` is the derivative's filter
# fed forward where nothing tells the level: more of it builds up an overshoot from short move to short move
FRICTION_SHARE = 0.6
# s, of all gains, of K_D beside; at longer ones the encoder's noise would rattle an axis at rest; least share of the
# gains there
CALM_PERIOD, DAMPED_PERIOD, LEAST_CALM = 1.25e-4, 5.0e-5, 0.5
POSITION_SHARE, POSITION_RATE = 0.02, 5.0  # of the static gain; 1/s where the drive tells no damping
NCTF = {"b": 455.0, "filter_time": 1.64e-3}
OBSERVER = {"b": 2200.0, "w_p": 270.0, "w_i": 80.0}
OBSERVER_PERIOD = 2.5e-4  # s; through longer ones a voltage that is held throws the stage: see `swing`
RAISED = 1.2  # of K_D, as tuned; through a hold the tuned one is all that the stage bears
HELD_W_I = 40.0  # 1/s, then


def volts_per_acceleration(model):
    """M_v [V s^2/m] of a feed-forward model record."""
    return float(model["rotor"] + model["volts_per_force"] * model["mass"])


def encoder_gains(model, period):
    """PID gains of the encoder-only laws (names of `pid.GAINS`)."""
    slower = min(1.0, math.sqrt(ENCODER_PERIOD / period))
    w_p = ENCODER["w_p"] * slower
    return {
        "proportional": ENCODER["b"] * slower * volts_per_acceleration(model) * w_p,
        "derivative_time": 1.0 / w_p,
        "integral_time": 1.0 / min(ENCODER["w_i"], 0.55 * w_p),
        "filter_time": max(ENCODER["lag"] - SAMPLING_LAG * period, 0.3 * period),
        "derivative_on_reference": 1.0,
    }


def observer_gains(model, period):
    """PID gains of the law on the observer's motion; without a current it is no better than the encoder's."""
    if not float(model["force_per_ampere"]) > 0.0:
        return encoder_gains(model, period)
    if period > OBSERVER_PERIOD and float(model["compliance"]) > 0.0:
        swing, rate, proportional, derivative = held_gains(model, period)
        motion = {
            "proportional": proportional, "derivative_time": derivative / proportional, "integral_time": 1.0 / HELD_W_I,
            "swing_share": swing / proportional, "swing_time": rate / proportional,
        }
    else:
        b = min(OBSERVER["b"], 1.3 / period)
        w_p = min(OBSERVER["w_p"], b / 4.4)
        motion = {
            "proportional": b * volts_per_acceleration(model) * w_p, "derivative_time": 1.0 / w_p,
            "integral_time": 1.0 / min(OBSERVER["w_i"], w_p / 3.4),
        }
    raised = 1.0 if "swing_share" in motion else RAISED
    return {
        **motion,
        "filter_time": 0.0,
        "derivative_on_reference": 1.0,
        "back_off": 0.15,
        "recovery": 0.01,
        "damping_share": 0.0,
        "prompt": 0.12,
        "joint": 1.0,
        "filter_ceiling": 2.5,
        "large": 1.0,
        "integral_ceiling": 1.2,
        "damping_ceiling": raised,
        "spread": 1.5,
        "follow": 0.0,
        "soft_proportional": 1.2,
        "soft_integral": 1.2,
        "soft_damping": raised,
        "least_ceiling": 0.12,
        "least_damping": 0.12,
        "least_integral": 0.12,
    }


def nctf_gains(model, period):
    """Gains of the NCTF law with about the damping of the encoder-only PID."""
    slower = min(1.0, ENCODER_PERIOD / period)
    b = NCTF["b"] * slower
    damping = b * volts_per_acceleration(model)
    return {
        "beta": 0.35 * b,
        "velocity_proportional": damping,
        "velocity_integral": 0.25 * damping * b,
        "filter_time": NCTF["filter_time"] / slower,
    }


def position_gains(model, period):
    """Integral control of a drive whose command sets a position (stepper, piezo): K_I = w_i times command per position.

    A lightly damped resonance w_0, z leaves integral control w_i < 2 z w_0 = c/m; the rule takes the drive's own share
    of it (``integral_rate``), and no more than a tenth of what the sampling bears. K_P is a fiftieth of the static
    gain.
    """
    rate = min(float(model["integral_rate"]) or POSITION_RATE, 0.1 / period)
    return {
        "proportional": POSITION_SHARE * float(model["volts_per_position"]), "integral_time": POSITION_SHARE / rate,
        "derivative_time": 0.0, "filter_time": 0.0, "derivative_on_reference": 1.0,
    }


def fed_forward_gains(model, period):
    """`encoder_gains` with the share of the friction that is fed forward."""
    return {**encoder_gains(model, period), "friction_share": FRICTION_SHARE}


def self_tuning_encoder_gains(model, period):
    """`encoder_gains` with how far they may be tuned."""
    return {**encoder_gains(model, period), **self_tuning_gains(period, fed_forward=False)}


def fed_forward_self_tuning_gains(model, period):
    """`fed_forward_gains` with how far they may be tuned."""
    return {**fed_forward_gains(model, period), **self_tuning_gains(period, fed_forward=True)}


def self_tuning_gains(period, fed_forward):
    """How far the encoder-only self-tuning may go, and how it rests."""
    calm, damped = (max(min(1.0, math.sqrt(bound / period)), LEAST_CALM) for bound in (CALM_PERIOD, DAMPED_PERIOD))
    share = min(max((ENCODER_PERIOD - period) / (ENCODER_PERIOD - TUNED_PERIOD), 0.0), 1.0)
    raised = 1.2 + 0.8 * share
    gains = {"calm_gain": calm, "calm_damping": damped, "integral_ceiling": raised, "damping_ceiling": raised}
    if fed_forward:  # moves that are fed forward swing under a raised K_I
        return gains | {"integral_ceiling": 1.2}
    # nothing takes over from K_I, so it stays, and a longer filter bears it
    return gains | {"speed": 80.0, "filter_ceiling": 3.2, "soft_integral": 1.1, "soft_damping": 0.9}
