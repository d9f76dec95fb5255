"""Figure of the stability map: spectral radius over two gains, and over added command latency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from exodrake.analysis.closed_loop import ClosedLoop
from exodrake.analysis.figure_style import styled
from exodrake.analysis.stability_map import LatencySweep
from exodrake.core.display import shown_unit
from exodrake.core.robot import Robot
from exodrake.data.plot import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVELS = [0.90, 0.92, 0.94, 0.96, 0.98, 1.0, 1.1, 1.25, 1.5, 2.0]  # of the spectral radius
INSIDE = ["#1f6f8b", "#3f8aa3", "#68a6b9", "#97c3cf", "#c8e0e5"]
OUTSIDE = ["#fde3cf", "#f7b98d", "#ec8c55", "#d7602f"]


@styled
def plot_stability(result: ClosedLoop) -> Figure:
    """Spectral radius over two gains with its boundary, and over added command latency."""
    latency = result.latency
    figure = new_figure(7.0 if latency else 4.4, 3.3)
    panels = figure.subplots(1, 2, width_ratios=[1.45, 1.0]) if latency else [figure.subplots()]
    draw_gains(figure, panels[0], result)
    if latency:
        draw_latency(panels[1], latency, result.model.period)
    return figure


def draw_gains(figure: Figure, axes: Any, result: ClosedLoop) -> None:
    """Spectral radius over the gains; blue stable, orange not, the boundary black."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    gains, robot = result.gains, result.robot
    labels, scales = zip(*(gain_label(robot, name) for name in gains.names))
    x, y = scales[0] * gains.first, scales[1] * gains.second
    nominal = scales[0] * gains.nominal[0], scales[1] * gains.nominal[1]
    colours = ListedColormap(INSIDE + OUTSIDE).with_extremes(under="#0b5570", over="#a83a12")
    norm = BoundaryNorm(LEVELS, colours.N)
    filled = axes.contourf(x, y, gains.radius, LEVELS, cmap=colours, norm=norm, extend="both")
    if gains.radius.min() < 1.0 < gains.radius.max():
        axes.contour(x, y, gains.radius, [1.0], colors="black", linewidths=1.4)
    if y[0] < 0.0:
        axes.axhline(0.0, color="#555", lw=0.6, ls=(0, (4, 2)))
    if x[0] <= nominal[0] <= x[-1] and y[0] <= nominal[1] <= y[-1]:
        axes.plot(*nominal, "o", ms=6, mfc="white", mec="black", label="this robot")
        axes.legend(loc="upper right", frameon=True, framealpha=0.9, edgecolor="none")
    axes.set(xlabel=labels[0], ylabel=labels[1], title="Spectral radius; black line: 1", xlim=(x[0], x[-1]))
    axes.grid(False)
    figure.colorbar(filled, ax=axes, ticks=LEVELS, format="%g")


def gain_label(robot: Robot, name: str) -> tuple[str, float]:
    """Label of a gain's axis with the unit shown, and its factor from SI."""
    unit = robot.machine.parameters[robot.indices(name)[0]].unit
    shown, factor = shown_unit(unit)
    if shown == unit and unit.startswith("m/"):  # a gain in metres per something is shown in millimetres
        shown, factor = "m" + unit, 1e3
    return f"{name.rsplit('.', 1)[-1]} [{shown}]", factor


def draw_latency(axes: Any, latency: LatencySweep, period: float) -> None:
    """Spectral radius over added latency, its limit marked."""
    axes.plot(latency.frames, latency.radius, color="#0072b2")
    axes.axhline(1.0, color="black", lw=0.9)
    axes.set_ylabel("Spectral radius")
    if latency.limit > 0.0:  # neither nan nor unstable from the start
        axes.plot(latency.limit, 1.0, "o", ms=6, mfc="white", mec="black")
        words = f"{latency.limit:.1f} frames\n({1e3 * period * latency.limit:.0f} ms)"
        axes.annotate(words, (latency.limit, 1.0), xytext=(-8, 8), textcoords="offset points", ha="right", fontsize=8)
    axes.set(xlabel="Added latency [frames]", title="Latency of all commands", xlim=(0.0, latency.frames[-1]))
