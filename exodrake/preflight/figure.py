"""A figure of what a case could tell: how far each effect stands out, and what it could be taken for."""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake.data.plot import STYLE, new_figure, png_of
from exodrake.preflight.check import Preflight
from exodrake.preflight.identifiability import SEEN, Direction, Identifiability

CEILING = 1000.0  # standard deviations; what stands out further is as clear as can be
COLOURS = ("#009e73", "#e69f00", "#b0b7bf")  # told apart, could be mistaken, not seen


def figure_of(found: Preflight) -> bytes:
    """The figure as PNG."""
    import matplotlib

    effects = list(dict.fromkeys(d.effect for d in found.told.directions))
    with matplotlib.rc_context(STYLE):
        figure = new_figure(10.0, 1.9 + 0.2 * max(len(effects), 8))
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15), sharey=True)
        bars(left, found.told, effects)
        matrix(right, figure, found.told, effects)
        figure.suptitle(f"{found.case.name}: what it could tell", fontsize=11, fontweight="bold", x=0.01, ha="left")
        return png_of(figure)


def state(direction: Direction) -> int:
    """0 told apart, 1 could be mistaken, 2 not seen: index of its colour."""
    return 2 if direction.seen < SEEN else 1 if direction.taken_for else 0


def bars(axes: Any, told: Identifiability, effects: list[str]) -> None:
    """How far an effect of typical size changes the logs, a mark for each channel."""
    words = ("told apart", "could be mistaken", "not seen")
    for kind, (colour, word) in enumerate(zip(COLOURS, words, strict=True)):
        own = [d for d in told.directions if state(d) == kind]
        seen = [min(max(d.seen, 0.1), CEILING) for d in own]
        axes.plot(seen, [effects.index(d.effect) for d in own], "o", color=colour, ms=5, label=word, alpha=0.85)
    axes.axvline(SEEN, color="#555", lw=0.9, ls=(0, (4, 2)))
    axes.set_xscale("log")
    axes.set_xlim(0.08, 1.4 * CEILING)
    axes.set_yticks(range(len(effects)), effects, fontsize=7.5)
    axes.set_ylim(len(effects) - 0.5, -0.5)
    axes.set_xlabel("change of the logs by an effect of typical size [standard deviations]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, handletextpad=0.2, columnspacing=1.0)


def matrix(axes: Any, figure: Any, told: Identifiability, effects: list[str]) -> None:
    """What is left of each effect (row) when another one (column) is taken for it; only where that is little."""
    table = np.full((len(effects), len(effects)), np.nan)
    for d in told.directions:
        for other, left in d.taken_for.items():
            at = effects.index(d.effect), effects.index(other)
            table[at] = np.nanmin([table[at], left])
    image = axes.imshow(table, cmap="YlOrBr_r", vmin=0.0, vmax=SEEN, aspect="auto", interpolation="none")
    axes.set_xticks(range(len(effects)), effects, rotation=90, fontsize=7.5)
    axes.tick_params(labelleft=False)
    axes.grid(True, color="#eef0f3")
    axes.set_title("could be taken for", fontsize=9, loc="left")
    figure.colorbar(image, ax=axes, label="what that leaves [standard deviations]", shrink=0.7)
