"""The fault campaign: processes of real cells killed and stopped at random while the axis moves.

A cell of each mode is kept through many faults (`fault_cell`). Time to zero volts is read from the output that driver
and watchdog share, from the last valid command on; time for which the host of the machine kept a processor from
everybody is measured beside it (`witness`) and distinguished.
"""

import random
import shutil
import tempfile
from pathlib import Path

from microstage_ros.ros.benchmarks.fault_cell import ANSWER_S, PROCESSES, SIGNALS, FaultCell
from microstage_ros.ros.benchmarks.trial_cell import PERIODS
from microstage_ros.ros.benchmarks.witness import Witness
from microstage_ros.ros.client import NoAnswer
from microstage_ros.ros.launching.cell_processes import CellFailure

BOUND_S = 5e-3
"""Zero volts so long after the last valid command, at most."""

STOP_S = 2.0
"""A cell ends so soon after it is asked to."""

LAST_STATE_S = 0.1
"""The last state in a bag is at most so old when the recorder is killed."""

IN_ONE_CELL = 25
"""So many faults at most, so that its bags stay small."""


def planned(trials, seed, modes=tuple(PERIODS)):
    """What is done: (mode, process, fault), each combination as often as the others, mode by mode.

    ``trials``: how many [1]; ``seed``: of the order and of the choice [1]; ``modes``: of `PERIODS`.
    """
    chance = random.Random(seed)
    every = [(mode, name, what) for mode in modes for name in PROCESSES for what in SIGNALS]
    every += [(mode, "bag_recorder", "disk_full") for mode in modes]
    plan = []
    while len(plan) < trials:
        chance.shuffle(every)
        plan += every
    return sorted(plan[:trials], key=lambda one: modes.index(one[0]))


def campaign(trials, seed, tell=lambda facts: None, modes=tuple(PERIODS)):
    """Random kills and stops over all processes and modes.

    Parameters
    ----------
    trials : how many [1]. seed : of the choice [1]. tell : called with the facts of each trial and of each cell's end.
    modes : of `PERIODS`.

    Returns
    -------
    trials, ends : lists of dict
        Facts of every trial, and of the end of every cell.
    """
    done, ends, chance = [], [], random.Random(seed + 1)
    with Witness() as witness:
        cell = folder = None
        in_cell = 0
        for mode, name, what in planned(trials, seed, modes):
            if cell is not None and (not cell.usable or cell.mode != mode or in_cell >= IN_ONE_CELL):
                cell = _close(cell, folder, ends, tell)
            facts = {"mode": mode, "process": name, "fault": what}
            try:
                if cell is None:
                    folder, in_cell = tempfile.mkdtemp(prefix="microstage_faults_"), 0
                    cell = FaultCell(mode, folder, chance, witness)
                    cell.start()
                facts = cell.inject(name, what)
            except (CellFailure, NoAnswer, LookupError, ProcessLookupError, TypeError) as error:
                facts["not_run"] = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
                if cell is not None:
                    cell.usable = False
            in_cell += 1
            done.append(facts)
            tell(facts)
        if cell is not None:
            _close(cell, folder, ends, tell)
        real_time = witness.real_time
    for facts in ends:
        facts["witness_in_real_time"] = real_time
    return done, ends


def _close(cell, folder, ends, tell):
    facts = cell.close()
    facts["logs"] = (
        {}
        if not facts["tracebacks"]
        else {
            name: (Path(folder) / "logs" / name).read_text(encoding="utf-8", errors="replace")[-2000:]
            for name in facts["tracebacks"]
        }
    )
    ends.append(facts)
    tell(facts)
    shutil.rmtree(folder, ignore_errors=True)


def judged(done, ends):
    """Figures of a campaign and what falls short of them.

    Parameters
    ----------
    done, ends : facts of `campaign`, one dict each, shapes (trials,) and (cells,).

    Returns
    -------
    figures : dict
    short : list of str, empty if nothing falls short.
    """
    run = [facts for facts in done if "not_run" not in facts]
    timed = [facts for facts in run if facts.get("zero_after_s") is not None]
    times = sorted(facts["zero_after_s"] for facts in timed)
    own = sorted(max(facts["zero_after_s"] - facts["kept_away_s"], 0.0) for facts in timed)
    late = [facts for facts in timed if facts["zero_after_s"] > BOUND_S]
    by_host = [facts for facts in late if facts["zero_after_s"] - facts["kept_away_s"] <= BOUND_S]
    answering = [facts for facts in run if facts["must_answer"]]
    answers = sorted(facts["answered_s"] for facts in answering if facts["answered_s"] is not None)
    moving = [facts for facts in run if not facts.get("stays", False) and "went_on" in facts]
    ages = sorted(age for facts in ends for age in facts["last_state_age_s"])
    figures = {
        "injected": len(run),
        "not_run": len(done) - len(run),
        "cells": len(ends),
        "noticed": sum(facts["noticed"] for facts in run),
        "had_to_stand_still": sum("stays" in facts for facts in run),
        "rested": sum(facts.get("stays", False) for facts in run),
        "had_to_go_on": len(moving),
        "went_on": sum(facts["went_on"] for facts in moving),
        "had_to_be_repaired": sum("repaired" in facts for facts in run),
        "repaired": sum(facts.get("repaired", False) for facts in run),
        "time_to_zero_measured": len(times),
        "time_to_zero_median_s": _median(times),
        "time_to_zero_worst_s": _worst(times),
        "time_to_zero_worst_without_the_host_s": _worst(own),
        "later_than_bound": len(late),
        "of_these_while_the_host_stopped": len(by_host),
        "actions_to_be_answered": len(answering),
        "answered_within_1s": sum(answer <= ANSWER_S for answer in answers),
        "of_these_by_the_client_itself": sum(facts.get("by_the_client", False) for facts in answering),
        "answer_median_s": _median(answers),
        "answer_worst_s": _worst(answers),
        "orphans": sum(facts["orphans"] for facts in ends),
        "stop_median_s": _median(sorted(facts["stop_s"] for facts in ends)),
        "stop_worst_s": _worst([facts["stop_s"] for facts in ends]),
        **{
            name: sum(facts[name] for facts in ends)
            for name in ("bags_whole", "bags_recovered", "bags_unreadable", "messages")
        },
        "last_state_age_worst_s": _worst(ages),
        "recorders_killed": len(ages),
        "tracebacks": sum(len(facts["tracebacks"]) for facts in ends),
    }
    short = [
        f"{figures[wanted] - figures[found]} of {figures[wanted]}: not {found.replace('_', ' ')}"
        for wanted, found in (
            ("injected", "noticed"),
            ("had_to_stand_still", "rested"),
            ("had_to_go_on", "went_on"),
            ("had_to_be_repaired", "repaired"),
            ("actions_to_be_answered", "answered_within_1s"),
        )
        if figures[found] < figures[wanted]
    ]
    if len(late) > len(by_host):
        short.append(f"{len(late) - len(by_host)} later than {BOUND_S * 1e3:g} ms at zero volts")
    for name, bound in (("stop_worst_s", STOP_S), ("last_state_age_worst_s", LAST_STATE_S)):
        if (figures[name] or 0.0) > bound:
            short.append(f"{name} {figures[name]:.3g}, at most {bound:g}")
    short += [
        f"{figures[name]} {name}" for name in ("orphans", "bags_unreadable", "not_run", "tracebacks") if figures[name]
    ]
    return figures, short


def _median(values):
    return values[len(values) // 2] if values else None


def _worst(values):
    return max(values, default=None)
