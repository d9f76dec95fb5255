"""Section "which" of the report: the effects with equation and parameters, their tests, the candidates, the retune."""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake.diagnosis.level_table import LevelTest
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.result import Candidate, Diagnosis, NamedEffect
from exodrake.report import number_format as n, wording as w
from exodrake.report.blocks import Bars, Block, Table
from exodrake.report.simulated_logs import IMPROVED, SimulatedLogs

MOST = 10  # candidates that are drawn
SURE = 0.999  # no weight is printed as larger
SMALLEST_P = 1e-4  # p-values below it are not distinguished
CLOSE = 0.02  # candidates whose closure is this close to the best are named as close
SHOWN = 12  # retuned parameters that are shown at once
LEAST = 0.005  # standard deviations of its tolerance: a smaller change is not listed
AT_BOUND = 0.999  # of the bound, from which a change counts as limited by it


def which(diagnosis: Diagnosis, runs: SimulatedLogs) -> dict[str, Any]:
    """Values of the section's template."""
    return {
        "effects": [(e, w.effect_of(diagnosis, e.id), effect_table(e)) for e in diagnosis.effects],
        "weight": n.percent(min([SURE, *(e.probability for e in diagnosis.effects)])),
        "tests": test_table(diagnosis),
        "candidates": candidate_blocks(diagnosis),
        "close": close_candidates(diagnosis),
        "retuned": retuned_tables(diagnosis, runs),
    }


def effect_table(effect: NamedEffect) -> Table:
    """Parameters of an effect with intervals, channel by channel where they differ."""
    rows = []
    for name, item in effect.parameters.items():
        channels = effect.channels.get(name, {})
        several = len(channels) > 1
        rows.append((f"`{name}`{' (common value)' if several else ''}", *n.interval(item)))
        rows += [(f"`{name}` {channel}", *n.interval(one)) for channel, one in channels.items() if several]
    return Table(("Parameter", "Value", "90 % interval"), rows, wide=False)


def test_table(diagnosis: Diagnosis) -> Table | None:
    """The tests of the explanation behind the verdict, each with what it found and its level."""
    rows = [(t.asks, *found_and_level(t), "passed" if t.passed else "failed") for t in diagnosis.tests]
    return Table(("Test", "Found", "Level", ""), rows) if rows else None


def found_and_level(test: LevelTest) -> tuple[str, str]:
    """Value of a test and its level, in the measure of the test."""
    if test.measure == "p-value":
        return f"p {p_value(test.value)}", f"p > {test.limit:g}"
    if test.measure == "share":
        return n.percent(test.value), f"≤ {n.percent(test.limit)}"
    return n.digits(test.value, 2), f"≤ {n.digits(test.limit, 2)} (mean square)"


def p_value(value: float) -> str:
    """A p-value with its relation; one far below the level of the tests is not resolved."""
    return f"= {value:.2g}" if value >= SMALLEST_P else f"< {SMALLEST_P:g}"


def candidate_blocks(diagnosis: Diagnosis) -> list[Block]:
    """The ranking of candidates as bars, and all of them in numbers, folded."""
    if not diagnosis.candidates:
        return []
    removed = [(c, max(c.score, 0.0)) for c in diagnosis.candidates[:MOST]]
    bars = [(f"`{c.id}`", share, n.percent(share), c.left) for c, share in removed]
    caption = (
        "Closure of each candidate on the fitted logs: fraction of the excess error of the retuned robot that is gone, "
        "mean of closed loop and prediction error; in colour those that no test rejects. Each is fitted together with "
        "the nominal parameters, and not to the end where it is far behind after two steps. Larger sets come first, in "
        "each size the likeliest."
    )
    chi2 = ("chi-square, closed loop", "chi-square, prediction error")
    header = ("Candidate", "Closure", *chi2, "p of what it leaves", "")
    title = f"All {len(diagnosis.candidates)} candidates in numbers"
    return [Bars(bars, caption), Table(header, [candidate_row(c) for c in diagnosis.candidates], folded=title)]


def candidate_row(c: Candidate) -> tuple[str, ...]:
    """Cells of a candidate."""
    prediction = n.digits(c.prediction_chi2) if np.isfinite(c.prediction_chi2) else "–"
    kept = "not rejected" if c.left else "rejected"
    return (f"`{c.id}`", n.closure(c.score), n.digits(c.chi2), prediction, p_value(c.fit).removeprefix("= "), kept)


def close_candidates(diagnosis: Diagnosis) -> str:
    """Candidates that come near the named one, in a list; empty if there are none."""
    named = {e.id for e in diagnosis.effects}
    best = diagnosis.candidates[0].score if diagnosis.candidates else 1.0
    near = [c.id for c in diagnosis.candidates if not named & set(c.id.split(" + ")) and c.score > best - CLOSE]
    return n.listed([f"`{identity}`" for identity in near])


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
