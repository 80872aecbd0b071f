"""Whether fewer causes hold as much, with another form of one of them or a rival in its place.

Forward selection takes the best cause first, and what it misfits looks like a second one: friction that grows with the
root of the speed is a viscosity and a film, and where friction that differs between directions is taken for a constant
force, what that difference does to friction along the stroke is a ripple of the motor.
"""


def fewest(selector, last, without, rivals, forms, smallest):
    """The reading with the fewest causes over which the ``last`` one does not pay.

    Parameters
    ----------
    selector : `Selector`. last, without : of `Selector.check_backward`. rivals : {id: ids}, to which those of causes
        that take another's place are added. forms : all `Candidate` there are. smallest : of `Selector.gains` [1].

    Returns
    -------
    ``last`` and ``without``, or those of the other reading.
    """
    for cause in last.model.chosen if len(last.model.chosen) > 1 else ():
        name = cause.candidate.id
        for other in forms:
            alike = other.id == name or other.id in rivals.get(name, ())
            if not alike or (other.form == cause.candidate.form and not other.shapes):
                continue
            found = _with_fewer(selector, last, cause.candidate, other, smallest)
            if found is not None:
                rivals.setdefault(other.id, [one for one in rivals.get(name, ()) if one != other.id])
                return fewest(selector, found[0], found[1], rivals, forms, smallest)
    return last, without


def _with_fewer(selector, last, candidate, other, smallest):
    """(`Stage`, {id: `Stage` without it}) with the `Candidate` ``other`` in the place of ``candidate``, if then fewer
    causes are needed that leave no more, by ``smallest`` [1]; else None."""
    for model in _others(last.model, candidate, other):
        base = selector.stage(model, selector.loop.residual(model.extended))
        for shape in other.starts():
            stage = selector.refit(selector.initial_model(base, other, shape))
            if selector.gains(last, stage, smallest):
                continue
            found = selector.check_backward(stage)
            if len(found[0].model.chosen) < len(last.model.chosen) and not selector.gains(last, found[0], smallest):
                return selector.check_backward(selector.refit(_all_free(found[0].model, last.model)))
    return None


def _others(model, candidate, other):
    """`Model` of the other causes, to which ``other`` comes in the place of ``candidate`` and of another form of
    itself: of all of them, and without each that stands for a number of the axis, which a shape might run into while
    both are fitted. Numbers of the axis that those left out stand for stay as given: what they explained, the rest have
    to."""
    model = model.without(candidate.id).without(other.id).holding(other.stands_for)
    return [model, *(model.without(cause.candidate.id) for cause in model.chosen if cause.candidate.stands_for)]


def _all_free(model, before):
    """``model`` with all numbers of the axis free for which none of its causes stands; ``before``: that with all."""
    all_keys = {key for cause in before.chosen for key in cause.candidate.stands_for} | set(before.keys)
    held = {key for cause in model.chosen for key in cause.candidate.stands_for} | set(model.keys)
    return model.freeing(sorted(all_keys - held))
