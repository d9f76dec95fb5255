"""Localisation: the block, tendons and joints of a gap, its segments and its regime.

Where effects are named, a block has the shares of its effects in the gap. Otherwise the share of a block is its Shapley
value. The value of a set of blocks is the largest share that a free input in these blocks takes up by its evidence
(`free_input`): 1 - exp(-2 gain / samples), the coefficient of determination of a likelihood (Nagelkerke, Biometrika
78(3), 1991). Where no free input raises the evidence, it is what one effect in them removes by the linear model.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

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
    e = found.retuned.explanation
    outputs = {segment.output for segment in suspects(problem.robot.machine)}
    separable = len(outputs) > 1 and outputs <= set(problem.kinds)
    segments, replay = segment_gaps(problem, e.robot, problem.fit[0]) if separable else ({}, {})
    left = by_trial(problem.residual(e.robot[None], problem.fit)[0], problem.fit)
    residuals = {trial.name: log for trial, log in zip(problem.fit, left, strict=True)}
    if effects:
        shares = sum_by_block((x.id, x.share.value) for x in effects)
        block = effects[0].id.split(".")[0]
        tendons, joints = (tuple(dict.fromkeys(c for x in effects for c in getattr(x, a))) for a in ("wires", "joints"))
    elif inputs := free_courses(found.likelihood, found.lin, e):
        shares = shares_of({course.name: course.share for course in inputs})
        block = next(iter(shares))
        tendons, joints = (channels_of(problem, inputs, block, axis) for axis in (TENDONS, JOINTS))
    else:
        likelihood = found.likelihood.scaled_to(e.residual)
        cost = max(e.cost(likelihood), 1e-12)
        shares = shares_of({p.probe.effect: p.gain / cost for p in found.search.screened(e, found.lin)})
        block = next(iter(shares), None) or max(segments, key=lambda s: segments[s], default="unknown")
        tendons, joints = (affected(problem, residuals, axis) for axis in (TENDONS, JOINTS))
    return Where(block, tendons, joints, shares, segments, replay, regime(problem, residuals))


def sum_by_block(shares: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Share of each block, largest first: the sum of its effects' ones, of those that have one."""
    found: dict[str, float] = {}
    for effect, share in shares:
        block = effect.split(".")[0]
        found[block] = found.get(block, 0.0) + (max(share, 0.0) if np.isfinite(share) else 0.0)
    return dict(sorted(found.items(), key=lambda item: -item[1]))


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


def channels_of(problem: Problem, inputs: Sequence[Course], block: str, axis: str) -> tuple[str, ...]:
    """Channels of an axis on which the best free input of a block acts; none if it acts on another axis."""
    best = next((course for course in inputs if course.block == block and course.channels != WHOLE), None)
    if best is None or not set(best.channels) <= set(problem.robot.machine.axes.of(axis)):
        return ()
    covariance = np.diag(best.size**2 / (2.0 * best.count))
    return tuple(best.channels[i] for i in affected_channels(best.size, covariance))


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
