"""Kinds of motion: those that the closure was measured on, and closures on kinds that were not fitted.

Each kind of fitted motion in turn is judged by the robot fitted without the logs of that kind (`left_out`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from exodrake.data.case import Case
from exodrake.diagnosis.closure import overall
from exodrake.diagnosis.gap import Closure, Interval
from exodrake.diagnosis.improved import without_traces
from exodrake.diagnosis.isolation import Isolation, Tested
from exodrake.diagnosis.left_out import without_logs
from exodrake.diagnosis.problem import Problem


def kind_of(protocol: str) -> str:
    """Kind of a motion: its protocol without the number of a run, as `sweeps` of `sweeps_2`."""
    return re.sub(r"[-_ ]*\d+$", "", protocol) or protocol


def kinds_of_logs(case: Case) -> dict[str, str]:
    """Kind of motion of each file of a case."""
    return {item.file: kind_of(item.protocol) for item in case.logs}


def with_motions(
    closure: Closure, problem: Problem, found: Isolation, best: Tested, traces: Mapping[int, float]
) -> Closure:
    """The closure with the kinds of motion that it was measured on, and closures on each kind left out of the fit."""
    kinds = kinds_of_logs(problem.case)
    measured_on = tuple(dict.fromkeys(kinds.get(trial.name, trial.name) for trial in problem.judged))
    return replace(closure, measured_on=measured_on, motions=left_out_by_motion(problem, found, best, traces))


def left_out_by_motion(
    problem: Problem, found: Isolation, best: Tested, traces: Mapping[int, float]
) -> dict[str, Interval]:
    """Closure on each kind of fitted motion by the robot that was fitted to the others; empty for one kind alone."""
    kinds, groups = kinds_of_logs(problem.case), dict[str, list[int]]()
    for k, trial in enumerate(problem.fit):
        groups.setdefault(kinds.get(trial.name, trial.name), []).append(k)
    if len(groups) < 2 or not best.explanation.effects:
        return {}
    nominal, closures = replace(problem, detected=()).silent(), {}
    robots = without_traces(without_logs(found.likelihood, best.explanation, list(groups.values())), traces)
    for (kind, logs), robot in zip(groups.items(), robots, strict=True):
        part = replace(problem, holdout=(), fit=tuple(problem.fit[k] for k in logs))
        closures[kind] = overall(part, [np.array([nominal, robot])] * len(logs))
    return closures
