"""The other figures of the page: candidates, shares, regime and spectra."""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake.diagnosis.result import Candidate
from exodrake.report.drawing import (  # fmt: skip
    AFTER,
    BAND,
    BEFORE,
    INK,
    RULE,
    SOFT,
    TUNED,
    house_style,
    new_figure,
    svg_of,
)
from exodrake.report.evidence import IMPROVED, NOMINAL, Condition, Evidence, binned, spectra
from exodrake.report.words import KINDS, share

ROW, FRAME = 0.23, 0.62  # inch: height of a bar, and of the rest of a bar chart
MOST = 10  # candidates that are drawn
DOTS = 2500  # of a scatter, at most


def bars_svg(shares: dict[str, float], name: str, label: str, colour: str = TUNED, first: str = AFTER) -> str:
    """Horizontal bars of shares (0 .. 1), in the order given; the largest in another colour."""
    with house_style():
        figure = new_figure(4.6, FRAME + ROW * len(shares))
        axes = figure.subplots()
        draw_bars(axes, list(shares), [100.0 * v for v in shares.values()], "{:.0f} %")
        largest = max(range(len(shares)), key=lambda i: list(shares.values())[i])
        for i, bar in enumerate(axes.patches):
            bar.set_color(first if i == largest else colour)
        axes.set_xlabel(label)
        return svg_of(figure, name, label)


def draw_bars(axes: Any, names: list[str], values: list[float], form: str) -> None:
    """Bars with their value at the end, first on top."""
    places = np.arange(len(names))
    axes.barh(places, values, height=0.62)
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    span = max(max(values, default=0.0), 1e-9)
    axes.set_xlim(min(0.0, 1.05 * min(values, default=0.0)), 1.18 * span)
    for place, value in zip(places, values):
        axes.text(max(value, 0.0) + 0.015 * span, place, form.format(value), va="center", color=SOFT, fontsize=8)
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    axes.spines["left"].set_visible(False)
    axes.xaxis.set_visible(True)
    axes.tick_params(axis="x", length=0)
    axes.grid(axis="x", color=RULE, lw=0.5)


def ranking_svg(candidates: tuple[Candidate, ...], chosen: set[str]) -> str:
    """Share of the gap that each candidate explains, best first; those that the verdict names in colour."""
    shown = candidates[:MOST]
    with house_style():
        figure = new_figure(9.6, FRAME + ROW * len(shown))
        axes = figure.subplots()
        values = [100.0 * max(c.score, 0.0) for c in shown]
        draw_bars(axes, [c.id for c in shown], values, "{:.1f} %")
        for label, candidate in zip(axes.texts, shown):
            label.set_text(share(candidate.score) if candidate.score >= 0.0 else "less than retuned numbers alone")
        for bar, candidate in zip(axes.patches, shown):
            named = set(candidate.id.split(" + ")) <= chosen
            bar.set_color(AFTER if named else TUNED)
        axes.set_xlim(0.0, 108.0)
        axes.set_xlabel("share of the gap explained, beyond retuned numbers [%]")
        return svg_of(figure, "ranking", "candidates by the share of the gap that they explain")


def condition_svg(found: Condition, before: str, after: str) -> str:
    """Residual against the condition that explains most of it: samples, and means of bins, before and after."""
    with house_style():
        figure = new_figure(4.6, 2.6)
        axes = figure.subplots()
        axes.axhspan(-2.0, 2.0, color=BAND, lw=0)
        step, spots = max(1, len(found.at) // DOTS), jittered(found.at)
        for values, colour, label in ((found.before, BEFORE, before), (found.after, AFTER, after)):
            axes.plot(spots[::step], values[::step], ".", ms=1.6, mew=0, color=colour, alpha=0.35, rasterized=True)
            axes.plot(*binned(found.at, values), "o-", ms=3, lw=1.2, color=colour, label=label, mec="white", mew=0.4)
        axes.axhline(0.0, color=SOFT, lw=0.4)
        spread = np.percentile(np.abs(np.concatenate([found.before, found.after])), 99.5)
        axes.set_ylim(-1.1 * max(spread, 3.0), 1.1 * max(spread, 3.0))
        if found.name in LEVELS:
            axes.set_xticks(list(LEVELS[found.name]), list(LEVELS[found.name].values()))
        axes.set_xlabel(condition_label(found.name))
        axes.set_ylabel(f"error of {found.signal} [floors]")
        figure.legend(loc="outside upper left", ncols=2, handlelength=1.6)
        return svg_of(figure, "condition", f"error of {found.signal} against {found.name}")


UNITS = {
    "speed": "m/s",
    "load": "N",
    "time since reversal": "s",
    "time in trial": "s",
    "joint angle": "rad",
}
LEVELS = {
    "direction of motion": {-1: "giving wire", 0: "at rest", 1: "taking wire in"},
    "slack": {0: "taut", 1: "slack"},
}
JITTER = 0.12  # half the width of a cloud of samples over one of a few levels


def jittered(at: np.ndarray) -> np.ndarray:
    """Conditions with few levels spread a little, so that samples over one level can be told apart."""
    if len(np.unique(at)) > len(LEVELS["direction of motion"]):
        return at
    return at + np.random.default_rng(0).uniform(-JITTER, JITTER, len(at))


def condition_label(name: str) -> str:
    """A condition with its unit."""
    return f"{name} [{UNITS[name]}]" if name in UNITS else name


def spectrum_svg(evidence: Evidence) -> str:
    """Residual spectra before and after against the floor, a panel per kind of signal."""
    kinds = [kind for kind in KINDS if evidence.of_kind(kind)]
    with house_style():
        figure = new_figure(9.6, 2.35)
        panels = figure.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
        white = 2.0 * evidence.period  # density of noise of one floor, spread evenly up to the Nyquist frequency
        for axes, kind in zip(panels, kinds):
            for robot, colour in ((NOMINAL, BEFORE), (IMPROVED, AFTER)):
                frequency, power = spectra(evidence, robot, kind)
                axes.loglog(frequency[1:], power[1:], color=colour, lw=1.2)
            axes.axhline(white, color=SOFT, lw=0.9, ls=(0, (4, 2)))
            axes.set_title(KINDS[kind])
            axes.set_xlabel("Frequency [Hz]")
            axes.grid(color=RULE, lw=0.5)
        panels[0].set_ylabel("Error power [floor²/Hz]")
        return svg_of(figure, "spectrum", "power density of residuals before and after, and the noise floor")
