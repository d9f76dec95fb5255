"""Figure of a tuning: steps of every channel, and each requirement beside the value that each controller reaches."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.analysis.figure_style import DARK, GREY, styled
from exodrake.core.display import shown_unit
from exodrake.data.plot import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from exodrake.analysis.assessment import Tuned
    from exodrake.analysis.tuning import Tuning

BOX = {"fc": "white", "ec": "none", "pad": 0.6, "alpha": 0.9}
SEEN = 1e-4  # of the panel: below, the rest of a simulation
COLOURS = ("#5b6470", "#0072b2", "#009e73", "#d55e00", "#cc79a7", "#e69f00", "#56b4e9")


@styled
def plot_tuning(tuning: Tuning) -> Figure:
    """Steps of the channels above; settling, overshoot, disk margin and noise below, with their requirements."""
    channels = [s.channel for s in tuning.compared[0].steps]
    figure = new_figure(7.4, 2.6 + 1.1 + 0.24 * len(tuning.compared))
    heights = [2.6, 1.1 + 0.24 * len(tuning.compared)]
    top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
    panels = top.subplots(1, len(channels), sharey=True, squeeze=False)[0]
    for j, (axes, channel) in enumerate(zip(panels, channels)):
        for k, tuned in enumerate(tuning.compared):
            draw_step(axes, tuned, j, COLOURS[k % len(COLOURS)])
        axes.set(title=f"Step on {channel}", xlabel="Time [s]")
        axes.set_xlim(0.0, shown_time(tuning))
    panels[0].set(ylabel="Response / step [-]", ylim=(-0.05, 1.35))
    draw_requirements(bottom, tuning)
    title = "No controller holds all requirements"
    if best := tuning.best:
        title = f"Fastest within the requirements: {best.name}, settles in {best.settling:.3g} s"
    top.suptitle(title, fontsize=10)
    return figure


def shown_time(tuning: Tuning) -> float:
    """End of the time axis [s]: a little beyond the settling time of the robot's own controller."""
    ends = [s.settling for t in tuning.compared for s in t.steps if np.isfinite(s.settling)]
    return min(1.15 * max(ends, default=np.inf), tuning.compared[0].steps[0].time[-1])


def draw_step(axes: Any, tuned: Tuned, channel: int, colour: str) -> None:
    """One channel's own response to its step."""
    step = tuned.steps[channel]
    start = step.output[0, channel]
    width = 1.1 if tuned.gains else 1.6
    axes.plot(step.time, (step.output[:, channel] - start) / step.size, color=colour, lw=width)
    axes.axhline(1.0, color="#444", lw=0.7, ls=(0, (4, 2)))


def draw_requirements(figure: Any, tuning: Tuning) -> None:
    """A row for each controller, a panel for each number; grey where the requirement is missed."""
    wanted, unit = tuning.requirements, tuning.noise_unit
    shown, factor = shown_unit(unit)
    noise = None if wanted.noise is None else factor * wanted.noise
    panels = (
        ("settling", 1.0, "Settling [s]", wanted.settling, False),
        ("overshoot", 100.0, "Overshoot [%]", 100.0 * wanted.overshoot, False),
        ("disk_margin", 1.0, "Disk margin [-]", wanted.disk_margin, True),
        ("noise", factor, f"Command noise [{shown}]", noise, False),
    )
    rows = np.arange(len(tuning.compared))
    for axes, (name, scale, label, limit, above) in zip(figure.subplots(1, 4, sharey=True), panels):
        values = np.array([scale * getattr(t, name) for t in tuning.compared])
        axes.barh(rows, np.nan_to_num(values), color=[COLOURS[k % len(COLOURS)] for k in rows], height=0.62)
        top = max([*values[np.isfinite(values)], limit or 0.0]) or 1.0
        for row, value in zip(rows, values):
            text = f"{value if value > SEEN * top else 0.0:.3g}" if np.isfinite(value) else "unstable"
            at = max(np.nan_to_num(value), 0.0) + 0.02 * top
            axes.text(at, row, text, va="center", fontsize=7, color=DARK, bbox=BOX)
        if limit is not None:
            axes.axvline(limit, color="black", lw=1.0, ls=(0, (3, 2)))
            side = 0.0 if above else limit
            axes.axvspan(side, limit if above else 1.6 * top, color=GREY, alpha=0.12, lw=0)
        axes.set(xlabel=label, xlim=(0.0, 1.35 * top), yticks=rows, yticklabels=[t.name for t in tuning.compared])
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
    figure.axes[0].invert_yaxis()
