"""Where: the block, wires and joints of a gap."""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.fit import Fitter
from exodrake.diagnosis.problem import Problem, by_trial
from exodrake.diagnosis.regime import regime
from exodrake.diagnosis.replay import segment_gaps
from exodrake.diagnosis.result import NO_GAP, RETUNE, NamedEffect, Where
from exodrake.diagnosis.search import Fitted, Search
from exodrake.diagnosis.views import View

TRACED = 0.5  # a wire or joint with this share of the strongest one's residual counts as affected


def block_shares(search: Search) -> dict[str, float]:
    """Share of each block in the gap: how much of the residual power its best single effect removes, normalised.

    Powers enter with an exponent that favours what explains nearly all of it over what explains half.
    """
    before = search.retuned.chi2
    best: dict[str, float] = {}
    for fitted in (*search.singles,):
        block = fitted.point.hypothesis.effects[0].split(".")[0]
        left = max(fitted.chi2 - 1.0, 0.02)
        best[block] = max(best.get(block, 0.0), max(before - fitted.chi2, 0.0) / left)
    total = sum(best.values())
    return {b: v / total for b, v in sorted(best.items(), key=lambda i: -i[1])} if total else {}


def place(problem: Problem, fitter: Fitter, search: Search, chosen: View, effects: tuple[NamedEffect, ...]) -> Where:
    """Block, channels, Shapley shares of the segments, replay gaps and regime of a closed-loop search; the shares of
    the blocks follow the chosen view.
    """
    if chosen.decision.verdict in (NO_GAP, RETUNE):
        return Where(block="none")
    values = fitter.values(search.retuned.point.hypothesis, search.retuned.point.u, search.retuned.point.x)
    segments, replay = segment_gaps(problem, values, problem.holdout[0]) if several(problem) else ({}, {})
    residuals = split(problem, search.retuned)
    shares = block_shares(chosen.search)
    block = (
        effects[0].id.split(".")[0] if effects else next(iter(shares), None) or max(segments, key=lambda s: segments[s])
    )
    wires = tuple(dict.fromkeys(w for e in effects for w in e.wires)) or (
        () if effects else traced(problem, residuals, "tendons")
    )
    joints = tuple(dict.fromkeys(j for e in effects for j in e.joints)) or (
        () if effects else traced(problem, residuals, "joints")
    )
    return Where(block, wires, joints, shares, segments, replay, regime(problem, residuals))


def several(problem: Problem) -> bool:
    """Whether measured wires cut the machine into segments, all of whose ends this case has."""
    kinds = set(problem.kinds)
    segments = problem.robot.machine.segments
    return len(segments) > 1 and set(segments.values()) <= kinds


def split(problem: Problem, fitted: Fitted) -> dict[str, np.ndarray]:
    """Residuals by trial: name -> (n, columns) [floors]."""
    trials = (*problem.fit, *problem.holdout)
    logs = (*by_trial(fitted.point.residual, problem.fit), *by_trial(fitted.held, problem.holdout))
    return {trial.name: log for trial, log in zip(trials, logs, strict=True)}


def traced(problem: Problem, residuals: dict[str, np.ndarray], kind: str) -> tuple[str, ...]:
    """Wires or joints whose signals hold most of the residual."""
    channels = getattr(problem.robot.machine.axes, kind)
    power = dict.fromkeys(channels, 0.0)
    for rows in residuals.values():
        for i, column in enumerate(problem.columns):
            channel = column.rsplit("_", 1)[1]
            if channel in power:
                power[channel] += float(rows[:, i] @ rows[:, i])
    strongest = max(power.values(), default=0.0)
    return tuple(channel for channel, p in power.items() if p >= TRACED * strongest)
