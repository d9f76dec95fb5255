"""The improved robot: as it was fitted, with each effect on the channels that it is named on and nowhere else.

A fit gives every channel an amplitude; of a channel that the effect does not sit on (`channels.py`), it is what noise
and the error of the law leave there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from exodrake.core.machine import Machine
from exodrake.core.robot import Robot
from exodrake.diagnosis.isolation import Isolation, Tested
from exodrake.diagnosis.left_out import without_each_log
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import NamedEffect


def on_their_channels(machine: Machine, rows: np.ndarray, effects: Sequence[NamedEffect]) -> np.ndarray:
    """Flat vectors (..., parameters) [SI] with effects at their null values on channels that they do not sit on."""
    found = rows.copy()
    for named in effects:
        lead, sits = machine.effect(named.id).parameters[0], {"", *named.wires, *named.joints}
        at = machine.effect_indices(named.id, lead.name)
        found[..., [i for channel, i in at.items() if channel not in sits]] = lead.null
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
    problem: Problem, found: Isolation, best: Tested, effects: Sequence[NamedEffect], rows: np.ndarray
) -> list[np.ndarray]:
    """The robots that each log judges, (3, parameters) flat vectors [SI].

    `rows`, the nominal, the retuned and the improved one; without held-out logs the latter two as fitted to the others.
    """
    if problem.holdout:
        return [rows] * len(problem.holdout)
    if len(problem.fit) == 1:
        return [rows]
    retuned, improved = (without_each_log(found.likelihood, t.explanation) for t in (found.retuned, best))
    improved = on_their_channels(problem.robot.machine, improved, effects)
    return [np.array([rows[0], a, b]) for a, b in zip(retuned, improved, strict=True)]
