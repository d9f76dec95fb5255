"""Figures of a loop's robustness: Nyquist with its disk, singular values with bands, root locus, delay budget."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.analysis.figure_style import DARK, FAINT, GREY, draw_damping_grid, styled
from exodrake.core.display import colour_of, shown_unit
from exodrake.data.plot import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from exodrake.analysis.closed_loop import ClosedLoop
    from exodrake.analysis.limit_cycles import LimitCycles
    from exodrake.analysis.margins import Margins

BAND_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
TICKS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
FACTORS = (0.02, 20.0)  # of the loop gain, along the root locus
BOX = {"fc": "white", "ec": "none", "pad": 1.0, "alpha": 0.85}


@styled
def plot_nyquist(result: ClosedLoop) -> Figure:
    """Nyquist curve of each channel, the disk that it must not enter, and the same of each drawn robot."""
    count = len(result.margins)
    figure = new_figure(max(3.4, min(7.0, 2.4 * count)), 3.0)
    for j, m in enumerate(result.margins):
        axes = figure.add_subplot(1, count, j + 1)
        for k, band in enumerate(result.bands):
            for member in band.members:
                loop = member.loops[:, j]
                axes.plot(np.real(loop), np.imag(loop), color=BAND_COLOURS[k], lw=0.4, alpha=0.5)
        draw_nyquist(axes, m, colour_of(m.channel, j, result.robot.machine))
        if j == 0:
            axes.set_ylabel("Im L")
    for k, band in enumerate(result.bands):
        figure.axes[0].plot([], [], color=BAND_COLOURS[k], lw=0.8, label=band.name)
    if result.bands:
        figure.legend(loc="outside lower center", ncols=len(result.bands))
    return figure


def draw_nyquist(axes: Any, m: Margins, colour: str) -> None:
    """One Nyquist curve for positive frequencies (full) and negative (dashed)."""
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    axes.plot(np.cos(turn), np.sin(turn), color=FAINT, lw=0.7)
    if np.isfinite(m.disk_margin):
        low = -(2.0 + m.disk_margin) / (2.0 - m.disk_margin) if m.disk_margin < 2.0 else -10.0
        high = -(2.0 - m.disk_margin) / (2.0 + m.disk_margin)
        middle, radius = 0.5 * (low + high), 0.5 * (high - low)
        axes.fill(middle + radius * np.cos(turn), radius * np.sin(turn), color="#f7b98d", alpha=0.6, lw=0)
    axes.plot(np.real(m.loop), np.imag(m.loop), color=colour, lw=1.4)
    axes.plot(np.real(m.loop), -np.imag(m.loop), color=colour, lw=0.8, ls=(0, (3, 2)))
    axes.plot(-1.0, 0.0, "+", color="black", ms=7, mew=1.4)
    unstable = f"{m.closed_unstable} unstable poles" if m.closed_unstable else "stable"
    words = f"encirclements {m.encirclements}\n{unstable}"
    if np.isfinite(m.disk_margin):
        words += f"\ndisk margin {m.disk_margin:.2f}"
    axes.text(0.03, 0.97, words, transform=axes.transAxes, va="top", fontsize=7.5, color=DARK, bbox=BOX)
    axes.set(xlim=(-2.6, 1.4), ylim=(-2.0, 2.0), aspect="equal", title=m.channel, xlabel="Re L")


@styled
def plot_robust(result: ClosedLoop) -> Figure:
    """Singular values of S and T, disk margin for all commands at once, and coupling, with bands."""
    figure = new_figure(7.0, 5.0)
    panels = figure.subplots(2, 2, sharex=True)
    curves = (("sigma_s", "max σ(S)"), ("sigma_t", "max σ(T)"), ("disk", "Disk margin, all commands"))
    for axes, (name, label) in zip(panels.flat, curves):
        for k, band in enumerate(result.bands):
            stable = [getattr(m, name) for m in band.members if m.stable]
            if stable:
                ends = np.min(stable, axis=0), np.max(stable, axis=0)
                look = {"color": BAND_COLOURS[k], "alpha": 0.25, "lw": 0, "label": band.name}
                axes.fill_between(result.robust.frequency, *ends, **look)
        axes.plot(result.robust.frequency, getattr(result.robust, name), color="black", lw=1.1, label="this robot")
        axes.set(ylabel=label, yscale="log", xscale="log")
    if len(result.opened.channels) > 1:
        draw_coupling(panels[1, 1], result)
    else:
        panels[1, 1].set_axis_off()
    panels[0, 0].set_ylim(bottom=0.02)
    panels[0, 1].set_ylim(0.09, 1.5 * max(1.0, float(result.robust.sigma_t.max())))
    panels[1, 0].set_ylim(0.3, 3.0)
    for axes in panels.flat:
        axes.set_xlim(result.robust.frequency[0], result.robust.frequency[-1])
        axes.set_yticks([tick for tick in TICKS if axes.get_ylim()[0] <= tick <= axes.get_ylim()[1]])
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("")
    for axes in panels[1]:
        axes.set_xlabel("Frequency [Hz]")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    if not result.robust.stable:
        figure.suptitle("not stable by its poles: S and T mean nothing", fontsize=9, color="#a83a12")
    return figure


def draw_coupling(axes: Any, result: ClosedLoop) -> None:
    """Diagonal of the relative gain array over frequency."""
    for j, name in enumerate(result.opened.channels):
        colour = colour_of(name, j, result.robot.machine)
        for band in result.bands[:1]:
            values = [m.gain_array[:, j] for m in band.members]
            if values:
                low, high = np.min(values, axis=0), np.max(values, axis=0)
                axes.fill_between(result.robust.frequency, low, high, color=colour, alpha=0.2, lw=0)
        axes.plot(result.robust.frequency, result.robust.gain_array[:, j], color=colour, label=name)
    axes.axhline(1.0, color=GREY, lw=0.7, ls=(0, (4, 2)))
    low, high = float(result.robust.gain_array.min()), float(result.robust.gain_array.max())
    axes.set(ylabel="|Relative gain|; 1: no coupling", xscale="log", yscale="log")
    axes.set_ylim(min(0.5, 0.8 * low), max(2.0, 1.3 * high))
    axes.legend(fontsize=7.5)


@styled
def plot_root_locus(result: ClosedLoop) -> Figure:
    """Poles while the gain of all commands grows together, in the unit circle."""
    figure = new_figure(5.4, 4.4)
    axes = figure.subplots()
    draw_damping_grid(axes, result.model.period)
    factors = np.geomspace(*FACTORS, 240)
    roots = [np.linalg.eigvals(result.opened.closed(g)) for g in factors]
    z, tint = np.concatenate(roots), np.repeat(np.log10(factors), [len(r) for r in roots])
    shown = np.abs(z) > 1e-3
    dots = axes.scatter(np.real(z[shown]), np.imag(z[shown]), c=tint[shown], s=3, cmap="viridis", lw=0, zorder=3)
    for matrix, mark, label in ((result.opened.A, "o", "open loop"), (result.opened.closed(), "x", "this robot")):
        poles = np.linalg.eigvals(matrix)
        axes.plot(np.real(poles), np.imag(poles), mark, mfc="none", mec="black", ms=5, mew=1.0, label=label, zorder=4)
    radius = np.array([np.abs(r).max() for r in roots])
    over = np.flatnonzero((radius > 1.0 + 1e-6) & (factors > 1.0))
    if result.robust.stable and len(over):
        axes.set_title(f"Root locus; unstable from {factors[over[0]]:.2g} of the loop gain")
    else:
        axes.set_title("Root locus over the gain of all commands")
    axes.set(xlim=(-1.35, 1.35), ylim=(-1.25, 1.25), aspect="equal", xlabel="Re z", ylabel="Im z")
    axes.grid(False)
    axes.legend(loc="lower left", fontsize=7.5, frameon=True, framealpha=0.9, edgecolor="none")
    ticks = (0.02, 0.1, 0.3, 1, 3, 10, 20)
    bar = figure.colorbar(dots, ax=axes, label="Factor on the loop gain", ticks=np.log10(ticks))
    bar.ax.set_yticklabels([f"{tick:g}" for tick in ticks])
    return figure


@styled
def plot_delays(result: ClosedLoop) -> Figure:
    """Delay of each channel, from its reading through its slots to the middle of the held command, and what is left."""
    figure = new_figure(7.0, 1.1 + 0.5 * len(result.delays))
    axes = figure.subplots()
    parts = (
        ("to_control", "reading to law", "#1f6f8b"), ("to_write", "law to plant", "#68a6b9"),
        ("hold", "half a held frame", "#c8e0e5"), ("margin", "margin left", "#e3e6ea"),
    )  # fmt: skip
    longest = 0.0
    for i, d in enumerate(result.delays):
        left = 0.0
        for name, label, colour in parts:
            width = 1e3 * getattr(d, name)
            if np.isfinite(width):
                axes.barh(i, width, left=left, color=colour, label=label if i == 0 else None, height=0.6)
                left += width
        longest = max(longest, left)
        slots = f"slots {d.read_slot} → {d.control_slot} → {d.write_slot}"
        rest = f", {d.spare_slots:.0f} slots to spare" if np.isfinite(d.spare_slots) else ""
        axes.text(left, i, f"  {slots}{rest}", va="center", fontsize=7.5, color=DARK)
    axes.set(yticks=range(len(result.delays)), yticklabels=[d.channel for d in result.delays], xlabel="Delay [ms]")
    axes.set_xlim(0.0, 1.45 * longest)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    figure.legend(loc="outside upper center", ncols=4)
    return figure


@styled
def plot_limit_cycles(cycles: tuple[LimitCycles, ...]) -> Figure:
    """Amplitude of each limit cycle over the loop gain: describing function as lines, simulation as dots."""
    figure = new_figure(max(4.0, 2.5 * len(cycles)), 3.0)
    panels = figure.subplots(1, len(cycles), squeeze=False)[0]
    for axes, c in zip(panels, cycles):
        factor = shown_unit(c.unit)[1]
        axes.plot(c.factor, factor * c.amplitude, "-", color="#0072b2", label="describing function")
        still, lost = c.swing == 0.0, np.isinf(c.swing)
        moving = ~still & ~lost
        lowest, top = 0.6 * factor * c.amplitude[0], factor * max(c.amplitude[-1], c.swing[moving].max(initial=0.0))
        dots = {"ms": 4, "color": "#d55e00"}
        axes.plot(c.factors[moving], factor * c.swing[moving], "o", label="simulated", **dots)
        axes.plot(c.factors[still], np.full(still.sum(), lowest), "o", mfc="none", label="simulated, at rest", **dots)
        axes.plot(c.factors[lost], np.full(lost.sum(), top), "^", label="simulated, grows", **dots)
        axes.axvline(c.limit, color=GREY, lw=0.8, ls=(0, (4, 2)), label="linear limit")
        axes.axvline(1.0, color=FAINT, lw=0.8, label="this robot's gain")
        axes.set(xlabel="Factor on the loop gain", yscale="log", xlim=(0.0, 1.4 * c.limit))
        axes.set_ylim(0.45 * factor * c.amplitude[0], 1.5 * top)
        axes.set_title(f"{c.label}\n({c.channel})", fontsize=8.5)
    panels[0].set_ylabel(f"Amplitude of the command [{shown_unit(cycles[0].unit)[0]}]")
    shown = {label: line for axes in panels for line, label in zip(*axes.get_legend_handles_labels())}
    figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=min(3, 2 * len(cycles)), fontsize=8)
    return figure
