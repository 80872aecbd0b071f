"""Friction effects in the torque balance. Residual = torque that was needed − torque of the nominal model."""

import dataclasses
import functools

import numpy as np

from microstage_ros.diagnosis.catalogue.form import Form, one, splines, wave
from microstage_ros.diagnosis.preprocessing.friction_replay import lag_factor, replayed_force
from microstage_ros.diagnosis.preprocessing.motion import through_play
from microstage_ros.diagnosis.preprocessing.smoothing import triangle
from microstage_ros.numerics.compiled import compiled

# relative change of the limits for derivatives by them; derived: blocks near their limit are few in it, and a replay's
# rounding is far less
LIMIT_STEP = 0.05
# of the largest friction: below it the derivative by its limits has no share of the friction; derived: far above the
# rounding of a replayed friction, far below a sliding one
NEAR_ZERO = 0.05
# sizes nearer to zero than this are not replayed as they are; derived: a fifth of `LIMIT_STEP`
LEAST_STEP = 0.01
EXPONENT_STDERR = 0.13                               # the grid's step, halved
LAGS = (1.0e-3, 3.0e-3, 1.0e-2, 3.0e-2)             # s
EXPONENTS = (0.5, 1.5, 1.75, 2.0, 2.25, 2.5, 3.0)
ENDS = (0.6, 1.5, 4.0)                               # rad/s
PIECES = (0.25e-3, 0.5e-3, 1.0e-3)                   # m between the knots of friction along the stroke
AGING = tuple((scale, release) for scale in (0.03, 0.2) for release in (2.0e-6, 8.0e-6, 30.0e-6))  # s, m
CALM = 201                                           # periods
# share of a record in which nothing shakes the axis, and standard deviations of the position there that noise alone
# does not reach; derived: records rest a tenth of their time, and Gaussian noise is beyond three in 0.3 % of it
AT_REST, PLAY = 0.1, 3.0
PROFILE_PRIOR = 0.2                                  # relative; what was not visited stays at the nominal friction
# friction along the stroke is reported only where it is known this well
PROFILE_STDERR = 0.08
COARSE = 4                                           # periods per step of the replays for candidates
CREEPS = ((0.015, 2.0e-8), (0.06, 2.0e-8), (0.06, 8.0e-8), (0.3, 2.0e-8), (0.3, 8.0e-8))   # s, m
CREEP_RELEASE = 1.0e-6                               # m
# m; derived: a tenth of the least of `CREEPS`
LEAST_CREEP = 2.0e-9
# of the limits' own; source: `model.effects.friction`, the least factor and the largest asymmetry that its effects take
LEAST_LIMIT, MOST_ASYMMETRY = 0.05, 0.9
FINE = 8             # points per piece of a profile; derived: a cubic piece is told by four


def _changed(channel, frame, **how):
    """Replayed actuator friction with a change minus without, in block means, at a quarter of the record's rate; kept,
    as the same change is asked for by learning, by stretches and by the model's own errors."""
    if "factor" in how:
        how["factor"] = np.ascontiguousarray(how["factor"][::COARSE])
    name = "changed", *((key, hash(np.asarray(value).tobytes())) for key, value in how.items())
    return _kept(channel, name, lambda: _replayed_change(channel, frame, how))


def _replayed_change(channel, frame, how):
    """`_changed` anew."""
    p, drive = channel.prepared, frame.drive
    speed = p.contact_speed[::COARSE] / drive.radius
    changed = replayed_force(drive.actuator, speed, COARSE * p.period, **how)
    plain = channel.coarse_friction(COARSE)
    if "flow" in how and drive.actuator.law >= 0:   # the flow is carried by the blocks: so is what it is compared with
        plain = _kept(channel, "of blocks", lambda: replayed_force(drive.actuator, speed, COARSE * p.period,
                                                                   flow=np.zeros(len(speed))))
    columns = channel.mean(changed - plain, COARSE)[:, None]
    return columns if "flow" in how else channel.calm(columns)   # what flows does so at rest


def _kept(channel, name, make):
    """What several forms need of a channel, made once: the array ``make()`` under this ``name``."""
    if name not in channel.kept:
        channel.kept[name] = make()
    return channel.kept[name]


def _with_own(channel, replayed):
    """A derivative (blocks,) [N m] by the limits of the replayed friction, and in proportion of what the healthy axis's
    own is beyond it: column (blocks, 1)."""
    size = np.abs(channel.friction).max() * NEAR_ZERO
    share = np.clip(replayed * channel.friction / (channel.friction**2 + size**2), -1.0, 1.0)
    return (replayed + share * channel.own)[:, None]


def _replayed_by_limits(channel, frame):
    """The replayed friction's derivative by a factor on its limits, (blocks,) [N m]."""
    factor = np.full(len(channel.prepared.time), 1.0 + LIMIT_STEP)
    return _kept(channel, "by limits", lambda: _changed(channel, frame, factor=factor)[:, 0] / LIMIT_STEP)


def by_limits(channel, frame):
    """The friction's derivative by a factor on its limits [N m], (blocks, 1): all of it where it slides, none where
    blocks stick far below their limits."""
    return _with_own(channel, _replayed_by_limits(channel, frame))


def direction_asymmetry(step=LIMIT_STEP):
    """Limits × (1 + a · sgn w): what the friction changes by an asymmetry ``step`` [1], over it [N m]."""
    def columns(channel, frame):
        return _with_own(channel, _changed(channel, frame, asymmetry=step)[:, 0] / step)
    return columns


def all_asymmetry(step=LIMIT_STEP):
    """Limits and viscous friction [N m] each differ between the directions: two sizes; ``step``: of the limits [1]."""
    def columns(channel, frame):
        return np.concatenate([direction_asymmetry(step)(channel, frame), np.abs(channel.viscous)[:, None]], axis=1)
    return columns


def _about_its_size(form, columns, least=LEAST_STEP, most=np.inf):
    """The ``form`` with `Form.about`: its ``columns(step)`` are exact for a first size of ``step``, in its unit, which
    is kept between ``least`` and ``most``."""
    def about(beta):
        step = float(np.copysign(np.clip(abs(beta[0]), least, most), beta[0]))
        return dataclasses.replace(form, variant=f"{form.variant} about {step:.3g}", columns=columns(step))
    return dataclasses.replace(form, about=about)


def _positive(effect, variant, first, columns, sizes, least=LEAST_STEP):
    """Form of a size above zero, whose ``columns(step)`` are taken at ``first``, in its unit, until it is fitted."""
    form = Form(effect, "torque", variant, columns(first), sizes, lambda beta: beta[0] > 0)
    return _about_its_size(form, columns, least)


def guideway_asymmetry(channel, frame):
    """The same of the guideways' limits alone [N m]: a constant force but for their long pre-sliding."""
    p, drive = channel.prepared, frame.drive
    speed = p.stage_speed[::COARSE]
    plain, changed = (replayed_force(drive.guideway, speed, COARSE * p.period, a) for a in (0.0, LIMIT_STEP))
    return drive.lever * channel.mean(changed - plain, COARSE)[:, None] / LIMIT_STEP


def _guideway_sizes(beta, covariance, frame):
    value = float(beta[0])
    return {"asymmetry": (value, float(np.sqrt(covariance[0, 0])), "1")}, {
        "asymmetry": float(np.clip(value, -0.9, 0.9)),
        "contact": "guideway",
    }


def _asymmetry_sizes(beta, covariance, frame):
    values, sigma = [float(b) for b in beta], np.sqrt(np.diag(covariance))
    names = ("asymmetry", "viscous_asymmetry")
    return (
        {name: (value, float(s), "1") for name, value, s in zip(names, values, sigma)},
        dict(zip(names, np.clip(values, -0.9, 0.9).tolist())),
    )


def friction_level_change(channel, frame):
    """F → factor · F: nominal friction with its viscous part, and what the healthy axis's own is beyond it."""
    return (channel.friction + channel.viscous + channel.own)[:, None]


def viscous_change(channel, frame):
    """σ → factor · σ."""
    return channel.viscous[:, None]


def _hinders(beta):
    """No friction drives, anywhere, and none is gone: a smaller factor is another cause's."""
    return np.min(beta) > LEAST_LIMIT - 1.0


def nonlinear_viscous(exponent, ends=0.0):
    """Extra c g^n sgn ω_r; g = |ω_r|, or V (1 − exp(−|ω_r|/V)) where the growth ends at a speed V.

    ``exponent``: n [1]; ``ends``: V [rad/s], 0 where it does not end.
    """
    def columns(channel, frame):
        w = channel.prepared.speed / frame.drive.radius
        size = -ends * np.expm1(-np.abs(w) / ends) if ends else np.abs(w)
        return channel.calm(channel.mean(np.sign(w) * size ** exponent)[:, None])
    return columns


def _power_sizes(exponent):
    def sizes(beta, covariance, frame):
        value, stderr = float(beta[0]), float(np.sqrt(covariance[0, 0]))
        return ({"coefficient": (value, stderr, "N m/(rad/s)^n"), "exponent": (exponent, EXPONENT_STDERR, "1")},
                {"coefficient": value, "exponent": exponent})
    return sizes


def _ending(speed):
    """Form of a friction that stops growing at a speed of the screw [rad/s]."""
    return Form("nonlinear_viscous", "torque", f"1,{speed:g}", nonlinear_viscous(1.0, speed),
                one("coefficient", "N m/(rad/s)", extra={"exponent": 1.0, "saturation_speed": speed}), _grows)


def _grows(beta):
    """Friction that is larger only near standstill needs rest before it (`rising_static_friction`), not speed: a film
    builds up."""
    return beta[0] > 0.0


def position_dependent(spacing):
    """Limits × (1 + splines of x), with knots every ``spacing`` [m]: the friction's derivative by its limits × splines.

    The limits alone: below them the blocks, or bristles, have the stiffness that they have everywhere.
    """
    def columns(channel, frame):
        pieces = max(round((frame.high - frame.low) / spacing), 2)
        return by_limits(channel, frame) * splines(channel.place, frame.low, frame.high, pieces)
    return columns


def _profile_about(spacing):
    """`position_dependent` with the change that a profile p makes, over p, in place of the derivative."""
    def about(beta):
        def columns(channel, frame):
            pieces = max(round((frame.high - frame.low) / spacing), 2)
            x = np.linspace(frame.low, frame.high, FINE * pieces + 1)
            profile = np.clip(splines(x, frame.low, frame.high, pieces) @ beta, LEAST_LIMIT - 1.0, None)
            there, here = (np.interp(at, x, profile) for at in (channel.prepared.stage_position, channel.place))
            changed, plain = _changed(channel, frame, factor=1.0 + there)[:, 0], _replayed_by_limits(channel, frame)
            secant = (changed * here + plain * LEAST_STEP**2) / (here**2 + LEAST_STEP**2)
            return _with_own(channel, secant) * splines(channel.place, frame.low, frame.high, pieces)
        return _profile_form(spacing, f"{spacing:g} about {np.std(beta):.3g}", columns, None)
    return about


def _profile_form(spacing, variant, columns, about):
    return Form("position_dependent_friction", "torque", variant, columns, _profile_sizes(spacing), _hinders,
                prior=PROFILE_PRIOR, about=about)


def _profile_sizes(spacing):
    def sizes(beta, covariance, frame):
        pieces = max(round((frame.high - frame.low) / spacing), 2)
        x = np.linspace(frame.low, frame.high, 2 * pieces + 1)
        basis = splines(x, frame.low, frame.high, pieces)
        known = np.sqrt(np.einsum("ij,jk,ik->i", basis, covariance, basis)) < PROFILE_STDERR
        known = known if known.any() else np.ones(len(x), bool)
        profile = np.interp(x, x[known], (basis @ beta)[known])  # constant beyond what the records visited
        spread = float(np.std(profile[known]))
        direction = (profile[known] - profile[known].mean()) @ basis[known] / (known.sum() * max(spread, 1e-12))
        stderr = float(np.sqrt(max(direction @ covariance @ direction, 0.0)))
        return (
            {"rms": (spread, stderr, "1")},
            {"positions_m": [float(v) for v in x], "factors": [float(v) for v in np.clip(1.0 + profile, 0.05, 20.0)]},
        )
    return sizes


def _periodic(period):
    def columns(channel, frame):
        angle = 2.0 * np.pi * channel.place / period
        return by_limits(channel, frame) * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    return columns


def _periodic_sizes(period):
    def sizes(beta, covariance, frame):
        amplitude, sigma, phase, sigma_phase = wave(beta, covariance)
        return ({"amplitude": (amplitude, sigma, "1"), "period_m": (period, 1e-3 * period, "m"),
                 "phase_rad": (phase, sigma_phase, "rad")},
                {"amplitude": amplitude, "period_m": period, "phase_rad": phase})
    return sizes


def periodic_form(period):
    """Form of limits × (1 + a sin(2π x / period + phase)) at a period that the records showed [m]."""
    return Form(
        "position_dependent_friction", "torque", f"wave {period:.6g}", _periodic(period), _periodic_sizes(period)
    )


def waves_form(periods):
    """Nameless `Form` of friction that waves along the stroke at all of these ``periods`` [m]."""
    def columns(channel, frame):
        return np.concatenate([_periodic(period)(channel, frame) for period in periods], axis=1)
    return Form("generic:friction waves", "torque", ",".join(f"{period:.6g}" for period in periods), columns)


def frictional_lag(time):
    """Friction whose sliding curve follows a lagged speed, minus the nominal one; β = 1 at this lag, ``time`` [s]."""
    def columns(channel, frame):
        p, drive = channel.prepared, frame.drive
        return _changed(channel, frame, factor=lag_factor(drive.actuator, p.speed / drive.radius, p.period, time))
    return columns


def rising_static(scale, release, step):
    """Limits × (1 + a): a grows with log dwell while blocks stick and fades with travel; what a rate ``step`` [1]
    changes, over it.

    ``scale``: time from which it grows [s]; ``release``: travel over which it fades [m].
    """
    def columns(channel, frame):
        p = channel.prepared
        age = _ageing(p.stuck, _kept(channel, "calm speed", lambda: _calm_speed(p)), p.period, scale, release)
        return _changed(channel, frame, factor=1.0 + step * age) / step
    return columns


@compiled
def _ageing(stuck, speed, period, scale, release):
    """log10(1 + dwell/scale), the dwell counting while any block sticks; travel wipes out both,
    exp(−travel/release)."""
    age = np.empty(stuck.size)
    dwell, level = 0.0, 0.0
    for i in range(stuck.size):
        if stuck[i] > 0.02:
            dwell += period
        fade = np.exp(-speed[i] * period / release)
        dwell *= fade
        level = max(level * fade, np.log10(1.0 + dwell / scale))
        age[i] = level
    return age


def _calm_speed(prepared):
    """Speed [m/s] whose integral is the travel: |speed| without the readings' noise, which over a dwell would add up.

    That of the position through a play of `PLAY` times its noise at rest. A running mean of the speed, which knows the
    motion before it comes, would wear the dwell off some hundredths of a second before the breakaway. A contact that is
    shaken does not rest.
    """
    position = prepared.position
    rough = triangle((position - triangle(position, CALM)) ** 2, CALM)
    noise = np.sqrt(np.quantile(rough, AT_REST))
    return np.abs(np.diff(through_play(position, PLAY * noise), prepend=position[0])) / prepared.period


def presliding_creep(scale, amplitude):
    """Sticking blocks flow by A/(t + scale) · F_j/F_j,max, t since the contact moved; per metre of A around
    ``amplitude`` [m]. ``scale``: time from which it slows down [s]."""
    def columns(channel, frame):
        p = channel.prepared
        held = _clock(_kept(channel, "calm speed", lambda: _calm_speed(p)), p.period, CREEP_RELEASE)[::COARSE]
        flow = amplitude / frame.drive.radius * COARSE * p.period / (held + scale)
        return _changed(channel, frame, flow=flow) / amplitude
    return columns


@compiled
def _clock(speed, period, release):
    """Time since the contact moved [s], wiped out as exp(−travel / release)."""
    clock = np.empty(speed.size)
    t = 0.0
    for i in range(speed.size):
        t = (t + period) * np.exp(-speed[i] * period / release)
        clock[i] = t
    return clock


def _lag_sizes(time):
    return one("time_s", "s", value=lambda beta: max(beta, 0.0) * time, slope=lambda beta: time)


FORMS = (
    *(
        _about_its_size(Form("direction_asymmetry", "torque", variant, columns(), sizes), columns, most=MOST_ASYMMETRY)
        for variant, columns, sizes in (("", direction_asymmetry, one("asymmetry", "1")),
                                        ("viscous", all_asymmetry, _asymmetry_sizes))
    ),
    Form("direction_asymmetry", "torque", "guideway", guideway_asymmetry, _guideway_sizes, lambda b: abs(b[0]) < 0.9),
    *(
        Form(effect, "torque", "", columns, one("factor", "1", value=lambda beta: 1.0 + beta), _hinders)
        for effect, columns in (("friction_level_change", friction_level_change), ("viscous_change", viscous_change))
    ),
    *(
        Form(
            "nonlinear_viscous", "torque", f"{n:g}", nonlinear_viscous(n), _power_sizes(n), _grows if n < 1.0 else None
        )
        for n in EXPONENTS
    ),
    *map(_ending, ENDS),
    *(_profile_form(s, f"{s:g}", position_dependent(s), _profile_about(s)) for s in PIECES),
    *(Form("frictional_lag", "torque", f"{t:g}", frictional_lag(t), _lag_sizes(t), lambda b: b[0] > 0) for t in LAGS),
    *(
        _positive("rising_static_friction", f"{s:g},{r:g}", LIMIT_STEP, functools.partial(rising_static, s, r),
                  one("rate_per_decade", "1", extra={"dwell_scale_s": s, "release_m": r}))
        for s, r in AGING
    ),
    *(
        _positive("presliding_creep", f"{s:g},{a:g}", a, functools.partial(presliding_creep, s),
                  one("amplitude_m", "m", extra={"time_s": s, "release_m": CREEP_RELEASE}), LEAST_CREEP)
        for s, a in CREEPS
    ),
)
