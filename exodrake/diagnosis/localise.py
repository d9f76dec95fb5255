"""Localisation: the block, tendons and joints of a gap, and its regime.

The regime is the conditional variance of the residual: each condition that a machine declares sorts the frames into
bins, and explains the correlation ratio, the variance of the bin means over the whole variance.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from exodrake.data.log import fill_gaps
from exodrake.diagnosis.checks.suspicions import find_runs
from exodrake.diagnosis.intervals import describe, fitted_effects
from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.likelihood import written_by
from exodrake.diagnosis.problem import STILL, Problem, Trial, by_trial
from exodrake.diagnosis.result import CAUSE, NO_GAP, RETUNE, NamedEffect, Where
from exodrake.diagnosis.search import LARGE, Fitted, is_imitator, screen
from exodrake.model.part import JOINTS, SCALAR, TENDONS
from exodrake.simulation.segments import LOOP, OnlineReplay, list_channels

AFFECTED = 0.25  # share of the strongest channel's residual power, half its amplitude, from which one counts: assumed
BINS = 10
SLOW = 1.0  # Hz: below it a residual counts as slow
SMOOTH = 15  # frames over which the steps of an encoder are averaged for direction and speed


def localise(found: Isolation, verdict: str, effects: tuple[NamedEffect, ...]) -> Where:
    """Block, channels and regime of a gap with named effects: those of its causes, of the retuned robot's regime."""
    if verdict in (NO_GAP, RETUNE):
        return Where(block="none")
    if not effects:
        return remaining(found, found.retuned)
    causes, shares = tuple(x for x in effects if x.role == CAUSE) or effects, dict[str, float]()
    for effect in effects:
        block, share = effect.id.split(".")[0], effect.share.value
        shares[block] = shares.get(block, 0.0) + (max(share, 0.0) if np.isfinite(share) else 0.0)
    shares = dict(sorted(shares.items(), key=lambda item: -item[1]))
    tendons, joints = (tuple(dict.fromkeys(c for x in causes for c in getattr(x, a))) for a in ("wires", "joints"))
    return Where(
        causes[0].id.split(".")[0], tendons, joints, shares, regime(found.whole, found.retuned.explanation.robot)
    )


def remaining(found: Isolation, fitted: Fitted) -> Where:
    """Place and regime of what a fitted set leaves; `shares`: of it, by the best further effect of each block.

    The place is that of the further effect that takes up most of it, as fitted beside the set or else as the linear
    model predicts; a cause goes before the memory of a sensor. Where none takes up a tenth, it is the segment whose
    replay errs most.
    """
    e, search, machine = fitted.explanation, found.search, found.problem.robot.machine
    likelihood, left = found.likelihood.scaled_to(e.residual), max(search.measure_left(fitted), 1e-12)
    more = {key: f for key, f in search.sets.items() if fitted.effects < key and len(key) == len(fitted.effects) + 1}
    beside = {next(iter(key - fitted.effects)): f for key, f in more.items()}
    gains = {i: 1.0 - search.measure_left(f) / left for i, f in beside.items()}
    if not gains:
        cost = max(likelihood.cost(e.residual * found.search.lin.kept, e.x, e.prior_std), 1e-12)
        gains = {p.probe.effect: p.gain / cost for p in screen(likelihood, e, found.search.lin, found.search.lin.kept)}
    ranked = [machine.effect(i) for i in sorted(gains, key=lambda i: -gains[i])]
    shares: dict[str, float] = {}
    for effect in ranked:
        shares.setdefault(effect.block, float(np.clip(gains[effect.id], 0.0, 1.0)))
    share, where = max(shares.values(), default=0.0), regime(found.whole, e.robot)
    lead = next((x for x in ranked if not is_imitator(x)), ranked[0] if ranked else None)
    if lead and share >= LARGE and lead.id in beside:
        fit = fitted_effects(beside[lead.id]).of(lead.id)
        named = describe(fit, lead, machine.axes.of(lead.axis))
        return Where(lead.block, named.wires, named.joints, shares, where)
    if lead and share >= LARGE:
        block, axis = lead.block, lead.axis
    else:
        errors = replay_segments(found.problem, e.robot)
        block, column = max(errors, key=errors.__getitem__)
        axis = next((a for a in (TENDONS, JOINTS) if column.rsplit("_", 1)[1] in machine.axes.of(a)), SCALAR)
    seen = likelihood.views[-1].problem
    residual = np.concatenate(by_trial(likelihood.split(e.residual)[-1], seen.fit))
    affected: dict[str, tuple[str, ...]] = {TENDONS: (), JOINTS: ()}  # those that hold most of the residual's power
    for a in affected if axis == SCALAR else (axis,):
        power = dict.fromkeys(machine.axes.of(a), 0.0)
        for column, squared in zip(seen.columns, np.sum(residual**2, axis=0), strict=True):
            if (channel := column.rsplit("_", 1)[1]) in power:
                power[channel] += float(squared)
        affected[a] = tuple(c for c, p in power.items() if p >= AFFECTED * max(power.values()))
    return Where(block, affected[TENDONS], affected[JOINTS], shares, where)


def replay_segments(problem: Problem, robot: np.ndarray) -> dict[tuple[str, str], float]:
    """Segment and column -> mean squared error of a robot's replay of the segment from its measured inputs.

    An error of one segment does not show in the others. It is in units of what a log that the robot writes shows. Of a
    machine of one segment the closed loop is replayed.

    robot: (parameters,) flat vector [SI].
    """
    machine, replayed = problem.robot.machine, replace(problem.robot, values=robot)
    channels, ends = list_channels(machine), {s.output: s.name for s in machine.segments}
    columns = [c.column for c in channels if c.segment == LOOP]
    exact = {LOOP, *(s.name for s in machine.segments if s.exact)}
    if all(c.segment == LOOP for c in channels):
        channels, exact = tuple(c._replace(segment=ends.get(c.kind, "unknown")) for c in channels), set()

    def measure(logs: Problem) -> np.ndarray:
        errors = []
        for trial in logs.fit:
            measured = np.full((len(trial.reference), len(columns)), np.nan)
            measured[:, [columns.index(name) for name in logs.columns]] = trial.measured
            errors.append(OnlineReplay(replayed).push(trial.reference, measured, last=True) ** 2)
        return np.nanmean(np.concatenate(errors), axis=0)

    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # columns that no log has
        ratios = measure(problem) / measure(written_by(problem, robot, 0))
    found = zip(channels, ratios.tolist(), strict=True)
    return {(c.segment, c.column): x for c, x in found if c.segment not in exact and not np.isnan(x)}


def conditions(problem: Problem, trial: Trial, channel: int) -> dict[str, np.ndarray]:
    """Measured conditions of each frame: name -> (n,), for the channel of that index on each axis."""
    declared, period = problem.robot.machine.regime, problem.robot.machine.frame
    own = {c.rsplit("_", 1)[0]: i for i, c in enumerate(problem.columns) if channel_index(problem, c) == channel}
    table = {kind: fill_gaps(trial.measured[:, i]) for kind, i in own.items()}
    if recorded := list(problem.robot.machine.motion.values()):
        table = {"position": trial.reference[:, recorded[channel][0]]} | table
    if declared is None or declared.position not in table:
        first, last = next(iter(table)), next(reversed(table))
        width = min(SMOOTH, max(1, len(trial.reference) // SMOOTH))
        found = motion(table[first], width, None, period)
        return found | {"position": table[first]} | ({"load": table[last]} if last != first else {})
    found = motion(table[declared.position], SMOOTH, declared.still, period)
    if declared.load in table:
        found |= {"load": table[declared.load], "slack": (table[declared.load] < declared.slack).astype(float)}
    return found | ({"joint angle": table[declared.joint]} if declared.joint in table else {})


def motion(position: np.ndarray, width: int, still: float | None, period: float) -> dict[str, np.ndarray]:
    """Conditions of the motion of a position (n,), averaged over `width` frames of `period` [s].

    still: speed below which it is at rest [unit/s]; None: a share of the fastest motion.
    """
    from scipy.ndimage import uniform_filter1d

    speed = np.gradient(uniform_filter1d(position, width, mode="nearest"), period)
    still = STILL * np.abs(speed).max() if still is None else still
    direction, frames = np.where(np.abs(speed) < still, 0.0, np.sign(speed)), np.arange(len(position))
    starts = np.repeat(*find_runs(direction))
    return {
        "direction of motion": direction,
        "speed": np.abs(speed),
        "time since reversal": period * (frames - starts),
        "time in trial": period * frames,
    }


def explain_variance(residual: np.ndarray, condition: np.ndarray) -> float:
    """Share of the variance of a residual (n,) that a condition (n,) explains, 0 .. 1."""
    total, levels = residual.var(), np.unique(condition)
    if len(levels) > BINS:  # lower ends of bins of equal count
        levels = np.unique(np.quantile(condition, np.linspace(0.0, 1.0, BINS + 1)))[:-1]
    if total == 0.0 or np.ptp(condition) == 0.0:
        return 0.0
    bins = np.searchsorted(levels, condition, "right") - 1
    count = np.bincount(bins)
    means = np.bincount(bins, residual) / np.maximum(count, 1)
    return float(np.clip(np.sum(count * (means - residual.mean()) ** 2) / len(residual) / total, 0.0, 1.0))


def regime(problem: Problem, robot: np.ndarray) -> dict[str, float]:
    """Condition -> share of what a robot (parameters,) leaves that it explains, largest first.

    Shares are weighted over signals by their power.
    """
    residuals = by_trial(problem.residual(robot[None], problem.fit)[0], problem.fit)
    shares, weight = dict[str, float](), 0.0
    for trial, columns in zip(problem.fit, residuals, strict=True):
        for column, residual in zip(problem.columns, columns.T, strict=True):
            power = float(residual @ residual)
            each = conditions(problem, trial, channel_index(problem, column))
            found = {name: explain_variance(residual, condition) for name, condition in each.items()}
            spectral = np.abs(np.fft.rfft(residual - residual.mean())) ** 2
            slow = np.fft.rfftfreq(len(residual), problem.robot.machine.frame) < SLOW
            found["frequency below 1 Hz"] = float(spectral[slow].sum() / max(spectral.sum(), 1e-12))
            for name, share in found.items():
                shares[name] = shares.get(name, 0.0) + power * share
            weight += power
    return {name: value / max(weight, 1e-12) for name, value in sorted(shares.items(), key=lambda item: -item[1])}


def channel_index(problem: Problem, column: str) -> int:
    """Index of a column's channel on its axis."""
    channel, axes = column.rsplit("_", 1)[1], problem.robot.machine.axes
    return next(axes.of(axis).index(channel) for axis in (TENDONS, JOINTS) if channel in axes.of(axis))
