"""A payload, a soft drive or both: which of these the resonance and the torque balance together allow."""

import math

from microstage_ros.diagnosis.catalogue.drive import INERTIA
from microstage_ros.diagnosis.residuals.evidence_set import Choice, Evidences
from microstage_ros.diagnosis.selection.agreement import LEADING_ODDS, log_odds, size_beyond_baseline
from microstage_ros.diagnosis.selection.sizes import CAUTION, LEAST_MASS_SHARE, sizes_of

RESONANT = ("payload_change", "drive_compliance")
FAST = ("resonance", "windup")      # channels in which they are one another's shape
# share of a soft drive's gain in resonance and wind-up from which a payload explains them as well: the drive would have
# lost its damping in the proportion of its stiffness; and share below which it is none; calibrated by: microstage
# campaign --world second --kind single --effect payload_change and drive_compliance, the latter with --strength 0.07
# too, where the damping stayed (no name of the other)
ALIKE, UNLIKE = 0.9, 0.5
# ratio of two masses down to which they are one, and down to which a mass in the torque leaves it open whether the
# drive is soft; calibrated by: microstage campaign --world second --kind single --seed 2103, case 4 (5.3 kg more, of
# which the torque balance told two fifths)
ALIKE_MASS, LEAST_ALIKE = 0.4, 0.25
DECISIVE = 4.0   # standard errors; derived: a chance of 6·10⁻⁵ on both sides
CONFIRMED = 3.0       # standard errors of either of two that must agree, or of their difference; derived: 1.3·10⁻³


def behind_gap(evidences):
    """Whether the records are of a stage behind a gap, where no resonance is judged and the gap's own error is in the
    deflection."""
    return "windup" in evidences.learn and "resonance" not in evidences.learn


def mass_of_inertia(evidences, others):
    """Masses [kg], and their standard errors, that the load on the guideways and the stage's inertia tell in the torque
    balance beside ``others``: two (mass, error), or None where it was not asked (`inertia_form`).

    What is no mass shows in one of them only, or as two masses.
    """
    torque = evidences.learn.get("torque")
    keys = [("payload_change", ""), (INERTIA, "")]
    if torque is None or any(not any(form.key == key for form in evidences.forms) for key in keys):
        return None
    beta, covariance, _ = torque.fit([*Evidences._keys("torque", others), *keys])
    covariance = covariance[-2:, -2:] * evidences.scatter["torque"] * CAUTION["torque"] ** 2
    mass = evidences.frame.drive.mass
    return ((mass * float(beta[-2]), mass * math.sqrt(covariance[0, 0])),
            (mass * float(beta[-2] + beta[-1]), mass * math.sqrt(covariance.sum())))


def mass_confirmed(evidences, others):
    """Whether the load on the guideways and the stage's inertia each tell a mass in the torque balance beside
    ``others``, and the same one."""
    two = mass_of_inertia(evidences, others)
    return two is not None and all(abs(mass) > CONFIRMED * error for mass, error in two) and alike(two[0][0], two[1][0])


def stiffness_agrees(evidences, choice, others):
    """Whether the wind-up allows the stiffness that the resonance of a ``choice`` of ``drive_compliance`` tells: within
    their errors, or with as much more compliance, 1/K_c, as `alike` allows."""
    fast = next((f for f in choice.forms if f.channel == "resonance"), None)
    slow = next((f for f in evidences.forms if f.effect == choice.effect and f.channel == "windup"), None)
    if fast is None or slow is None or "windup" not in evidences.learn:
        return True
    both = [sizes_of(evidences, choice, others, form)[0]["stiffness_factor"][:2] for form in (fast, slow)]
    (quick, quick_error), (held, held_error) = both
    near = abs(math.log(quick / held)) < CONFIRMED * math.hypot(quick_error / quick, held_error / held)
    return near or quick != 1.0 and alike(1.0 / held - 1.0, 1.0 / quick - 1.0)


def payload_on_another_drive(evidences, choice, others):
    """`Choice` of the payload that the torque balance tells where the ``choice`` of ``drive_compliance`` is another
    drive train, too; else None."""
    left = _stiffness_beside_mass(evidences, choice, others)
    if left is None or left[0] <= left[2] and left[1] >= -left[2]:
        return None
    return Choice("payload_change", (_torque_form(evidences),))


def _stiffness_beside_mass(evidences, choice, others):
    """What is left of the stiffness of a ``choice`` of ``drive_compliance`` beside the mass that the torque balance
    tells: the least and the most of ln K_c by resonance or wind-up, and by load and inertia, each alone and both, and
    `DECISIVE` standard errors [1]; None where the balance tells none.

    Of a mass M on a stage m, resonance and wind-up tell K_c m/(m + M).
    """
    form = _torque_form(evidences)
    if form is None or behind_gap(evidences) or not mass_confirmed(evidences, others):
        return None
    own = evidences.frame.drive.mass
    mass, error, _ = sizes_of(evidences, Choice("payload_change", (form,)), others, form)[0]["mass_kg"]
    seeming = _seeming(evidences, choice, others)
    if not seeming or abs(mass) < DECISIVE * error:
        return None
    masses = (mass, *(value for value, _ in mass_of_inertia(evidences, others)))
    wholes = [max(own + value, LEAST_MASS_SHARE * own) / own for value in masses]
    logs = [math.log(factor * whole) for factor, _ in seeming for whole in wholes]
    unsure = max(stderr / factor for factor, stderr in seeming)
    return min(logs), max(logs), DECISIVE * math.hypot(unsure, error / (own + mass))


def seeming_stiffness(evidences, choice, others):
    """Factor [1] on the drive train's stiffness, and its standard error, that resonance or wind-up of a ``choice`` of
    one of `RESONANT` tell, whichever is surer; None where it has neither. A mass M on a stage m seems to be one of
    m/(m + M)."""
    return min(_seeming(evidences, choice, others), key=lambda size: size[1] / size[0], default=None)


def _seeming(evidences, choice, others):
    """`seeming_stiffness` of each of the two channels: [(factor, standard error)] [1]."""
    own, found = evidences.frame.drive.mass, []
    for form in (form for form in choice.forms if form.channel in FAST):
        sizes = sizes_of(evidences, choice, others, form)[0]
        if "mass_kg" in sizes:
            mass, error, _ = sizes["mass_kg"]
            whole = max(own + mass, LEAST_MASS_SHARE * own)
            found.append((own / whole, own * error / whole**2))
        else:
            found.append(sizes["stiffness_factor"][:2])
    return found


def stiffness_of(evidences, choices):
    """Factor [1] on the stiffness of the drive train that ``choices`` have, 1 without a ``drive_compliance``."""
    drive = next((c for c in choices if c.effect == "drive_compliance"), None)
    return 1.0 if drive is None else (seeming_stiffness(evidences, drive, choices) or (1.0,))[0]


def _torque_form(evidences):
    """`Form` of ``payload_change`` in the torque, or None where there is no torque."""
    if "torque" not in evidences.learn:
        return None
    return next((f for f in evidences.forms if f.effect == "payload_change" and f.channel == "torque"), None)


def shown_by_rattle(evidences, choice):
    """Whether a rattle in a gap tells a payload, too: then what else is left in the torque is no matter of it."""
    return choice.effect == "payload_change" and evidences.frame.rattled_mass != 0.0


def alike(mass, other):
    """Whether two channels tell of one mass, where they tell ``mass`` and ``other`` [kg], not 0; or of one size of any
    unit."""
    return ALIKE_MASS < mass / other < 1.0 / ALIKE_MASS


def torque_mass(evidences, choice, others):
    """Mass [kg] that the torque balance tells beside ``others``, its standard error, and the one that the resonance or
    the wind-up of ``choice`` (a `Choice` of ``payload_change``) tells; None where a channel is missing."""
    form = _torque_form(evidences)
    fast = [f for f in choice.forms if f.channel in FAST]
    if form is None or not fast:
        return None
    mass, stderr, _ = sizes_of(evidences, choice, others, form)[0]["mass_kg"]
    from_torque = min((sizes_of(evidences, choice, others, f)[0]["mass_kg"] for f in fast), key=lambda size: size[1])
    return mass, stderr, from_torque[0], from_torque[1]


def resonance_is(evidences, trials, others):
    """Which of `RESONANT` it is: an effect's id, ``"open"`` where the records cannot tell, None where they need not.

    ``trials``: {effect: `Trial` or None}.
    """
    payload, drive = trials["payload_change"], trials["drive_compliance"]
    if payload is None or drive is None or behind_gap(evidences):
        return None
    gains = [
        sum(
            evidences.channel_gain(ch, [*others, t.choice]) - evidences.channel_gain(ch, others)
            for ch in FAST
            if ch in evidences.learn
        )
        for t in (payload, drive)
    ]
    if gains[0] < UNLIKE * gains[1]:     # a damping that does not follow the stiffness: no mass does that
        return "drive_compliance"
    left = _stiffness_beside_mass(evidences, drive.choice, others)
    if left is not None and left[0] <= left[2] and left[1] >= -left[2]:
        return "payload_change"      # all of the resonance is the mass's
    if gains[0] < ALIKE * gains[1]:
        return "open" if _mass_of_a_soft_drive(evidences, drive.choice, others) else "drive_compliance"
    from_torque = torque_mass(evidences, payload.choice, others)
    if from_torque is None:
        return "open"
    mass, stderr, expected, _ = from_torque
    # a torque balance that tells no mass, on a machine of another friction law, excludes none
    decided = abs(mass) > DECISIVE * stderr and alike(mass, expected)
    return "payload_change" if decided or mass_beyond_baseline(evidences, payload.choice, others) else "open"


def mass_beyond_baseline(evidences, choice, others):
    """Whether the torque balance tells the mass of the resonance, and not none, beyond what the baseline shows of it.

    On a machine of another friction law the balance of every record shows a mass of some kilograms that is not there,
    of either sign; the records and the baseline differ by the payload.
    """
    masses = torque_mass(evidences, choice, others)
    if masses is None or not evidences.base:
        return False
    mass, _, expected, error = masses
    form = next(f for f in evidences.forms if f.effect == "payload_change" and f.channel == "torque")
    more = size_beyond_baseline(evidences, Choice("payload_change", (form,)), others)
    if more is None:
        return False
    share, stderr = mass * more[0] / expected, math.hypot(mass * more[1], error) / abs(expected)
    return log_odds((share - 0.5, stderr, more[2])) > LEADING_ODDS


def _mass_of_a_soft_drive(evidences, choice, others):
    """Whether the torque balance is sure of a mass, and of the one that the resonance of this soft drive stands for.

    K_c times k moves the resonance as a mass of m/k; a soft drive shows no inertia in the torque.
    """
    form = _torque_form(evidences)
    fast = next((f for f in choice.forms if f.channel == "resonance"), None)
    if form is None or fast is None:
        return False
    soft, _, _ = sizes_of(evidences, choice, others, fast)[0]["stiffness_factor"]
    mass, stderr, _ = sizes_of(evidences, Choice("payload_change", (form,)), others, form)[0]["mass_kg"]
    expected = evidences.frame.drive.mass * (1.0 / soft - 1.0)
    return bool(mass > DECISIVE * stderr and LEAST_ALIKE * expected < mass < expected / ALIKE_MASS)
