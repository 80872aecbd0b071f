"""Maxwell-slip blocks that follow the first loading of any law of the library.

What is built on blocks (feed-forward, observer, the replays of the diagnosis) knows every law by them. A law made of
blocks keeps its own. Of any other the virgin curve F(x) is run slowly, and chords are laid through it at the shares
`SHARES` of its limit; a concave polygon with slopes K_1 > K_2 > … and break points x_j is the virgin curve of the
blocks

    k_j = K_j − K_{j+1},   α_j = k_j x_j / F_s

(`blocks.blocks_from_segment_slopes`). The polygon lies within 6 % of the limit of an exponential approach (a test holds
it there); return branches follow Masing's rule, which Dahl, LuGre and the elasto-plastic law do not obey exactly.

Source: paper, Eqs. 3–5, applied to a curve that is computed and not measured.
"""

import numpy

from microstage_ros.model.friction.registry import law_named, run_law

# of the limit, ends of the chords: six blocks of the eight there may be
SHARES = (0.0, 0.35, 0.6, 0.78, 0.9, 0.97, 0.995)
POINTS = 4000
LONGEST = 12.0      # lengths F_s/k after which an exponential approach is there to 6 · 10⁻⁶
QUASI_STATIC = 1e-6  # s⁻¹, of that length: so slow that no damping and no speed dependence shows


def equivalent_blocks(name, values):
    """Block stiffnesses and weights of a law with these parameters.

    Parameters
    ----------
    name : name of a law in `registry.NAMES` that has a stiffness.
    values : its parameters in F and q, as `registry.FrictionLaw.pack` takes them (in the units of their specs).

    Returns
    -------
    (k [F/q], α [1]), arrays of shape (n,), n ≤ 8, Σ α = 1.

    Raises
    ------
    InputError : unknown law, or parameters that it refuses.
    """
    law = law_named(name)
    limit = float(values["static"])
    if numpy.size(values["stiffness"]) > 1 or "weight" in values:
        stiffness, weight = (numpy.atleast_1d(numpy.asarray(values[key], float)) for key in ("stiffness", "weight"))
        return stiffness, weight / weight.sum()
    length = limit / float(values["stiffness"])
    packed = law.pack({**values, "viscous": 0.0})
    reach = LONGEST * length
    velocity = numpy.full(POINTS, QUASI_STATIC * length)
    velocity[0] = 0.0
    force = run_law(law, packed, velocity, reach / POINTS / (QUASI_STATIC * length))
    way = reach / POINTS * numpy.maximum(numpy.arange(POINTS) - 0.5, 0.0)   # the first step accelerates from rest
    top = float(force[-1])
    places = numpy.interp(numpy.array(SHARES) * top, numpy.maximum.accumulate(force), way)
    slopes = numpy.diff(numpy.array(SHARES) * top) / numpy.maximum(numpy.diff(places), 1e-12 * length)
    ends, slopes = _concave(places[1:], slopes)
    stiffness = slopes - numpy.append(slopes[1:], 0.0)
    weight = stiffness * ends
    return stiffness, weight / weight.sum()


def _concave(ends, slopes):
    """The polygon with neighbouring chords merged where the second is as steep as the first (an elastic beginning)."""
    kept_ends, kept = [], []
    for end, slope in zip(ends, slopes):
        start = kept_ends[-1] if kept_ends else 0.0
        while kept and slope >= 0.999 * kept[-1]:
            before = kept_ends[-2] if len(kept_ends) > 1 else 0.0
            slope = (kept.pop() * (kept_ends.pop() - before) + slope * (end - start)) / (end - before)
            start = before
        kept_ends.append(end)
        kept.append(slope)
    return numpy.array(kept_ends), numpy.array(kept)
