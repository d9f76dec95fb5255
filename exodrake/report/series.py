"""Measured against simulated, before and after: small multiples over the channels of a kind, with strips of
residuals.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake.report.drawing import AFTER, BAND, BEFORE, MEASURED, RULE, SOFT, house_style, new_figure, svg_of
from exodrake.report.evidence import IMPROVED, NOMINAL, Evidence
from exodrake.report.words import KINDS, personal, sign_of

WIDTH, HEIGHT = 9.6, 2.75  # inch, of a row of small multiples
STRIP = (2.4, 1.0)  # heights of a panel and of its strip of residuals
REACH = 1.15  # a strip shows this much more than the largest of its residuals, rare ones left aside
RARE = 99.5  # percentile


def signals_svg(evidence: Evidence, kind: str) -> str:
    """One row of small multiples: the channels of a kind on the held-out log with the largest gap."""
    chosen = evidence.of_kind(kind)
    with house_style():
        figure = new_figure(WIDTH, HEIGHT)
        grid = figure.subplots(
            2,
            len(chosen),
            sharex=True,
            sharey="row",
            squeeze=False,
            gridspec_kw={"height_ratios": STRIP, "hspace": 0.04},
        )
        reach = strip_reach(evidence, chosen)
        for k, column in enumerate(chosen):
            draw_signal(grid[0, k], evidence, column)
            draw_strip(grid[1, k], evidence, column, reach)
        unit = sign_of(personal(unit_of(evidence, kind))[0])
        grid[0, 0].set_ylabel(f"{KINDS[kind]} [{unit}]")
        grid[1, 0].set_ylabel("error")
        for axes in grid[1]:
            axes.set_xlabel("Time [s]")
        figure.align_ylabels(grid[:, 0])
        return svg_of(figure, f"signals_{kind}", f"{KINDS[kind]}: measured, before and after, with residuals")


def unit_of(evidence: Evidence, kind: str) -> str:
    """SI unit of a kind of column."""
    machine = evidence.problem.robot.machine
    return next(machine.signal[c.signal].unit for c in machine.columns if c.kind == kind)


def factor_of(evidence: Evidence, kind: str) -> float:
    """From SI to the unit a person thinks in."""
    return personal(unit_of(evidence, kind))[1]


def draw_signal(axes: Any, evidence: Evidence, column: int) -> None:
    """Measured on top of the nominal and the improved robot's run."""
    kind, channel = evidence.columns[column].rsplit("_", 1)
    factor, runs = factor_of(evidence, kind), evidence.simulated[evidence.shown]
    time = evidence.period * np.arange(len(evidence.trial.measured))
    axes.plot(time, factor * evidence.trial.measured[:, column], color=MEASURED, lw=1.5, alpha=0.45, rasterized=True)
    axes.plot(time, factor * runs[NOMINAL][:, column], color=BEFORE, lw=0.9, rasterized=True)
    axes.plot(time, factor * runs[IMPROVED][:, column], color=AFTER, lw=0.9, rasterized=True)
    axes.set_title(channel)
    axes.set_xlim(0.0, time[-1] if len(time) > 1 else None)
    axes.grid(axis="y", color=RULE, lw=0.5)
    axes.tick_params(labelbottom=False, length=0)


def strip_reach(evidence: Evidence, chosen: list[int]) -> float:
    """Half the height of the strips [SI]: the larger of the residuals of all channels, rare ones left aside."""
    runs, floor = evidence.residuals[evidence.shown], evidence.problem.noise_std[chosen]
    sizes = [np.nanpercentile(np.abs(runs[name][:, chosen] * floor), RARE) for name in (NOMINAL, IMPROVED)]
    return REACH * max(*sizes, 2.0 * float(floor.max()))


def draw_strip(axes: Any, evidence: Evidence, column: int, reach: float) -> None:
    """Residuals before and after over the band of twice the noise floor."""
    kind = evidence.columns[column].rsplit("_", 1)[0]
    factor, floor = factor_of(evidence, kind), evidence.problem.noise_std[column]
    runs = evidence.residuals[evidence.shown]
    time = evidence.period * np.arange(len(evidence.trial.measured))
    axes.axhspan(-2.0 * factor * floor, 2.0 * factor * floor, color=BAND, lw=0)
    axes.plot(time, factor * floor * runs[NOMINAL][:, column], color=BEFORE, lw=0.7, rasterized=True)
    axes.plot(time, factor * floor * runs[IMPROVED][:, column], color=AFTER, lw=0.7, rasterized=True)
    axes.axhline(0.0, color=SOFT, lw=0.4)
    axes.set_ylim(-factor * reach, factor * reach)
    axes.locator_params(axis="y", nbins=3)
    axes.spines["bottom"].set_visible(False)
