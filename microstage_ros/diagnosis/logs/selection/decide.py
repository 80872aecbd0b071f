"""Which causes: effects tried on the difference between now and the baseline, against the healthy spread.

All channels together:  D = Σ X_e s_e + n,  n ~ (0, C).  An effect is named if what it removes of Dᵀ C⁻¹ D is more than
chance gives with the degrees of freedom that the baseline has (F test), the strongest first, each beside those already
named. Another effect that removes as much is a rival. What these signals cannot show: `visibility`.
"""

import dataclasses

import numpy as np
from scipy.stats import f as f_distribution

from microstage_ros.diagnosis.logs.selection.effects import ALSO, RARER
from microstage_ros.diagnosis.logs.selection.visibility import LEVEL
from microstage_ros.diagnosis.selection.stepwise import forward

RIVAL = 3.0                # difference of log p within which another effect explains as much (odds of 20)
BEAM = 4                   # first causes that are followed up
PRICE = 8.0                # log likelihood that a further cause must bring beyond its sizes
FURTHER = 0.15             # of what the first causes take, that a further one must take: their forms are not exact
MOST = 4                   # causes that one log can tell of
EXPLAINED = 0.25           # share of what stands out that the causes must remove to be the answer
BEYOND_DOUBT = -16.0       # log p of a first cause that stands whatever else there is
MOSTLY = 0.7               # share from which on little more is to be explained
WHOLE = np.log(1e-5)       # log p below which the difference as a whole stands out
POSITIVE = {"torque_ripple+", "backlash", "rising_static_friction", "floor_vibration", "sampling_jitter",
            "screw_pitch_error", "amplifier_deadband", "transport_delay", "actuator_lag"}
NEGATIVE = {"presliding_creep"}      # on in the direction of motion, which lessens the error
#: What belongs to a place of the stroke is there on the way out and on the way back: else it goes with the way since
#: the last stop, not with the place. (In the following error the loop shifts one against the other.)
OF_PLACE = ("position_dependent_friction", "position_dependent_friction+")
#: Wider forms that hold a uniform change too, and the effect whose it is.
UNIFORM = {"position_dependent_friction+": "friction_level_change"}
FAMILY = ({"friction_level_change", "viscous_change", "nonlinear_viscous", "amplifier_gain", "amplifier_deadband",
           "resistance_rise"},
          {"cable_spring", "payload_change"}, {"gravity_tilt", "direction_asymmetry"},
          {"amplifier_gain", "payload_change"},
          {"backlash", "friction_level_change", "drive_compliance", "transport_delay"})
WIDER_FORM = 2.0           # log odds against a wider form of an effect
FAMILY_RIVAL = 6.0         # the margin within a family, whose forms are the least exact
#: What a cause brings with it, and is no further cause: fluctuations beside ripple, an error at rest that settles
#: later, another error of an uneven lead at either end of the stroke, a drive that goes on within the gap at rest.
BRINGS = {"torque_ripple": ("sampling_jitter", "floor_vibration", "screw_pitch_error"),
          "screw_pitch_error": ("sampling_jitter", "floor_vibration", "scale_error"),
          "backlash": ("presliding_creep",),
          "transport_delay": ("floor_vibration", "sampling_jitter")}
MOST_RIVALS = 6
#: Effects that hold another one as a special case and so always fit as well: no rivals of it.
WIDER = {"friction_level_change": ("position_dependent_friction",), "cable_spring": (),
         "viscous_change": ("nonlinear_viscous",)}


@dataclasses.dataclass
class Problem:
    """The stacked difference D (K,), its covariance C, and the matrix X_e of every effect: {id: (K, k)}.

    ``parts``: {id: list of column names}; ``inflation``: {id: factor on variances from leaving repetitions out};
    ``dof``. ``where``: (K,) channel name of each coordinate; ``direction``: (K,) of motion, or None.
    """

    difference: np.ndarray
    covariance: np.ndarray
    effects: dict
    parts: dict
    where: np.ndarray
    kind: np.ndarray
    dof: float
    inflation: dict = dataclasses.field(default_factory=dict)
    whole_inflation: float = 1.0
    factor: tuple = dataclasses.field(init=False)
    direction: np.ndarray | None = None

    def __post_init__(self):
        count = len(self.covariance)
        root = np.linalg.cholesky(self.covariance + 1e-14 * np.trace(self.covariance) / count * np.eye(count))
        self.factor = (np.linalg.solve(root, self.difference), root)
        self.white = {name: np.linalg.solve(root, x) for name, x in self.effects.items()}

    def taken(self, ids, difference=None):
        """What these effects remove of DᵀC⁻¹D, their sizes and the sizes' covariance."""
        y = self.factor[0] if difference is None else np.linalg.solve(self.factor[1], difference)
        if not ids:
            return 0.0, np.zeros(0), np.zeros((0, 0))
        x = np.hstack([self.white[name] for name in ids])
        size = np.sqrt((x**2).sum(axis=0))
        scaled = x / np.where(size > 0, size, 1.0)
        gram = scaled.T @ scaled + 1e-9 * np.eye(scaled.shape[1])
        inverse = np.linalg.inv(gram)
        beta = inverse @ scaled.T @ y
        left = y - scaled @ beta
        back = 1.0 / np.where(size > 0, size, 1.0)
        return float(y @ y - left @ left), beta * back, inverse * np.outer(back, back)

    @property
    def whole(self):
        """DᵀC⁻¹D of the difference D, as χ² [1]."""
        return float(self.factor[0] @ self.factor[0])

    def log_p(self, name, beside=()):
        """log of the chance [1] that a healthy machine shows as much of this effect, beside those already named."""
        both, alone = self.taken([*beside, name])[0], self.taken(list(beside))[0]
        k = self.white[name].shape[1]
        ratio = max(both - alone, 0.0) / k / max(self.inflation.get(name, 1.0), 1.0)
        return float(log_sf(ratio, k, self.dof))

    def directions_disagree(self, name, ahead, beside=()):
        """log of the chance [1] that an effect of one size shows as differently in the two directions of motion;
        ``ahead``: the rows (K,) of the positive one."""
        both = self.taken([*beside, name])[0]
        root = self.factor[1]
        forward = ahead[:, None]
        halves = [np.linalg.solve(root, self.effects[name] * own) for own in (forward, ~forward)]
        if not all(np.any(half) for half in halves):
            return 0.0
        split = dataclasses.replace(self)
        split.inflation, split.white = self.inflation, {**self.white, "forward": halves[0], "backward": halves[1]}
        k = self.white[name].shape[1]
        return float(log_sf(max(split.taken([*beside, "forward", "backward"])[0] - both, 0.0) / k, k, self.dof))


def log_sf(ratio, k, dof):
    """log of the F law's upper tail at ``ratio`` [1], of ``k`` and ``dof`` degrees of freedom [1]; its leading term
    where the number itself underflows."""
    value = f_distribution.logsf(ratio, k, dof)
    return value if np.isfinite(value) else -0.5 * dof * np.log1p(k * ratio / dof)


def plain(name):
    """The effect's id without the mark of its wider form."""
    return name.rstrip("+")


@dataclasses.dataclass
class Choice:
    """A named effect: its form, log p, ids of its rivals; ``forms``: the form in which each rival was tried."""

    name: str
    log_p: float
    rivals: list
    forms: dict = dataclasses.field(default_factory=dict)


def candidates(problem, visible):
    """Forms that may be tried: those of visible effects."""
    return [name for name in problem.effects if plain(name) in visible]


def choose(problem, possible, open_sign=False, also=None):
    """Causes, the strongest first, each with its rivals. ``possible``: ids that these signals can show, if only in
    unusual sizes.

    ``also``: further rivals by name.

    The first cause is tried with each of the `BEAM` most significant effects; of the sets that follow, the one that
    takes most with fewest causes is kept, so that two effects which make up for each other's misfit do not replace a
    single true one.
    """
    forms = candidates(problem, possible)
    starts = [entry for entry in _tried(problem, forms, [], set()) if _alone(problem, entry, []) < LEVEL][:BEAM]
    sets = [_complete(problem, forms, start) for start in starts]
    chosen = max(sets, key=lambda s: _worth(problem, s), default=[])
    for choice in chosen:
        beside = [c.name for c in chosen if c is not choice]
        own = problem.log_p(choice.name, beside) + RARER.get(plain(choice.name), 0.0)
        wider = WIDER.get(plain(choice.name), ())
        found, also = {}, also or {}
        for value, name in _tried(problem, forms, beside, {plain(b) for b in beside}):
            other = plain(name) != plain(choice.name) and plain(name) not in wider
            if other and value < own + _margin(name, choice.name) and value < 0.5 * LEVEL:
                found.setdefault(plain(name), name)
        choice.forms = found
        choice.rivals = list(found)[:MOST_RIVALS]
        choice.log_p = own
        always = ALSO.get(choice.name, ALSO.get(plain(choice.name), ()))
        choice.rivals += [name for name in (*always, *also.get(plain(choice.name), ()))
                          if name not in choice.rivals and name not in [plain(b) for b in beside]]
        if open_sign:
            swap = {"friction_level_change": "gravity_tilt",
                    "gravity_tilt": "friction_level_change"}.get(plain(choice.name))
            if swap and swap not in choice.rivals and swap not in [plain(b) for b in beside]:
                choice.rivals.append(swap)
    return sorted(chosen, key=lambda c: c.log_p)


def _margin(one, other):
    """Difference of log p within which two effects are rivals."""
    return FAMILY_RIVAL if any({plain(one), plain(other)} <= family for family in FAMILY) else RIVAL


def _complete(problem, forms, start):
    """Forward from one first cause, then backward."""
    chosen, _ = forward(_Difference(problem, forms), [Choice(start[1], start[0], [])], MOST)
    return _backward(problem, chosen)


@dataclasses.dataclass
class _Difference:
    """The difference of a `Problem` as a `stepwise.ResidualModel`; its state is the list of `Choice`, a trial (log p,
    form)."""

    problem: Problem
    forms: list

    def count(self, chosen):
        """Causes so far."""
        return len(chosen)

    def trials(self, chosen):
        """See `_tried`."""
        beside = [c.name for c in chosen]
        return _tried(self.problem, self.forms, beside, {plain(b) for b in beside})

    def first_standing(self, trials, chosen):
        """The most significant one that takes enough beside the others."""
        beside = [c.name for c in chosen]
        return next((entry for entry in trials
                     if _alone(self.problem, entry, beside) < LEVEL and _holds(self.problem, entry[1], beside)), None)

    def extended(self, chosen, winner, trials):
        """With the winner."""
        return [*chosen, Choice(winner[1], winner[0], [])]


def _alone(problem, entry, beside):
    """log p of an entry of `_tried` without what its rarity costs: how rare a cause is does not make a change less of
    one."""
    return problem.log_p(entry[1], beside) + (WIDER_FORM if entry[1].endswith("+") else 0.0)


def _holds(problem, name, beside):
    """Whether a further cause takes enough beside the others: what these miss by their form is no cause of its own."""
    before = problem.taken(beside)[0]
    return problem.taken([*beside, name])[0] - before > FURTHER * before


def _worth(problem, chosen):
    """Log likelihood that a set gains (Student's law), less the price of its causes and sizes."""
    names = [c.name for c in chosen]
    scale = problem.dof * problem.whole_inflation
    taken = problem.taken(names)[0]
    sizes = sum(problem.white[n].shape[1] for n in names)
    k = len(problem.difference)
    rarer = sum(RARER.get(plain(n), 0.0) for n in names)
    left = max(problem.whole - taken, 0.0)
    likelihood = 0.5 * (problem.dof + k) * (np.log1p(problem.whole / scale) - np.log1p(left / scale))
    return likelihood - PRICE * len(names) - sizes - rarer


def _tried(problem, forms, beside, taken):
    """(log p, form) of every acceptable effect beside these, the most significant first."""
    out = []
    brought = {one for cause in taken for one in BRINGS.get(cause, ())}
    for name in forms:
        if plain(name) in taken or plain(name) in brought:
            continue
        value = problem.log_p(name, beside)
        if acceptable(problem, name, beside):
            out.append((value + RARER.get(plain(name), 0.0) + (WIDER_FORM if name.endswith("+") else 0.0), name))
    return sorted(out)


def acceptable(problem, name, beside):
    """Whether the fitted size has a sense: some effects only grow, a wider form must show more than the uniform change
    it holds, and what belongs to a place must be there in both directions."""
    uniform = UNIFORM.get(name)
    if (uniform in problem.effects and uniform not in [plain(b) for b in beside]
            and problem.log_p(name, [*beside, uniform]) > LEVEL):
        return False
    ahead = None if problem.direction is None else problem.direction > 0
    if name in OF_PLACE and ahead is not None and problem.directions_disagree(name, ahead, beside) < LEVEL:
        return False
    if plain(name) not in POSITIVE and name not in POSITIVE and plain(name) not in NEGATIVE:
        return True
    sizes = problem.taken([*beside, name])[1]
    return bool(sizes[-problem.white[name].shape[1]] * (-1.0 if plain(name) in NEGATIVE else 1.0) > 0.0)


def _backward(problem, chosen):
    """Without causes that the later ones have made superfluous, or bring with them, or take too little beside them: a
    small one that was tried first is held to the same as one that comes after."""
    brought = {one for c in chosen for one in BRINGS.get(plain(c.name), ())}
    kept = [c for c in chosen if plain(c.name) not in brought]
    for choice in sorted(kept, key=lambda c: part_of(problem, c, kept)):
        beside = [c.name for c in kept if c is not choice]
        if beside and (problem.log_p(choice.name, beside) > LEVEL or not _holds(problem, choice.name, beside)):
            kept.remove(choice)
    return kept


def part_of(problem, choice, chosen):
    """Part (0 … 1) of the whole difference that a cause takes beside the others ``chosen``, and no other one."""
    beside = [c.name for c in chosen if c is not choice]
    taken = problem.taken([*beside, choice.name])[0] - problem.taken(beside)[0]
    return min(max(taken, 0.0) / max(problem.whole, np.finfo(float).tiny), 1.0)


def stands_out(problem, chosen):
    """log p of the whole difference, and the share of what stands out that the causes remove (1 where nothing does)."""
    k = len(problem.difference)
    log_p = log_sf(problem.whole / k / problem.whole_inflation, k, problem.dof)
    excess = problem.whole - k * problem.whole_inflation
    removed = problem.taken([c.name for c in chosen])[0]
    share = 1.0 if excess <= 0.0 else min(removed / max(excess, removed, 1e-300), 1.0)
    return float(log_p), float(share)
