"""The figures asked of the self-tuning laws, and what a comparison found: one table to sign.

Nothing is measured here; every figure is read off the result of `control.evaluation.comparison.compare`. A figure that
misses what was asked says so in its cell.
"""

import math

LAWS = ("self_tuning", "self_tuning_feedforward", "self_tuning_observer")
OBSERVER = "self_tuning_observer"
SLOW = 15e-9  # m, slow sines from loaded contacts
SINE, FOUR_S, BIAS, INSTRUMENT, REST = 40e-9, 25e-9, 10e-9, 90e-9, 50e-9  # m
SETTLING = {1e-6: 0.15, 1e-5: 0.15, 1e-4: 0.15, 1e-3: 0.35}  # s, median, by distance [m]
OVERSHOOT_SHARE, OVERSHOOT = 0.05, 50e-9  # of the move, or m, whichever is larger
WITHIN = 2.0  # times nominal, under stress
HELD = 2e-6  # m, peak beyond which a loop is not called stable: the gap of the stress set is 2.8e-6 m
TENTH = 1.10  # third move from a tenth of the gains, over the best fixed PID
FRICTION, LEVEL, LEVEL_TIME = 0.03, 0.02, 2.0  # rms, error, s


def floors_table(result):
    """(title, header, rows, remark) of what was asked and reached, one column per self-tuning law of ``result``."""
    laws = [kind for kind in LAWS if kind in result["controllers"]]
    rows = [
        _row("sine of 10 µm at 0.03 Hz, worst peak (nm)", laws, SINE, lambda k: result["tracking"][k]["worst"], 1e9),
        _sines_row(result, laws),
        *_move_rows(result["positioning"], laws),
        _row("at rest for 10 s, peak to peak (nm)", laws, REST, lambda k: result["rest"][k], 1e9),
        *_stress_rows(result["stress"], laws),
        *_tenth_rows(result["weak_start"], laws),
        *_observer_rows(result, laws),
    ]
    return (
        "What was asked, and what was reached",
        ["figure", "asked", *laws],
        rows,
        (
            "Worst of the seeds unless it says median; true position unless it says interferometer. no: misses what was"
            " asked; the tables below tell by how much, and what limits it. A condition counts as stable if the peak of"
            " the sine stays below 2 µm."
        ),
    )


def _row(name, laws, most, figure, scale, digits=3):
    """A row whose figures may be at most ``most``; both times ``scale`` for a reader."""
    return [name, f"≤ {scale * most:g}", *(_figure_in_words(figure(kind), most, scale, digits) for kind in laws)]


def _figure_in_words(value, most, scale, digits=3):
    if not math.isfinite(value):
        return "never (no)"
    return f"{scale * value:.{digits}g}" + ("" if value <= most else " (no)")


def _count(good, of):
    """How many of ``of`` are good, for a cell."""
    return f"{good} of {of}" + ("" if good == of else " (no)")


def _sines_row(result, laws):
    sines = result["sines"]

    def cell(kind):
        if not sines or kind not in sines[0]["peak"]:
            return "–"
        return _count(sum(s["peak"][kind] <= s["peak"]["best_pid"] for s in sines), len(sines))

    return [
        "sines no worse than the PID searched for that very sine",
        f"{len(sines)} of {len(sines)}",
        *map(cell, laws),
    ]


def _move_rows(positioning, laws):
    def worst(key):
        return lambda kind: max(abs(f[key]) for f in positioning[kind].values())

    yield _row("moves, true position, 4s (nm)", laws, FOUR_S, worst("four_s_worst"), 1e9)
    yield _row("moves, bias (nm)", laws, BIAS, worst("bias_worst"), 1e9, 2)
    yield _row("moves, interferometer, 4s (nm)", laws, INSTRUMENT, worst("instrument_four_s_worst"), 1e9)
    for most in sorted(set(SETTLING.values())):
        distances = [d for d in next(iter(positioning.values())) if SETTLING.get(d) == most]
        if distances:
            name = f"moves of {', '.join(f'{d * 1e6:g}' for d in distances)} µm, settled, median (ms)"
            yield _row(
                name,
                laws,
                most,
                lambda kind, these=distances: max(positioning[kind][d]["settling_median"] for d in these),
                1e3,
            )

    def overshoot(kind):
        return max(f["overshoot_worst"] / max(OVERSHOOT, OVERSHOOT_SHARE * d) for d, f in positioning[kind].items())

    yield _row("moves, overshoot over what is allowed (5 % or 50 nm)", laws, 1.0, overshoot, 1.0, 2)


def _stress_rows(stress, laws):
    names = [name for name in stress if name != "nominal"]

    def counted(good):
        return [
            f"{len(names)} of {len(names)}",
            *(_count(sum(good(stress[n][kind], stress["nominal"][kind]) for n in names), len(names)) for kind in laws),
        ]

    yield ["stress: stable", *counted(lambda f, nominal: f["peak"] < HELD and f["learned_peak"] < HELD)]
    for key, words in (
        ("peak", "sine, first cycle"),
        ("learned_peak", "sine, third cycle"),
        ("four_s_worst", "moves of 10 µm, 4s"),
    ):
        yield [f"stress: {words}, within twice nominal", *counted(lambda f, nominal: f[key] <= WITHIN * nominal[key])]
    yield [
        f"stress: sine, first cycle, within twice {1e9 * SINE:g} nm",
        *counted(lambda f, nominal: f["peak"] <= WITHIN * SINE),
    ]
    yield [
        f"stress: moves of 10 µm, 4s, within twice {1e9 * FOUR_S:g} nm",
        *counted(lambda f, nominal: f["four_s_worst"] <= WITHIN * FOUR_S),
    ]


def _tenth_rows(found, laws):
    for yardstick, words in (
        ("guarded_pid", "the best PID with 30° and 6 dB"),
        ("kept_pid", "the best PID that keeps the figures of moves"),
        ("best_pid", "the PID searched for these moves alone"),
    ):
        yield _row(
            f"from a tenth of the gains, third move over {words}",
            laws,
            TENTH,
            lambda k, y=yardstick: found[k][2] / found[y][2],
            1.0,
        )


def _observer_rows(result, laws):
    """The friction observer's figures, in its own law's column."""
    jumps, slow = result["level_jumps"], result["slow_sines"]
    cold, warm = (max(row["worst"] for row in slow if row["after"] is after) for after in (False, True))
    figures = (
        ("slow sines of 10 µm with loaded contacts, from the start (nm)", SLOW, cold, 1e9),
        ("the same after a move of 1 mm and back (nm)", SLOW, warm, 1e9),
        ("friction estimate, rms (%)", FRICTION, max(f["total"] for f in result["observer"].values()), 100.0),
        ("friction 15 % up or down, seen to 2 % after (s)", LEVEL_TIME, max(f["seen"] for f in jumps), 1.0),
        ("its level 2 to 4 s later, mean error (%)", LEVEL, max(f["mean"] for f in jumps), 100.0),
    )
    for name, most, value, scale in figures:
        cell = _figure_in_words(value, most, scale, 3 if scale == 1e9 else 2)
        yield [name, f"≤ {scale * most:g}", *(cell if kind == OBSERVER else "–" for kind in laws)]
