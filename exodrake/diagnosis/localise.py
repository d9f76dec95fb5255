"""Localisation: the block, tendons and joints of a gap, its segments and its regime."""

from __future__ import annotations

import numpy as np

from exodrake.core.signal import JOINTS, TENDONS
from exodrake.diagnosis.fit import Fitter
from exodrake.diagnosis.problem import Problem, by_trial
from exodrake.diagnosis.regime import regime
from exodrake.diagnosis.result import NO_GAP, RETUNE, NamedEffect, Where
from exodrake.diagnosis.search import Fitted, Search
from exodrake.diagnosis.segment_shares import segment_gaps, suspects
from exodrake.diagnosis.views import View

AFFECTED = 0.5  # a channel with this share of the strongest one's residual power counts as affected


def block_shares(search: Search) -> dict[str, float]:
    """Share of each block in the gap: the part of the residual power that its best single effect removes, normalised.

    The part removed is divided by the part that remains, which favours an effect that explains nearly everything over
    one that explains half.
    """
    before = search.retuned.chi2
    best: dict[str, float] = {}
    for fitted in search.singles:
        block = fitted.point.hypothesis.effects[0].split(".")[0]
        rest = max(fitted.chi2 - 1.0, 0.02)
        best[block] = max(best.get(block, 0.0), max(before - fitted.chi2, 0.0) / rest)
    total = sum(best.values())
    return {b: v / total for b, v in sorted(best.items(), key=lambda i: -i[1])} if total else {}


def localise(problem: Problem, fitter: Fitter, search: Search, chosen: View, effects: tuple[NamedEffect, ...]) -> Where:
    """Block, channels, segments and regime of a gap.

    Args:
        problem: problem in closed loop.
        fitter: its fitter.
        search: its search; segments, regime and channels follow the retuned robot.
        chosen: the simulation that decided; its search gives the shares of the blocks.
        effects: effects that are named.
    """
    if chosen.decision.verdict in (NO_GAP, RETUNE):
        return Where(block="none")
    values = fitter.values(search.retuned.point.hypothesis, search.retuned.point.u, search.retuned.point.x)
    segments, replay = segment_gaps(problem, values, problem.holdout[0]) if separable(problem) else ({}, {})
    residuals = residuals_by_trial(problem, search.retuned)
    shares = block_shares(chosen.search)
    if effects:
        block = effects[0].id.split(".")[0]
        tendons, joints = (tuple(dict.fromkeys(c for e in effects for c in getattr(e, a))) for a in ("wires", "joints"))
    else:
        block = next(iter(shares), None) or max(segments, key=lambda s: segments[s])
        tendons, joints = (affected(problem, residuals, axis) for axis in (TENDONS, JOINTS))
    return Where(block, tendons, joints, shares, segments, replay, regime(problem, residuals))


def separable(problem: Problem) -> bool:
    """Whether measured signals cut the machine into several segments, all of whose outputs the case has."""
    outputs = {segment.output for segment in suspects(problem.robot.machine)}
    return len(outputs) > 1 and outputs <= set(problem.kinds)


def residuals_by_trial(problem: Problem, fitted: Fitted) -> dict[str, np.ndarray]:
    """Normalised residuals by trial: name -> (n, columns)."""
    trials = (*problem.fit, *problem.holdout)
    logs = (*by_trial(fitted.point.residual, problem.fit), *by_trial(fitted.held, problem.holdout))
    return {trial.name: log for trial, log in zip(trials, logs, strict=True)}


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
