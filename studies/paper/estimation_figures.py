"""The drawings of Fig. 10 and 11."""

from typing import Any

import numpy as np

from exodrake.data.plot import new_figure
from exodrake.machines.exo_index.machine import COLOURS
from exodrake.report.blocks import AFTER, BEFORE, MEASURED, RULE, SOFT, house_style, render_svg
from studies.paper.study import DATA, MODEL, Study

DRAWN = 1000  # rows that are drawn, about
SHOWN = 1  # joint of Fig. 11 a: PIP


def thinned(found: Study) -> np.ndarray:
    """Rows that are drawn."""
    return np.arange(0, len(found.held), max(1, len(found.held) // DRAWN))


def figure_10(found: Study) -> str:
    """Estimate and measured angle over the samples, and one against the other, a row per joint."""
    rows = thinned(found)
    with house_style():
        drawn = new_figure(9.6, 6.6)
        panels = drawn.subplots(3, 2, width_ratios=(3.4, 1))
        for joint, name in enumerate(found.held.joints):
            left, right = panels[joint]
            course(left, found, rows, joint)
            estimate, spread = found.mean[rows, joint], 2.0 * found.std[rows, joint]
            left.fill_between(rows, estimate - spread, estimate + spread, color=AFTER, alpha=0.18, lw=0)
            left.plot(rows, estimate, color=AFTER, lw=0.9, label="estimated")
            left.set_ylabel(f"{name} [rad]")
            cloud(right, found.held.angle[rows, joint], estimate, AFTER)
            right.set_title(f"RMSE {found.worn.rmse[DATA][joint]:.3f} rad", fontsize=8.5)
        panels[0, 0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        panels[-1, 0].set_xlabel("sample")
        panels[-1, 1].set_xlabel("measured [rad]")
        return render_svg(drawn, "ten", "estimated and measured joint angles on held-out sweeps")


def figure_11(found: Study) -> str:
    """Data-driven and model-based estimate: over the samples, against measured, and their RMSE."""
    rows = thinned(found)
    with house_style():
        drawn = new_figure(9.6, 5.4)
        panels = drawn.subplot_mosaic([["a", "a", "a"], ["b", "c", "d"]], height_ratios=(1, 1.15))
        course(panels["a"], found, rows, SHOWN)
        panels["a"].plot(rows, found.model[rows, SHOWN], color=BEFORE, lw=1.0, label="constant stiffness")
        panels["a"].plot(rows, found.mean[rows, SHOWN], color=AFTER, lw=1.0, label="data-driven")
        panels["a"].set_ylabel(f"{found.held.joints[SHOWN]} [rad]")
        panels["a"].set_xlabel("sample")
        panels["a"].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
        panels["a"].set_title("(a)")
        for name, title, guess in (("b", "(b) data-driven", found.mean), ("c", "(c) model-based", found.model)):
            for joint, label in enumerate(found.held.joints):
                cloud(panels[name], found.held.angle[rows, joint], guess[rows, joint], COLOURS[label], label)
            panels[name].set_title(title)
            panels[name].set_xlabel("measured [rad]")
        limits(panels["b"], panels["c"])
        panels["b"].set_ylabel("estimated [rad]")
        panels["b"].legend(loc="upper left", markerscale=6, handletextpad=0.2)
        bars(panels["d"], found)
        return render_svg(drawn, "eleven", "data-driven against model-based estimates on held-out sweeps")


def course(axes: Any, found: Study, rows: np.ndarray, joint: int) -> None:
    """The measured angle, with a line where a new sweep begins."""
    for edge in np.flatnonzero(np.diff(found.held.sweep)):
        axes.axvline(edge + 0.5, color=RULE, lw=0.8)
    axes.plot(rows, found.held.angle[rows, joint], color=MEASURED, lw=1.4, label="measured")
    axes.set_xlim(0, len(found.held))


def cloud(axes: Any, measured: np.ndarray, estimate: np.ndarray, colour: str, label: str = "") -> None:
    """Estimate against measured, with the line on which they are equal."""
    axes.plot(measured, estimate, ".", ms=2, mew=0, color=colour, alpha=0.5, rasterized=True, label=label)
    ends = [measured.min(), measured.max()]
    axes.plot(ends, ends, color=SOFT, lw=0.8)
    axes.grid(color=RULE, lw=0.5)


def limits(*panels: Any) -> None:
    """The same ordinate for panels that are to be compared."""
    low, high = (np.array([p.get_ylim() for p in panels])[:, i] for i in (0, 1))
    for axes in panels:
        axes.set_ylim(low.min(), high.max())


def bars(axes: Any, found: Study) -> None:
    """RMSE per joint of both."""
    places = np.arange(len(found.held.joints))
    for shift, name, colour in ((-0.2, DATA, AFTER), (0.2, MODEL, BEFORE)):
        values = found.worn.rmse[name]
        axes.bar(places + shift, values, width=0.36, color=colour)
        for place, value in zip(places, values):
            axes.text(place + shift, value, f"{value:.3f}", ha="center", va="bottom", fontsize=7.5, color=SOFT)
    axes.set_xticks(places, found.held.joints)
    axes.set_title("(d) RMSE [rad]")
    axes.tick_params(axis="x", length=0)
