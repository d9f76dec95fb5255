"""Section "which" of the report: causes with their rivals, refinements, the fitted sets, and what retuning moved."""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.result import Candidate, Diagnosis, NamedEffect
from exodrake.report import number_format as n, wording as w
from exodrake.report.blocks import Bars, Table
from exodrake.report.simulated_logs import IMPROVED, SimulatedLogs

SHOWN = 12  # retuned parameters that are shown at once
LEAST = 0.005  # standard deviations of its tolerance: a smaller change is not listed
AT_BOUND = 0.999  # of the bound, from which a change counts as limited by it


def which(diagnosis: Diagnosis, runs: SimulatedLogs) -> dict[str, Any]:
    """Values of the section's template."""

    def described(effects: list[NamedEffect]) -> list[tuple[Any, ...]]:
        return [(e, w.effect_of(diagnosis, e.id), effect_table(e)) for e in effects]

    return {
        "shares": share_bars(diagnosis),
        "causes": described(w.causes(diagnosis)),
        "refinements": described(w.refinements(diagnosis)),
        "sets": set_table(diagnosis),
        "retuned": retuned_tables(diagnosis, runs),
    }


def share_bars(diagnosis: Diagnosis) -> Bars | None:
    """Shares of the gap: each cause with its rivals beneath, the refinements, and what remains."""
    rows = []
    for effect in (*w.causes(diagnosis), *w.refinements(diagnosis)):
        strong = effect in w.causes(diagnosis)
        rows.append((f"`{effect.id}`", length(effect.share.value), w.share_span(effect.share), strong))
        rows += [(f"or `{r.id}`", length(r.share.value), w.share(r.share.value), False) for r in effect.rivals]
    if not rows:
        return None
    left = diagnosis.remainder
    noise = f", {n.digits(left.noise_std, 2)} noise std" if np.isfinite(left.noise_std) else ""
    rows.append(("remains", length(left.value), w.share(left.value) + noise, False))
    caption = (
        "Share of the gap beyond retuning, fitted logs: what is left without the effect less what is left with it. "
        "Causes in colour, rivals of a cause beneath it. Effects that partly replace each other do not add up to 100 %."
    )
    return Bars(rows, caption)


def length(fraction: float) -> float:
    """A fraction as the length of a bar."""
    return float(np.clip(np.nan_to_num(fraction), 0.0, 1.0))


def effect_table(effect: NamedEffect) -> Table:
    """Parameters of an effect with intervals, channel by channel where there are several."""
    rows = []
    for name, item in effect.parameters.items():
        channels = effect.channels.get(name, {})
        several = len(channels) > 1
        if not several or np.isfinite(item.value):
            rows.append((f"`{name}`{' (common value)' if several else ''}", *n.interval(item)))
        rows += [(f"`{name}` {channel}", *n.interval(one)) for channel, one in channels.items() if several]
    return Table(("Parameter", "Value", "90 % interval"), rows, wide=False)


def set_table(diagnosis: Diagnosis) -> Table | None:
    """All sets that were fitted, folded."""
    rows = [set_row(one) for one in diagnosis.candidates]
    header = ("Effects", "Explains", "chi-square, closed loop", "chi-square, prediction error", "Evidence [nats]")
    return Table(header, rows, folded=f"All {len(rows)} fitted sets in numbers") if rows else None


def set_row(one: Candidate) -> tuple[str, ...]:
    """Cells of a fitted set."""
    chi2 = [n.digits(x) if np.isfinite(x) else "–" for x in (one.chi2, one.prediction_chi2)]
    evidence = f"{one.evidence:,.1f}" if np.isfinite(one.evidence) else "–"
    return (f"`{one.id or 'retune'}`", n.closure(one.share), *chi2, evidence)


def retuned_tables(diagnosis: Diagnosis, runs: SimulatedLogs) -> list[Table]:
    """Nominal parameters that the last robot changes, the largest change first; the smaller changes folded."""
    improved = diagnosis.robots[IMPROVED].values
    changes = [(p, p.coordinate(float(improved[p.index[0]]))) for p in nominal_parameters(runs.problem.robot)]
    changes = [(p, x) for p, x in changes if abs(x) > LEAST * p.prior_std]
    rows = []
    for p, x in sorted(changes, key=lambda change: -abs(change[1] / change[0].prior_std)):
        unit = runs.problem.robot.machine.parameters[p.index[0]].unit
        bound = " (its bound)" if abs(x) >= AT_BOUND * max(map(abs, p.bounds)) else ""
        deviations = f"{x / p.prior_std:+.2f}{bound}"
        rows.append((f"`{p.name}`", n.quantity(p.base, unit), n.quantity(p.value(x), unit), deviations))
    header, rest = ("Parameter", "Nominal", "Fitted", "Change in std of its tolerance"), rows[SHOWN:]
    tables = [Table(header, rows[:SHOWN], wide=False)] if rows else []
    return tables + ([Table(header, rest, wide=False, folded=f"{len(rest)} smaller changes")] if rest else [])
