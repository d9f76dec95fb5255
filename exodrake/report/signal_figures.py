"""Measured and simulated signals over time: a panel per channel, with its residuals below."""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake.report.held_out_runs import IMPROVED, NOMINAL, HeldOutRuns
from exodrake.report.svg import AFTER, BAND, BEFORE, MEASURED, RULE, SOFT, house_style, new_figure, svg_of

WIDTH, HEIGHT = 9.6, 2.75  # inch, of a row of panels
HEIGHTS = (2.4, 1.0)  # of a panel and of the residuals below it
PER_ROW = 4  # panels
MARGIN = 1.15  # limit of the residuals' axis over the largest residual
RARE = 99.5  # percentile of the residuals that counts as the largest


def signals_svg(runs: HeldOutRuns, kind: str) -> str:
    """The channels of a kind of signal on the held-out log with the largest gap."""
    chosen, display = runs.of_kind(kind), runs.display(kind)
    columns = min(len(chosen), PER_ROW)
    rows = -(-len(chosen) // columns)
    with house_style():
        figure = new_figure(WIDTH, HEIGHT * rows)
        for row, part in enumerate(figure.subfigures(rows, 1, squeeze=False)[:, 0]):
            here = chosen[row * columns : (row + 1) * columns]
            grid = part.subplots(2, columns, sharex=True, sharey="row", squeeze=False, height_ratios=HEIGHTS)
            for k, column in enumerate(here):
                draw_signal(grid[0, k], runs, column)
                draw_residuals(grid[1, k], runs, column, residual_limit(runs, here))
                grid[1, k].set_xlabel("Time [s]")
            for unused in grid[:, len(here) :].flat:
                unused.remove()
            grid[0, 0].set_ylabel(display.axis)
            grid[1, 0].set_ylabel("error")
            part.align_ylabels(grid[:, 0])
        return svg_of(figure, f"signals_{kind}", f"{display.label}: measured, before and after, with residuals")


def draw_signal(axes: Any, runs: HeldOutRuns, column: int) -> None:
    """The measured signal with the runs of the nominal and of the improved robot."""
    kind, channel = runs.parts[column]
    factor, simulated = runs.display(kind).factor, runs.simulated[runs.shown]
    time = runs.period * np.arange(len(runs.trial.measured))
    axes.plot(time, factor * runs.trial.measured[:, column], color=MEASURED, lw=1.5, alpha=0.45, rasterized=True)
    axes.plot(time, factor * simulated[NOMINAL][:, column], color=BEFORE, lw=0.9, rasterized=True)
    axes.plot(time, factor * simulated[IMPROVED][:, column], color=AFTER, lw=0.9, rasterized=True)
    axes.set_title(channel)
    axes.set_xlim(0.0, time[-1] if len(time) > 1 else None)
    axes.grid(axis="y", color=RULE, lw=0.5)
    axes.tick_params(labelbottom=False, length=0)


def residual_limit(runs: HeldOutRuns, chosen: list[int]) -> float:
    """Limit of the residuals' axes [SI]: the largest residual of all channels, rare ones left aside."""
    residuals, noise_std = runs.residuals[runs.shown], runs.problem.noise_std[chosen]
    sizes = [np.nanpercentile(np.abs(residuals[name][:, chosen] * noise_std), RARE) for name in (NOMINAL, IMPROVED)]
    return MARGIN * max(*sizes, 2.0 * float(noise_std.max()))


def draw_residuals(axes: Any, runs: HeldOutRuns, column: int, limit: float) -> None:
    """Residuals before and after, with a band of two noise standard deviations to either side."""
    factor, noise_std = runs.display(runs.parts[column][0]).factor, runs.problem.noise_std[column]
    residuals = runs.residuals[runs.shown]
    time = runs.period * np.arange(len(runs.trial.measured))
    axes.axhspan(-2.0 * factor * noise_std, 2.0 * factor * noise_std, color=BAND, lw=0)
    axes.plot(time, factor * noise_std * residuals[NOMINAL][:, column], color=BEFORE, lw=0.7, rasterized=True)
    axes.plot(time, factor * noise_std * residuals[IMPROVED][:, column], color=AFTER, lw=0.7, rasterized=True)
    axes.axhline(0.0, color=SOFT, lw=0.4)
    axes.set_ylim(-factor * limit, factor * limit)
    axes.locator_params(axis="y", nbins=3)
    axes.spines["bottom"].set_visible(False)
