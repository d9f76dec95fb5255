"""Localisation: the block, tendons and joints of a gap, and its regime.

Where effects are named, a block has the shares of its effects in the gap. The place of what a set of effects leaves is
that of the further effect that takes up most of it, as fitted beside the set or else as the linear model predicts; a
cause goes before the memory of a sensor. Where none takes up a tenth, it is the segment that ends in the signal of the
largest prediction error. Channels that no fit tells are those whose prediction errors hold most of what is left.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from exodrake.core.signal import JOINTS, SCALAR, TENDONS
from exodrake.diagnosis.gap import Where
from exodrake.diagnosis.intervals import describe, fitted_effects
from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.problem import by_trial
from exodrake.diagnosis.regime import regime
from exodrake.diagnosis.result import NO_GAP, RETUNE, NamedEffect
from exodrake.diagnosis.search import Fitted, is_memory
from exodrake.diagnosis.verdict import LARGE

AFFECTED = 0.25  # share of the strongest channel's residual power, half its amplitude, from which one counts: assumed


def localise(found: Isolation, verdict: str, effects: tuple[NamedEffect, ...]) -> Where:
    """Block, channels and regime of a gap, from the fitted logs; the regime follows the retuned robot.

    Args:
        found: what the isolation tried.
        verdict: its word.
        effects: effects that are named.
    """
    if verdict in (NO_GAP, RETUNE):
        return Where(block="none")
    rest = remaining(found, found.retuned)
    if not effects:
        return rest
    shares = sum_by_block((x.id, x.share.value) for x in effects)
    tendons, joints = (tuple(dict.fromkeys(c for x in effects for c in getattr(x, a))) for a in ("wires", "joints"))
    return Where(effects[0].id.split(".")[0], tendons, joints, shares, rest.regime)


def remaining(found: Isolation, fitted: Fitted) -> Where:
    """Place and regime of what a fitted set leaves; `shares`: of it, by the best further effect of each block."""
    e, search, machine = fitted.explanation, found.search, found.problem.robot.machine
    likelihood, left = found.likelihood.scaled_to(e.residual), max(search.left(fitted), 1e-12)
    beside = {next(iter(key - fitted.effects)): f for key, f in search.sets.items() if one_more(key, fitted.effects)}
    gains = {i: 1.0 - search.left(f) / left for i, f in beside.items()}
    if not gains:
        cost = max(e.cost(likelihood), 1e-12)
        gains = {p.probe.effect: p.gain / cost for p in search.screened(e, found.lin)}
    ranked = [machine.effect(i) for i in sorted(gains, key=lambda i: -gains[i])]
    shares: dict[str, float] = {}
    for effect in ranked:
        shares.setdefault(effect.block, float(np.clip(gains[effect.id], 0.0, 1.0)))
    share, where = max(shares.values(), default=0.0), regime(found.whole, e.robot)
    lead = next((x for x in ranked if not is_memory(x)), ranked[0] if ranked else None)
    if lead and share >= LARGE and lead.id in beside:
        fit = fitted_effects(beside[lead.id]).of(lead.id)
        named = describe(fit, lead, machine.axes.of(lead.axis))
        return Where(lead.block, named.wires, named.joints, shares, where)
    seen = likelihood.views[-1].problem
    residual = np.concatenate(by_trial(likelihood.split(e.residual)[-1], seen.fit))
    kind, channel = seen.columns[int(np.argmax(np.sum(residual**2, axis=0)))].rsplit("_", 1)
    if lead and share >= LARGE:
        block, axis = lead.block, lead.axis
    else:
        block = next((s.name for s in machine.segments if s.output == kind and not s.exact), "unknown")
        axis = next((a for a in (TENDONS, JOINTS) if channel in machine.axes.of(a)), SCALAR)
    tendons, joints = (
        affected(residual, seen.columns, machine.axes.of(a)) if axis in (a, SCALAR) else () for a in (TENDONS, JOINTS)
    )
    return Where(block, tendons, joints, shares, where)


def one_more(key: frozenset[str], effects: frozenset[str]) -> bool:
    """Whether a set has one effect more than another."""
    return len(key) == len(effects) + 1 and effects < key


def sum_by_block(shares: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Share of each block, largest first: the sum of its effects' ones, of those that have one."""
    found: dict[str, float] = {}
    for effect, share in shares:
        block = effect.split(".")[0]
        found[block] = found.get(block, 0.0) + (max(share, 0.0) if np.isfinite(share) else 0.0)
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def affected(residual: np.ndarray, columns: tuple[str, ...], channels: tuple[str, ...]) -> tuple[str, ...]:
    """Channels whose signals hold most of the power of a residual (n, columns) [noise standard deviations]."""
    power = dict.fromkeys(channels, 0.0)
    for column, squared in zip(columns, np.sum(residual**2, axis=0), strict=True):
        channel = column.rsplit("_", 1)[1]
        if channel in power:
            power[channel] += float(squared)
    strongest = max(power.values(), default=0.0)
    return tuple(channel for channel, p in power.items() if p >= AFFECTED * strongest)
