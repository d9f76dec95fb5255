"""Section "where" of the report: the part, its share, the condition under which it shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from exodrake.core.display import SYMBOLS
from exodrake.data.plot import new_figure
from exodrake.diagnosis import regime
from exodrake.diagnosis.result import Diagnosis
from exodrake.report import wording as w
from exodrake.report.blocks import Drawing, shares
from exodrake.report.simulated_logs import IMPROVED, NOMINAL, RETUNED, SimulatedLogs
from exodrake.report.svg import AFTER, BAND, BEFORE, SOFT, house_style, svg_of

BINS = 14  # of a condition
DOTS = 2500  # of a scatter, at most
JITTER = 0.12  # half the width of a cloud of samples over one of a few levels
# conditions with two or three levels, and how these are called
LEVELS = {(0.0, 1.0): ("no", "yes"), (-1.0, 0.0, 1.0): ("negative", "at rest", "positive")}


def where(diagnosis: Diagnosis, runs: SimulatedLogs) -> dict[str, Any]:
    """Values of the section's template; nothing where there is no place."""
    found = diagnosis.where
    if found.block == "none":
        return {"wiring": None, "blocks": None, "conditions": None, "scatter": None}
    by = "the effects of each block take up" if diagnosis.effects else "the best effect of each block takes up alone"
    caption = f"Share of the gap that {by}."
    condition = top_condition(diagnosis, runs)
    return {
        "wiring": wiring(diagnosis, runs),
        "blocks": shares(found.shares, caption) if found.shares else None,
        "conditions": shares(found.regime) if found.regime else None,
        "scatter": None if condition is None else scatter(condition, w.last_robot(diagnosis)),
    }


def wiring(diagnosis: Diagnosis, runs: SimulatedLogs) -> Drawing:
    """The machine's parts and signals, parts coloured by their share."""
    from exodrake.diagrams.block_diagram import wiring_svg

    svg = wiring_svg(runs.problem.robot.machine, diagnosis.where.shares, schedule=False)
    caption = "The fuller the colour of a part, the larger its share of the gap."
    return Drawing(svg, caption, wide=True, alt="parts and signals of the robot")


@dataclass(frozen=True, eq=False)
class Condition:
    """Residuals of a signal against a condition.

    Attributes:
        name: of the condition, with its unit.
        signal: column whose residuals these are.
        at: (n,) values of the condition [its unit].
        before, after: (n,) normalised residuals of the retuned and of the improved robot.
    """

    name: str
    signal: str
    at: np.ndarray
    before: np.ndarray
    after: np.ndarray


def top_condition(diagnosis: Diagnosis, runs: SimulatedLogs) -> Condition | None:
    """The condition with the largest correlation ratio for the worst signal of the worst judged log, if there is one.

    The loop's answer to an error does not count.
    """
    if not diagnosis.where.regime or not runs.judged:
        return None
    log = max(runs.judged, key=lambda log: np.nanmean(log.residuals[NOMINAL] ** 2))
    power = np.nanmean(log.residuals[RETUNED] ** 2, axis=0)
    plain = [i for i, (kind, _) in enumerate(runs.parts) if kind != runs.loop_answer]
    column = max(plain or range(len(power)), key=lambda i: power[i])
    name = runs.problem.columns[column]
    table = regime.conditions(runs.problem, log.trial, regime.channel_of(runs.problem, name))
    before, after = (log.residuals[robot][:, column] for robot in (RETUNED, IMPROVED))
    known = np.isfinite(before) & np.isfinite(after)
    explained = {condition: regime.explained(before[known], at[known]) for condition, at in table.items()}
    best = max(explained, key=lambda condition: explained[condition])
    label, factor = condition_label(best, runs)
    return Condition(label, name, factor * table[best][known], before[known], after[known])


def condition_label(name: str, runs: SimulatedLogs) -> tuple[str, float]:
    """A condition with the unit in which it is shown, where the machine declares it, and its factor from SI."""
    declared = runs.problem.robot.machine.regime
    if name.startswith("time"):
        return f"{name} [s]", 1.0
    if declared is None or name not in ("load", "joint angle", "speed"):
        return name, 1.0
    shown = runs.display({"load": declared.load, "joint angle": declared.joint}.get(name, declared.position))
    unit = SYMBOLS.get(shown.unit, shown.unit)
    return f"{name} [{unit}/s]" if name == "speed" else f"{name} [{unit}]", shown.factor


def binned(at: np.ndarray, values: np.ndarray, bins: int = BINS) -> tuple[np.ndarray, np.ndarray]:
    """Mean condition and mean value in bins of equal count (or of equal condition, where it has few values)."""
    levels = np.unique(at)
    if len(levels) <= bins:
        return levels, np.array([values[at == level].mean() for level in levels])
    groups = np.array_split(np.argsort(at, kind="stable"), bins)
    return np.array([at[g].mean() for g in groups]), np.array([values[g].mean() for g in groups])


def scatter(found: Condition, last: str) -> Drawing:
    """Residuals against a condition: samples, and means of bins, before and after."""
    levels = tuple(np.unique(found.at).tolist())
    with house_style():
        figure = new_figure(4.6, 2.6)
        axes = figure.subplots()
        axes.axhspan(-2.0, 2.0, color=BAND, lw=0)
        step, dots = max(1, len(found.at) // DOTS), jittered(found.at)
        for values, colour, label in ((found.before, BEFORE, "retuned robot"), (found.after, AFTER, last)):
            axes.plot(dots[::step], values[::step], ".", ms=1.6, mew=0, color=colour, alpha=0.35, rasterized=True)
            axes.plot(*binned(found.at, values), "o-", ms=3, lw=1.2, color=colour, label=label, mew=0)
        axes.axhline(0.0, color=SOFT, lw=0.4)
        limit = 1.1 * max(np.percentile(np.abs(np.concatenate([found.before, found.after])), 99.5), 3.0)
        axes.set_ylim(-limit, limit)
        if levels in LEVELS:
            axes.set_xticks(levels, LEVELS[levels])
        axes.set_xlabel(found.name)
        axes.set_ylabel(f"error of {found.signal} / noise std")
        figure.legend(loc="outside upper left", ncols=2, handlelength=1.6)
        svg = svg_of(figure, "condition", f"error of {found.signal} against {found.name}")
    caption = (
        "Error of the worst signal against the strongest condition: samples, and means of bins. "
        "The band is ± 2 noise standard deviations."
    )
    return Drawing(svg, caption)


def jittered(at: np.ndarray) -> np.ndarray:
    """Conditions (n,) with few levels, moved at random so that samples over one level do not hide each other."""
    if len(np.unique(at)) > max(map(len, LEVELS)):
        return at
    return at + np.random.default_rng(0).uniform(-JITTER, JITTER, len(at))
