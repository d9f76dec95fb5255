"""Figures of a diagnosis: shares, candidates, regime and spectra."""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake.diagnosis.result import Candidate
from exodrake.report.held_out_runs import IMPROVED, NOMINAL, Condition, HeldOutRuns, binned, spectra
from exodrake.report.number_format import percent
from exodrake.report.svg import AFTER, BAND, BEFORE, INK, RULE, SOFT, TUNED, house_style, new_figure, svg_of

BAR, FRAME = 0.23, 0.62  # inch: height of a bar, and of the rest of a bar chart
MOST = 10  # candidates that are drawn
DOTS = 2500  # of a scatter, at most
JITTER = 0.12  # half the width of a cloud of samples over one of a few levels
# conditions with two or three levels, and how these are called
LEVELS = {(0.0, 1.0): ("no", "yes"), (-1.0, 0.0, 1.0): ("negative", "at rest", "positive")}


def bars_svg(shares: dict[str, float], name: str, label: str) -> str:
    """Horizontal bars of fractions, in the order given; the largest in another colour."""
    largest = max(shares, key=lambda key: shares[key])
    with house_style():
        figure = new_figure(4.6, FRAME + BAR * len(shares))
        axes = figure.subplots()
        draw_bars(axes, shares, {largest}, [f"{100 * v:.0f} %" for v in shares.values()])
        axes.set_xlim(0.0, 118.0 * max(*shares.values(), 1e-9))
        axes.set_xlabel(label)
        return svg_of(figure, name, label)


def ranking_svg(candidates: tuple[Candidate, ...], chosen: set[str], label: str) -> str:
    """Fraction that each candidate removes, best first; those that the verdict names in another colour."""
    removed = {c.id: max(c.score, 0.0) for c in candidates[:MOST]}
    texts = [percent(c.score) if c.score >= 0.0 else "none" for c in candidates[:MOST]]
    coloured = {name for name in removed if set(name.split(" + ")) <= chosen}
    with house_style():
        figure = new_figure(9.6, FRAME + BAR * len(removed))
        axes = figure.subplots()
        draw_bars(axes, removed, coloured, texts)
        axes.set_xlim(0.0, 108.0)
        axes.set_xlabel(label)
        return svg_of(figure, "ranking", label)


def draw_bars(axes: Any, shares: dict[str, float], coloured: set[str], texts: list[str]) -> None:
    """Bars in per cent with a text at the end of each, the first on top."""
    values, positions = [100.0 * v for v in shares.values()], np.arange(len(shares))
    axes.barh(positions, values, height=0.62, color=[AFTER if name in coloured else TUNED for name in shares])
    axes.set_yticks(positions, list(shares))
    axes.invert_yaxis()
    for position, value, text in zip(positions, values, texts):
        axes.annotate(text, (max(value, 0.0), position), (4, 0), textcoords="offset points", va="center", color=SOFT)
    axes.tick_params(axis="both", length=0)
    axes.tick_params(axis="y", labelcolor=INK)
    axes.spines["left"].set_visible(False)
    axes.grid(axis="x", color=RULE, lw=0.5)


def condition_svg(found: Condition, before: str, after: str) -> str:
    """Residuals against a condition: samples, and means of bins, before and after."""
    levels = tuple(np.unique(found.at).tolist())
    with house_style():
        figure = new_figure(4.6, 2.6)
        axes = figure.subplots()
        axes.axhspan(-2.0, 2.0, color=BAND, lw=0)
        step, dots = max(1, len(found.at) // DOTS), jittered(found.at)
        for values, colour, label in ((found.before, BEFORE, before), (found.after, AFTER, after)):
            axes.plot(dots[::step], values[::step], ".", ms=1.6, mew=0, color=colour, alpha=0.35, rasterized=True)
            axes.plot(*binned(found.at, values), "o-", ms=3, lw=1.2, color=colour, label=label, mec="white", mew=0.4)
        axes.axhline(0.0, color=SOFT, lw=0.4)
        limit = 1.1 * max(np.percentile(np.abs(np.concatenate([found.before, found.after])), 99.5), 3.0)
        axes.set_ylim(-limit, limit)
        if levels in LEVELS:
            axes.set_xticks(levels, LEVELS[levels])
        axes.set_xlabel(condition_label(found.name, len(levels)))
        axes.set_ylabel(f"error of {found.signal} / noise std")
        figure.legend(loc="outside upper left", ncols=2, handlelength=1.6)
        return svg_of(figure, "condition", f"error of {found.signal} against {found.name}")


def jittered(at: np.ndarray) -> np.ndarray:
    """Conditions (n,) with few levels, moved at random so that samples over one level do not hide each other."""
    if len(np.unique(at)) > max(map(len, LEVELS)):
        return at
    return at + np.random.default_rng(0).uniform(-JITTER, JITTER, len(at))


def condition_label(name: str, levels: int) -> str:
    """A condition with its unit; a condition of a few levels has none."""
    if levels <= max(map(len, LEVELS)):
        return name
    return f"{name} [s]" if name.startswith("time") else f"{name} [SI]"


def spectrum_svg(runs: HeldOutRuns) -> str:
    """Spectra of the normalised residuals before and after, a panel per kind of signal."""
    with house_style():
        figure = new_figure(9.6, 2.35)
        panels = figure.subplots(1, len(runs.kinds), sharey=True, squeeze=False)[0]
        white = 2.0 * runs.period  # density of white noise of unit variance up to the Nyquist frequency
        for axes, kind in zip(panels, runs.kinds):
            for robot, colour in ((NOMINAL, BEFORE), (IMPROVED, AFTER)):
                frequency, power = spectra(runs, robot, kind)
                axes.loglog(frequency[1:], power[1:], color=colour, lw=1.2)
            axes.axhline(white, color=SOFT, lw=0.9, ls=(0, (4, 2)))
            axes.set_title(runs.display(kind).label)
            axes.set_xlabel("Frequency [Hz]")
            axes.grid(color=RULE, lw=0.5)
        panels[0].set_ylabel("Density [1/Hz]")
        return svg_of(figure, "spectrum", "power density of normalised residuals before and after")
