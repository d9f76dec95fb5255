"""The improved robot: the fitted robot without traces of its effects.

A fit gives every channel an amplitude. A channel that the effect does not sit on (`channels.py`) may have a smaller
amplitude, or only a trace. A trace comes from noise and the error of the law: its 90 % interval holds 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from exodrake.core.confidence import NORMAL_90
from exodrake.core.robot import Robot
from exodrake.diagnosis.intervals import Fitted
from exodrake.diagnosis.isolation import Isolation, Tested
from exodrake.diagnosis.left_out import without_each_log
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import NamedEffect


def traces_of(effects: Sequence[NamedEffect], fitted: Fitted | None) -> dict[int, float]:
    """Amplitudes of effects on channels that they do not sit on, where the 90 % interval holds 0.

    Args:
        effects: that are named.
        fitted: their parameters; None where none was fitted.

    Returns:
        Index in the flat parameter vector -> value without the effect.
    """
    found: dict[int, float] = {}
    if fitted is None:
        return found
    for named in effects:
        own, sits = fitted.of(named.id), {"", *named.wires, *named.joints}
        for p, x, std in zip(own.parameters, own.x, own.std, strict=True):
            if p.amplitude and not sits.issuperset(p.channels) and abs(x) < NORMAL_90 * std:
                found |= dict.fromkeys(p.index, p.value(0.0))
    return found


def without_traces(rows: np.ndarray, traces: Mapping[int, float]) -> np.ndarray:
    """Flat vectors (..., parameters) [SI] with other values where traces of effects were found (`traces_of`)."""
    found = rows.copy()
    found[..., list(traces)] = list(traces.values())
    return found


def robot_of(problem: Problem, values: np.ndarray, found_in: str) -> Robot:
    """The nominal robot with what a fit changed, noise and resolutions as they were.

    Args:
        problem: the case.
        values: (parameters,) flat vector of a noise-free fitted robot [SI].
        found_in: name of the case.
    """
    nominal = problem.robot
    changed = values != replace(problem, detected=()).silent()
    sources = {e.name: f"fitted to {found_in}" for e, c in zip(nominal.machine.parameters, changed, strict=True) if c}
    return replace(nominal, values=np.where(changed, values, nominal.values), sources={**nominal.sources, **sources})


def judged(
    problem: Problem, found: Isolation, best: Tested, traces: Mapping[int, float], rows: np.ndarray
) -> list[np.ndarray]:
    """The robots that each log judges, (3, parameters) flat vectors [SI].

    `rows`, the nominal, the retuned and the improved one; without held-out logs the latter two as fitted to the others.
    """
    if problem.holdout:
        return [rows] * len(problem.holdout)
    if len(problem.fit) == 1:
        return [rows]
    retuned, improved = (without_each_log(found.likelihood, t.explanation) for t in (found.retuned, best))
    return [np.array([rows[0], a, b]) for a, b in zip(retuned, without_traces(improved, traces), strict=True)]
