"""How much a healthy machine differs from itself: from repetition to repetition, and from one state of assembly to
another.

A repetition's vector is  z = H b + e:  modes H in which healthy machines vary (level, asymmetry, viscous part, waves
along the stroke, starts, ripple …) with sizes b of variance τ², and independent e of variance σ². A machine that was
disassembled and assembled again differs further by H c with c of variance ρ². τ and σ come from the baseline's
repetitions, ρ from its files; where there are few, the figures of `USUAL` carry weight (empirical Bayes:
variance = (ν₀ v₀ + Σ b²) / (ν₀ + n)).
"""

import dataclasses

import numpy as np

PRIOR_REPETITIONS = 3.0   # weight of the usual figures, in repetitions; a judgement
PRIOR_GROUPS = 4.0        # the same, in states of assembly
ROUNDS = 6
#: Usual healthy standard deviations of a mode, relative to the channel's scale: (repetition, state of assembly).
#: A judgement from the machine states of published logs (docs/logs.md), as are the figures below; no command writes
#: them. What they cost and save, `microstage log --examine` measures: false alarms, effects found, intervals that hold.
USUAL = {
    "level": (0.010, 0.030),
    "moving": (0.010, 0.025),
    "viscous": (0.008, 0.030),
    "inertia": (0.010, 0.030),
    "start": (0.020, 0.060),
    "brake": (0.020, 0.060),
    "spring": (0.005, 0.015),
    "waves": (0.005, 0.025),
    "waves of force": (0.005, 0.015),
    "lost motion": (0.010, 0.020),
    "speed": (0.005, 0.030),
    "acceleration": (0.010, 0.060),
    "place": (0.004, 0.030),
    "creep": (0.005, 0.010),
    "gain": (0.003, 0.010),
    "constant": (0.005, 0.020),
    "resistive": (0.004, 0.015),
    "offset": (1.0, 1.0),
    # and the ripple itself, for its phase is another after assembly
    "turn": (0.004, 0.010),
    "turn of friction": (0.004, 0.010),
    "level transient": (0.010, 0.040),
    "speed transient": (0.010, 0.040),
    "force in error": (0.010, 0.025),
}
MODES = {
    "effort": (
        "level",
        "moving",
        "viscous",
        "inertia",
        "start",
        "brake",
        "spring",
        "waves",
        "waves of force",
        "turn",
        "turn of friction",
    ),
    "error": (
        "level",
        "level transient",
        "speed transient",
        "force in error",
        "lost motion",
        "speed",
        "acceleration",
        "start",
        "brake",
        "place",
        "waves",
        "creep",
        "offset",
        "turn",
        "turn of friction",
    ),
    "voltage": ("gain", "constant", "resistive"),
}
#: A mode of its own per cell at rest: what friction holds there is open, a magnitude at rest less so.
REST = {"effort": (0.10, 0.20), "magnitude": (0.03, 0.08), "error": (0.02, 0.04), "voltage": (0.05, 0.05)}
HOLD = (0.03, 0.15)       # of the error's rms: where within its friction an axis comes to rest
AMPLITUDE = {
    "ripple": (0.003, 0.010, 0.10, 0.25),
    "ripple high": (0.003, 0.010, 0.10, 0.20),
    "rough": (0.06, 0.25, 0.0, 0.0),
    "breakaway": (0.02, 0.05, 0.05, 0.15),
}
PATTERN = 0.012           # of the scale: what assembly changes in single cells beyond the modes


@dataclasses.dataclass
class Spread:
    """Healthy variation of one channel's coordinates.

    ``modes`` (K, m); ``names``; ``repetition``, ``assembly``: variances (m,); ``noise``: variances (K,) of one
    repetition; ``repetitions``: {condition: number}; ``groups``: {condition: number}; ``dof``: degrees of freedom
    behind the variances.
    """

    modes: np.ndarray
    names: list
    repetition: np.ndarray
    assembly: np.ndarray
    noise: np.ndarray
    repetitions: dict
    groups: dict
    dof_repetition: float
    dof_assembly: float

    def covariance(self, coordinates, now, base, assembly=True):
        """Covariance (K, K) of the difference of two means.

        ``now``, ``base``: repetitions behind each coordinate's mean (K,); ``assembly``: whether the two may be
        different states of assembly.
        """
        same = coordinates.condition[:, None] == coordinates.condition[None, :]
        count = 1.0 / np.maximum(now, 1) + 1.0 / np.maximum(base, 1)
        within = (self.modes * self.repetition) @ self.modes.T + np.diag(self.noise)
        total = within * same * np.sqrt(np.outer(count, count))
        if assembly:
            share = np.array([1.0 + 1.0 / max(self.groups.get(int(c), 1), 1) for c in coordinates.condition])
            total = total + ((self.modes * self.assembly) @ self.modes.T + np.diag(_pattern(coordinates))) * np.sqrt(
                np.outer(share, share)
            )
        free = coordinates.shifted
        return total + free @ free.T if free.shape[1] else total


def _pattern(coordinates):
    return np.array([PATTERN**2 if kind in ("start", "steady", "brake") else 0.0 for kind in coordinates.kind])


def deviations(vectors, groups, coordinates):
    """Repetitions, ``vectors`` (runs, K), less the mean of their file and condition, NaN where a repetition has no
    such cell; and the files' means."""
    out, means = np.full(vectors.shape, np.nan), []
    for group in np.unique(groups):
        own = groups == group
        with np.errstate(all="ignore"):
            mean = _nanmean(vectors[own])
        out[own] = vectors[own] - mean
        means.append(mean)
    return out, np.array(means)


def _nanmean(values):
    count = np.isfinite(values).sum(axis=0)
    return np.where(count > 0, np.nansum(values, axis=0) / np.maximum(count, 1), np.nan)


def mean_of(vectors):
    """Mean of ``vectors`` (runs, K) per coordinate (NaN where none has it), and the number behind it."""
    return _nanmean(vectors), np.isfinite(vectors).sum(axis=0)


def learn(coordinates):
    """`Spread` from the baseline's repetitions and files."""
    modes, names, prior_r, prior_a = _modes(coordinates)
    residuals, means = deviations(coordinates.baseline, coordinates.group_baseline, coordinates)
    sizes = {int(c): _count(coordinates.baseline, coordinates, c) for c in np.unique(coordinates.condition)}
    groups = {int(c): _count(means, coordinates, c) for c in np.unique(coordinates.condition)}
    free = len(residuals) - len(means)
    repetition, noise = _fit(residuals, modes, prior_r**2, coordinates, PRIOR_REPETITIONS, free)
    between = means - _nanmean(means)
    single = free == 0                      # one repetition per file: files tell of both
    lost = max(len(groups), 1)
    if single:
        repetition, noise = _fit(between, modes, prior_r**2, coordinates, PRIOR_REPETITIONS, len(means) - lost)
    assembly, more = (
        (_fit(between, modes, prior_a**2, coordinates, PRIOR_GROUPS, len(means) - lost)[0], len(means) - lost)
        if len(means) > lost
        else (prior_a**2, 0)
    )
    return Spread(
        modes,
        names,
        repetition,
        assembly,
        noise,
        sizes,
        groups,
        PRIOR_REPETITIONS + max(free, len(means) - lost if single else 0),
        30.0 if not more else PRIOR_GROUPS + 8.0 + more,
    )


def _count(vectors, coordinates, code):
    own = coordinates.condition == code
    return int(np.isfinite(vectors[:, own]).any(axis=1).sum())


def _modes(coordinates):
    """Mode matrix, names, and usual standard deviations (repetition, assembly) of each mode."""
    size = len(coordinates.kind)
    columns, names, repetition, assembly = [], [], [], []
    channel = coordinates.channel.name
    usual = {kind: _mean_amplitude(coordinates, kind) for kind in AMPLITUDE}
    for name in MODES[channel]:
        for k, column in enumerate(coordinates.columns.get(name, np.zeros((size, 0))).T):
            if np.abs(column).max() > 1e-9:
                columns.append(column)
                names.append(name)
                repetition.append(USUAL[name][0])
                assembly.append(USUAL[name][1] + (usual["ripple"] if name.startswith("turn") else 0.0))
    for k, kind in enumerate(coordinates.kind):
        if kind in ("rest", "settled"):
            sigma = REST["magnitude" if channel == "effort" and not coordinates.channel.signed else channel]
            sigma = sigma if kind == "settled" else (2.0 * sigma[0], 2.0 * sigma[1])
        elif kind in AMPLITUDE:
            least_r, least_a, share_r, share_a = AMPLITUDE[kind]
            # a loop turns what assembly does to the force into more of it
            if channel == "error" and kind != "rough":
                least_a, share_a = 3.0 * least_a, 2.0 * share_a
            sigma = (least_r + share_r * usual[kind], least_a + share_a * usual[kind])
        else:
            continue
        columns.append(np.eye(size)[k])
        names.append(kind)
        repetition.append(sigma[0])
        assembly.append(sigma[1])
    for direction in np.unique(coordinates.direction) if channel == "error" else ():
        held = np.isin(coordinates.kind.astype(str), ("rest", "settled")) & (coordinates.direction == direction)
        if held.any():
            columns.append(held.astype(float))
            names.append("hold")
            repetition.append(HOLD[0])
            assembly.append(HOLD[1])
    return np.array(columns).T.reshape(size, len(columns)), names, np.array(repetition), np.array(assembly)


def _mean_amplitude(coordinates, kind):
    own = coordinates.kind == kind
    if kind == "rough" or not own.any():
        return 0.0
    return float(np.nan_to_num(np.nanmean(coordinates.baseline[:, own])))


def _fit(residuals, modes, prior, coordinates, weight, free):
    """Variances of the modes (m,) and of what is left (K,) by a few rounds of empirical Bayes.

    ``residuals``: (repetitions, K) deviations; ``prior``: usual variances; ``free``: degrees of freedom that the
    deviations have.
    """
    variance = prior.copy()
    filled = np.nan_to_num(residuals)
    seen = np.isfinite(residuals)
    groups = _noise_groups(coordinates)
    noise = np.full(len(coordinates.kind), max(float(np.var(filled[seen])) if seen.any() else 0.0, 1e-10))
    if free <= 0 or not seen.any():
        return variance, noise
    stretch = len(residuals) / free
    for _ in range(ROUNDS):
        inverse = 1.0 / noise
        gram = modes.T @ (modes * inverse[:, None]) + np.diag(1.0 / variance)
        covariance = np.linalg.inv(gram)
        sizes = filled @ (modes * inverse[:, None]) @ covariance
        second = (sizes**2).sum(axis=0) * stretch + len(residuals) * np.diag(covariance) * 0.5
        variance = (weight * prior + second) / (weight + len(residuals))
        left = np.where(seen, filled - sizes @ modes.T, np.nan)
        for members in groups:
            used = np.isfinite(left[:, members])
            total = np.nansum(left[:, members] ** 2) * stretch
            noise[members] = (total + 1e-8) / max(used.sum(), 1)
    return variance, np.maximum(noise, 1e-10)


def _noise_groups(coordinates):
    """Coordinates that share one noise: those of one condition and kind (a single group of amplitudes each)."""
    keys = [(int(c), str(k)) for c, k in zip(coordinates.condition, coordinates.kind)]
    return [np.array([i for i, key in enumerate(keys) if key == one]) for one in dict.fromkeys(keys)]
