"""Localisation: the block, tendons and joints of a gap, its segments and its regime.

The share of a block is its Shapley value. The value of a set of blocks is the largest share of the whitened sum of
squares that one effect in these blocks removes beyond retuning. Where no effect is named, it is the share that a free
input of the block takes up by its evidence (`free_input`): 1 - exp(-2 gain / samples), the coefficient of determination
of a likelihood (Nagelkerke, Biometrika 78(3), 1991).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from exodrake.core.signal import JOINTS, TENDONS
from exodrake.diagnosis.channels import affected_channels
from exodrake.diagnosis.free_input import WHOLE, Course, free_courses
from exodrake.diagnosis.gap import Where
from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.problem import Problem, by_trial
from exodrake.diagnosis.regime import regime
from exodrake.diagnosis.result import NO_GAP, RETUNE, NamedEffect
from exodrake.diagnosis.segment_shares import segment_gaps, shapley, subsets, suspects

AFFECTED = 0.5  # a channel with this share of the strongest one's residual power counts as affected


def block_shares(found: Isolation) -> dict[str, float]:
    """Shapley share of each block, largest first; fitted effects count as fitted, the others as linearised."""
    likelihood = found.tests.likelihood
    before = found.retuned.explanation.cost(likelihood)
    cost = {p.probes[0].effect: p.cost for p in found.screened}
    base = max(cost.values(), default=before)
    gain = {effect: 1.0 - c / max(base, 1e-12) for effect, c in cost.items()}
    for tested in found.tested[0] if found.tested else ():
        e = tested.explanation
        gain[e.effects[0]] = 1.0 - e.cost(likelihood) / max(before, 1e-12)
    return shares_of(gain)


def shares_of(gain: Mapping[str, float]) -> dict[str, float]:
    """Shapley share of each block, largest first, from what each effect or free input removes alone."""
    best: dict[str, float] = {}
    for name, value in gain.items():
        block = name.split(".")[0]
        best[block] = max(best.get(block, 0.0), value)
    if not any(best.values()):
        return {}
    removed = {play: 1.0 - max((best[b] for b in play), default=0.0) for play in subsets(best)}
    return dict(sorted(shapley(removed).items(), key=lambda item: -item[1]))


def localise(problem: Problem, found: Isolation, verdict: str, effects: tuple[NamedEffect, ...]) -> Where:
    """Block, channels, segments and regime of a gap, from the fitted logs; the latter two follow the retuned robot.

    Args:
        problem: problem in closed loop.
        found: what the isolation tried.
        verdict: its word.
        effects: effects that are named.
    """
    if verdict in (NO_GAP, RETUNE):
        return Where(block="none")
    values = found.retuned.explanation.robot
    segments, replay = segment_gaps(problem, values, problem.fit[0]) if separable(problem) else ({}, {})
    left = by_trial(problem.residual(values[None], problem.fit)[0], problem.fit)
    residuals = {trial.name: log for trial, log in zip(problem.fit, left, strict=True)}
    if effects:
        shares, block = block_shares(found), effects[0].id.split(".")[0]
        tendons, joints = (tuple(dict.fromkeys(c for e in effects for c in getattr(e, a))) for a in ("wires", "joints"))
    elif inputs := free_courses(found.likelihood, found.beside_retuned, found.retuned.explanation):
        shares = shares_of({course.name: course.share for course in inputs})
        block = next(iter(shares))
        tendons, joints = (channels_of(problem, inputs, block, axis) for axis in (TENDONS, JOINTS))
    else:
        shares = block_shares(found)
        block = next(iter(shares), None) or max(segments, key=lambda s: segments[s], default="unknown")
        tendons, joints = (affected(problem, residuals, axis) for axis in (TENDONS, JOINTS))
    return Where(block, tendons, joints, shares, segments, replay, regime(problem, residuals))


def channels_of(problem: Problem, inputs: Sequence[Course], block: str, axis: str) -> tuple[str, ...]:
    """Channels of an axis on which the best free input of a block acts; none if it acts on another axis."""
    best = next((course for course in inputs if course.block == block and course.channels != WHOLE), None)
    if best is None or not set(best.channels) <= set(problem.robot.machine.axes.of(axis)):
        return ()
    covariance = np.diag(best.size**2 / (2.0 * best.count))
    return tuple(best.channels[i] for i in affected_channels(best.size, covariance))


def separable(problem: Problem) -> bool:
    """Whether measured signals cut the machine into several segments, all of whose outputs the case has."""
    outputs = {segment.output for segment in suspects(problem.robot.machine)}
    return len(outputs) > 1 and outputs <= set(problem.kinds)


def affected(problem: Problem, residuals: dict[str, np.ndarray], axis: str) -> tuple[str, ...]:
    """Channels of an axis whose signals hold most of the residual power."""
    power = dict.fromkeys(problem.robot.machine.axes.of(axis), 0.0)
    for rows in residuals.values():
        for i, column in enumerate(problem.columns):
            channel = column.rsplit("_", 1)[1]
            if channel in power:
                power[channel] += float(rows[:, i] @ rows[:, i])
    strongest = max(power.values(), default=0.0)
    return tuple(channel for channel, p in power.items() if p >= AFFECTED * strongest)
