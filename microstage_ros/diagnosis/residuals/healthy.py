"""What the healthy axis does that the model does not: taken from the baseline into the model.

A friction law is never the machine's own. Where the machine follows another one (LuGre's, Leuven's), or where its
friction has a profile along the stroke, the torque balance of every record shows it, the baseline's included, as what
looks like creep, mass, viscosity or a worn place. What of this the baseline shows again and again is no fault: it is
fitted there and taken out of the balance of all records, so that what is under test is judged against the healthy axis.

Forms are taken forward; one is taken if sizes from three quarters of the baseline's pieces say something of
the last quarter, each in turn (four-fold cross-validation), beyond the scatter between pieces.
"""

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import t as student

from microstage_ros.diagnosis.catalogue.form import Form, splines
from microstage_ros.diagnosis.residuals.evidence_set import factor

#: Effects that depend on rest, speed and acceleration alone: the same on every part of the stroke, at any time.
KINDS = ("rising_static_friction", "presliding_creep", "frictional_lag", "nonlinear_viscous", "payload_change",
         "friction_level_change", "viscous_change", "generic:velocity")
# s; derived: twice the time for which sticking blocks are remembered (`mechanical.STUCK_TIME`), so that pieces are
# independent
PIECE = 1.0
FOLDS = 4         # derived: three quarters of a baseline of half a minute are as long as a short record
MOST = 4          # derived: rest, speed, acceleration, and one more
# derived: that a machine that the model describes gets any form; shared by them (Bonferroni's inequality)
CHANCE = 0.01
# of the random friction's travel length between the knots of its profile; derived: a wave half as long as that length,
# which still keeps to its place, then has five knots in two periods
KNOTS = 0.2
# derived: the inner products of a baseline of thirty pieces then fill 38 MB. Where hardly any of the random friction is
# bound to a place its travel length is undetermined, and may come out at nanometres
MOST_SPLINES = 400
LARGEST = 25.0    # χ² of a row in the likelihood; derived: five standard deviations, beyond which a row is no noise
# of the random friction's variance, where the search ends; derived: a thirtieth of its standard deviation, which adds a
# thousandth to any other part
LEAST_LEFT = 1.0e-3
HALF = 0.5        # of sizes from other pieces; derived: with less of them χ² grows
RIDGE = 1.0e-6    # relative; derived: of the order of a column's rounding, it parts columns that one baseline does not
TINY = np.finfo(float).tiny


def take_healthy(channels, baseline, forms, frame, spreads):
    """Fit forms to the baseline's torque balance, and take them out of every record's.

    Parameters
    ----------
    channels : `Mechanical` of all records, the baseline's among them; their residuals are changed.
    baseline : those of the healthy axis.
    forms : those that may be taken, as `laws_of` or `profile_of` give them.
    frame : `Frame` of the case.
    spreads : `Spreads` of the random friction.

    Returns
    -------
    [(form, sizes)] that were taken out; [] where the model leaves nothing that repeats.
    """
    pieces, where = _pieces(baseline, forms, frame, spreads)
    chosen = _chosen(pieces, where, forms)
    sizes = _fit(pieces.sum(axis=0), chosen, where)
    if not chosen:
        return []
    for channel in channels:
        if not any(channel is one for one in baseline):
            channel.take_out(_torque(channel, chosen, sizes, frame))
    _take_from_baseline(baseline, pieces, where, chosen, frame)
    return list(zip(chosen, sizes))


def _torque(channel, forms, sizes, frame):
    """Torque (blocks,) [N m] of forms with their sizes."""
    return sum(form.columns(channel, frame) @ own for form, own in zip(forms, sizes))


def _take_from_baseline(baseline, pieces, where, chosen, frame):
    """Take the forms out of every fourth piece of the baseline with sizes from the other three.

    What is left of the baseline is the yardstick for what the records may show on a healthy axis. Sizes fitted to the
    very rows that they are taken from leave less there than on any other record.
    """
    part = np.arange(len(pieces)) % FOLDS
    sizes = [_fit(pieces[part != k].sum(axis=0), chosen, where) for k in range(FOLDS)]
    first = 0
    for channel in baseline:
        ends = _ends(channel)
        mine = np.repeat(part[first:first + len(ends)], np.diff([0, *ends]))
        columns = [form.columns(channel, frame) for form in chosen]
        torque = np.zeros(len(mine))
        for k in np.unique(mine):
            torque[mine == k] = sum(c[mine == k] @ own for c, own in zip(columns, sizes[k]))
        channel.take_out(torque)
        first += len(ends)


def laws_of(forms):
    """Those of the catalogue's forms by which friction laws differ: `KINDS` in the torque."""
    return [form for form in forms if form.channel == "torque" and form.effect in KINDS]


def profile_of(frame, spreads):
    """`Form` of friction × splines of x, as fine as the random friction (at most `MOST_SPLINES`), with its size as
    prior."""
    def columns(channel, frame):
        return channel.friction[:, None] * _along_stroke(channel, frame, spreads)

    return Form("position_dependent_friction", "torque", "healthy", columns, prior=spreads.relative)


def _along_stroke(channel, frame, spreads):
    """Splines (blocks, k) of the stage's place in a record, as fine as the random friction."""
    count = round((frame.high - frame.low) / (KNOTS * spreads.travel_length))
    return splines(channel.place, frame.low, frame.high, min(max(count, 2), MOST_SPLINES))


def rescale_random_friction(channels, baseline, frame, spreads):
    """Tell every torque balance how much of the friction along the stroke is still random where it goes.

    Once its profile is taken out, of the variance σ² [1] that goes with travel there is left, at a place x with splines
    b (k,),

        σ² (l + (1 − l) u),   u = b' C b / (σ_p² b' b),

    with C (k, k) the covariance of the profile's sizes that the baseline leaves, σ_p their prior, and l what of the
    random friction does not repeat at its place, by maximum likelihood of the baseline, freed of the profile by other
    pieces of it. Where the baseline was not, u is one, and the friction is as random as it was.

    Parameters
    ----------
    channels, baseline, frame, spreads : as in `take_healthy`, which took out the form `profile_of`; ``random`` of all
        ``channels`` is changed.
    """
    bases = [_along_stroke(channel, frame, spreads) for channel in channels]
    precision = np.eye(bases[0].shape[1]) / spreads.relative**2
    for channel, basis in zip(channels, bases):
        if any(channel is one for one in baseline):
            white = channel.whiten(channel.friction[:, None] * basis, spreads)[0]
            precision += white.T @ white
    covariance = np.linalg.inv(precision)
    prior = [spreads.relative**2 * (b * b).sum(axis=1) for b in bases]
    unknown = [np.clip(((b @ covariance) * b).sum(axis=1) / most, 0.0, 1.0) for b, most in zip(bases, prior)]

    def leave(left):
        for channel, share in zip(channels, unknown):
            channel.random = np.sqrt(left + (1.0 - left) * share)

    def cost(log_left):
        leave(np.exp(log_left))
        total = 0.0
        for channel in baseline:
            out, determinant = channel.whiten(channel.residual[:, None], spreads)
            total += np.minimum(out[:, 0] ** 2, LARGEST).sum() + determinant
        return total

    leave(float(np.exp(minimize_scalar(cost, bounds=(np.log(LEAST_LEFT), 0.0), method="bounded").x)))


def unevenness(baseline, taken, frame):
    """Relative standard deviation of the friction along the stroke by the profile that was taken; 0 without one.

    ``baseline``: its `Mechanical`; ``taken``: what `take_healthy` returned for `profile_of`, (`Form`, sizes) each.
    """
    factors = [
        (form.columns(channel, frame) @ sizes)[moving] / channel.friction[moving]
        for form, sizes in taken
        for channel in baseline
        for moving in [np.abs(channel.friction) > 0.5 * np.abs(channel.friction).max()]
    ]
    return float(np.std(np.concatenate(factors))) if factors else 0.0


def _pieces(baseline, forms, frame, spreads):
    """Inner products (pieces, 1 + k, 1 + k) of the whitened residual and all columns, and {form key: slice}."""
    found, where = [], {}
    for channel in baseline:
        every = [form.columns(channel, frame) for form in forms]
        ends = np.cumsum([1, *(columns.shape[1] for columns in every)])
        where = {form.key: slice(a, b) for form, a, b in zip(forms, ends, ends[1:])}
        white = channel.whiten(np.concatenate([channel.residual[:, None], *every], axis=1), spreads)[0]
        found += [part.T @ part for part in np.split(white, _ends(channel)[:-1])]
    return np.array(found), where


def _ends(channel):
    """Row after the last one of every piece of `PIECE` of a channel, at least `FOLDS` of them."""
    rows = len(channel.residual)
    count = max(round(PIECE / float(channel.time[1] - channel.time[0])), 1)
    return np.cumsum([len(part) for part in np.array_split(np.empty(rows), max(rows // count, FOLDS))])


def _fit(matrix, forms, where):
    """Sizes of these forms, each (k,), by least squares with their priors."""
    if not forms:
        return []
    index = np.concatenate([np.arange(where[f.key].start, where[f.key].stop) for f in forms])
    priors = [np.full(where[f.key].stop - where[f.key].start, f.prior or np.inf) for f in forms]
    precision = np.concatenate(priors) ** -2.0
    a = matrix[np.ix_(index, index)]
    scale = np.sqrt(np.maximum(np.diag(a) + precision, TINY))
    scaled = (a + np.diag(precision)) / np.outer(scale, scale) + RIDGE * np.eye(len(index))
    beta = np.linalg.solve(scaled, matrix[index, 0] / scale) / scale
    return np.split(beta, np.cumsum([where[f.key].stop - where[f.key].start for f in forms])[:-1])


def _agreement(pieces, forms, before, where):
    """How pieces (n,) agree with what ``forms`` say beyond the forms ``before``, by sizes from the other folds.

    Returns
    -------
    (u, d), each (n,): inner products of the difference of the two fits with what the second leaves, and with itself.
    """
    found, fold = np.zeros((2, len(pieces))), np.arange(len(pieces)) % FOLDS
    index = np.concatenate([np.arange(where[f.key].start, where[f.key].stop) for f in forms])
    for k in range(FOLDS):
        taught = pieces[fold != k].sum(axis=0)
        new, old = (np.concatenate([np.zeros(0), *_fit(taught, some, where)]) for some in (forms, before))
        old = np.append(old, np.zeros(len(new) - len(old)))
        for number in np.flatnonzero(fold == k):
            inner = pieces[number][np.ix_(index, index)]
            found[0, number] = (pieces[number][0, index] - inner @ old) @ (new - old)
            found[1, number] = (new - old) @ inner @ (new - old)
    return found


def _chosen(pieces, where, forms):
    """The forms that stand, forward, one of an effect."""
    chosen, left = [], list(forms)
    while left and len(chosen) < MOST:
        trials = [(_agreement(pieces, [*chosen, form], chosen, where), form) for form in left]
        (u, d), form = max(trials, key=lambda trial: (2.0 * trial[0][0] - trial[0][1]).sum())
        size, stderr, freedom = factor(u, d)
        if size < HALF or student.sf(size / stderr, freedom) > CHANCE / len(forms):
            break
        chosen = [*chosen, form]
        left = [other for other in left if other.effect != form.effect]
    return chosen
