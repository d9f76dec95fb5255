"""Figures of a closed loop, its robustness and its limit cycles, and of a tuning."""

from operator import attrgetter
from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from exodrake.analysis.closed_loop import ClosedLoop
from exodrake.analysis.limit_cycles import LimitCycles
from exodrake.analysis.linear_model import evaluate
from exodrake.analysis.log_response import label_ticks
from exodrake.analysis.margins import close, decibel
from exodrake.analysis.robustness import Uncertainty
from exodrake.analysis.tuning import Tuning
from exodrake.data.plot import IMPROVED, STYLE, new_figure, render_png
from exodrake.model.display import choose_colour, find_display, shown_unit

FAINT, GREY, DARK = "#9aa2ad", "#5b6470", "#333333"
DASHED: dict[str, Any] = {"color": "#555", "lw": 0.7, "ls": (0, (4, 2))}
PLATE = {"boxstyle": "round,pad=0.1", "fc": "#f6f8fa", "ec": "none"}
TAG: dict[str, Any] = {"fontsize": 6.5, "color": GREY, "ha": "center", "va": "center"}
WHITE = {"fc": "white", "ec": "none", "pad": 1.0}
BOX = {**WHITE, "alpha": 0.85}
NOTE = {"va": "center", "fontsize": 8, "color": DARK, "bbox": WHITE}
BAND_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
CONTROLLERS = ("#5b6470", "#0072b2", "#009e73", "#d55e00", "#cc79a7", "#e69f00", "#56b4e9")
FACTORS = (0.02, 20.0)  # of the loop gain, along the root locus
LEVELS = [0.90, 0.92, 0.94, 0.96, 0.98, 1.0, 1.1, 1.25, 1.5, 2.0]  # of the spectral radius
INSIDE = ["#1f6f8b", "#3f8aa3", "#68a6b9", "#97c3cf", "#c8e0e5"]
OUTSIDE = ["#fde3cf", "#f7b98d", "#ec8c55", "#d7602f"]
IDLE = "the command does not act here"
CLEAN = 0.999  # coherence above which there is nothing to show
VISIBLE = 1e-4  # of a panel: below, the rest of a simulation


def channel_panels(
    result: ClosedLoop, title: str, heights: dict[str, float], xlabel: str, height: float, xscale: str = "linear"
) -> tuple[Figure, Any, list[str]]:
    """A figure so high [inches], its panels, and colours: a column for each channel, a row for each label's height."""
    channels = [m.channel for m in result.margins]
    figure = new_figure(min(7.0, 1.6 + 2.4 * len(channels)), height)
    shape: dict[str, Any] = {"sharex": True, "sharey": "row", "squeeze": False, "subplot_kw": {"xscale": xscale}}
    rows = figure.subplots(len(heights), len(channels), height_ratios=list(heights.values()), **shape)
    for axes, label in zip(rows[:, 0], heights):
        axes.set_ylabel(label)
    for top, bottom, channel in zip(rows[0], rows[-1], channels):
        top.set_title(title.format(channel))
        bottom.set_xlabel(xlabel)
    figure.align_ylabels(rows[:, 0])
    return figure, rows, [choose_colour(name, j, result.robot.machine) for j, name in enumerate(channels)]


def plot_steps(result: ClosedLoop) -> Figure:
    """Output of all channels when each reference steps, one panel per channel that is stepped."""
    loop = result.model.loop
    label = f"{find_display(loop.kinds[loop.loop.measured], loop.robot.machine).label} / step [-]"
    figure, (panels,), colours = channel_panels(result, "Step on {}", {label: 1.0}, "Time [s]", 2.7)
    slowest = max((s.settling for s in result.steps if np.isfinite(s.settling)), default=np.inf)
    shown = min(1.4 * slowest, result.steps[0].time[-1])
    changes = [(s.output - result.point.output) / s.size for s in result.steps]
    for axes, step, change in zip(panels, result.steps, changes):
        for name, course, colour in zip(loop.channels, change.T, colours):
            look = {"lw": 1.5} if name == step.channel else {"lw": 0.9, "alpha": 0.75}
            axes.plot(step.time, course, color=colour, label=name, **look)
        axes.plot([step.time[0], 0, 0, step.time[-1]], [0, 0, 1, 1], color="#444", lw=0.8, ls=(0, (4, 2)))
        axes.set_xlim(-0.04 * shown, shown)
        words = f"rise {step.rise:.3g} s\novershoot {100 * step.overshoot:.1f} %\nsettles in {step.settling:.3g} s"
        words = "\n".join(line for line in words.splitlines() if "nan" not in line)
        axes.text(0.97, 0.55, words, transform=axes.get_yaxis_transform(), ha="right", **NOTE)
    low, high = np.min(changes), np.max(changes)  # an unstable step must not hide the rest
    panels[0].set_ylim(max(low - 0.05, -1.0), min(max(high, 1.0) + 0.12, 2.5))
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=len(colours))
    return figure


def plot_bode(result: ClosedLoop) -> Figure:
    """Closed loop per channel: a line from the frame map, dots from the multisine; coherence where it is not 1."""
    heights, height = {"Gain [dB]": 1.4, "Phase [deg]": 1.2}, 4.2
    if any((r.coherence < CLEAN).any() for r in result.responses):
        heights, height = heights | {"Coherence [-]": 0.7}, 5.2
    figure, rows, colours = channel_panels(result, "{}: closed loop", heights, "Frequency [Hz]", height, "log")
    outputs = result.model.rows(result.model.loop.loop.measured)
    for j, (response, colour) in enumerate(zip(result.responses, colours)):
        (gain, phase, *coherence), f = rows[:, j], response.frequency
        size, fine, dots = np.abs(response.measured), np.geomspace(f[0], f[-1], 400), {"ms": 3, "color": colour}
        low, high = np.maximum(size - response.spread, 1e-6), size + response.spread
        gain.fill_between(f, decibel(low), decibel(high), color=colour, alpha=0.25, lw=0)
        if result.margins[j].acts:
            linear = evaluate(result.model.system[outputs[j], j], fine)[:, 0, 0]
            gain.plot(fine, decibel(np.abs(linear)), color="black", lw=0.9, label="frame map")
            phase.plot(fine, np.degrees(np.unwrap(np.angle(linear))), color="black", lw=0.9)
        else:
            gain.text(0.97, 0.93, IDLE, transform=gain.transAxes, ha="right", **NOTE)
        gain.plot(f, decibel(size), ".", label="multisine", **dots)
        phase.plot(f, np.unwrap(np.angle(np.where(size, response.measured, np.nan), deg=True), period=360), ".", **dots)
        for axes in coherence:
            axes.plot(f, response.coherence, ".", **dots)
            axes.set_ylim(-0.05, 1.08)
        if np.isfinite(response.bandwidth):
            gain.axvline(response.bandwidth, **DASHED)
            words = f"-3 dB at {response.bandwidth:.2f} Hz"
            gain.text(0.97, 0.93, words, transform=gain.transAxes, ha="right", **NOTE)
        gain.set_ylim(-42, 12)
        phase.set(ylim=(-400, 20), yticks=[-360, -270, -180, -90, 0])
        label_ticks(phase.xaxis)
    shown = {label: line for axes in rows[0][::-1] for line, label in zip(*axes.get_legend_handles_labels())}
    look: dict[str, Any] = {"frameon": True, "facecolor": "white", "edgecolor": "none", "framealpha": 1.0}
    rows[0, 0].legend(shown.values(), shown.keys(), loc="lower left", **look)
    return figure


def plot_margins(result: ClosedLoop) -> Figure:
    """Open loop of each channel, opened at its command, with gain and phase margins."""
    heights = {"|L| [dB]": 1.0, "arg L [deg]": 1.0}
    figure, rows, colours = channel_panels(result, "{}: open loop", heights, "Frequency [Hz]", 4.2, "log")
    for m, gain, phase, colour in zip(result.margins, *rows, colours):
        shown = (m.frequency >= 8e-4 * m.frequency[-1]) & (np.abs(m.loop) > 0.0)
        f, loop = m.frequency[shown], m.loop[shown]
        gain.plot(f, decibel(np.abs(loop)), color=colour)
        phase.plot(f, np.degrees(np.unwrap(np.angle(loop))), color=colour)
        for axes, limit in ((gain, 0.0), (phase, -180.0)):
            axes.axhline(limit, color="black", lw=0.8)
            if np.isfinite(m.crossover):
                axes.axvline(m.crossover, **DASHED)
        lines = [f"gain {m.gain_margin_db:.1f} dB"] if np.isfinite(m.gain_margin_db) else []
        lines += [f"and down to {m.gain_low_db:.1f} dB"] if np.isfinite(m.gain_low_db) else []
        if np.isfinite(m.delay_margin):
            lines += [f"phase {m.phase_margin_deg:.0f} deg at {m.crossover:.2f} Hz"]
            lines += [f"delay {1e3 * m.delay_margin:.3g} ms"]
        words = ("unstable poles: no margins" if m.closed_unstable else "\n".join(lines)) if m.acts else IDLE
        phase.text(0.04, 0.05, words, transform=phase.transAxes, fontsize=8, color=DARK, bbox=WHITE)
        gain.set_ylim(-25, 45)
        phase.set(yticks=[-360, -270, -180, -90], ylim=(-390, -45))
        label_ticks(phase.xaxis)
    return figure


def plot_nyquist(result: ClosedLoop) -> Figure:
    """Nyquist curves of each channel and drawn robot, negative frequencies dashed; they must not enter the disk."""
    figure, (panels,), _ = channel_panels(result, "{}", {"Im L": 1.0}, "Re L", 3.3)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    for j, (m, axes) in enumerate(zip(result.margins, panels)):
        for k, band in enumerate(result.bands):
            for member in band.members:
                loop = member.loops[:, j]
                axes.plot(np.real(loop), np.imag(loop), color=BAND_COLOURS[k], lw=0.4, alpha=0.5)
        axes.plot(np.cos(turn), np.sin(turn), color=FAINT, lw=0.7)
        words = f"encirclements {m.encirclements}\n" if m.acts else f"{IDLE}\n"
        words += f"{m.closed_unstable} unstable poles" if m.closed_unstable else "stable"
        if np.isfinite(m.disk_margin):
            low = -(2.0 + m.disk_margin) / (2.0 - m.disk_margin) if m.disk_margin < 2.0 else -10.0
            high = -(2.0 - m.disk_margin) / (2.0 + m.disk_margin)
            middle, radius = 0.5 * (low + high), 0.5 * (high - low)
            axes.fill(middle + radius * np.cos(turn), radius * np.sin(turn), color="#f7b98d", alpha=0.6, lw=0)
            words += f"\ndisk margin {m.disk_margin:.2f}"
        axes.plot(np.real(m.loop), np.imag(m.loop), color="black", lw=1.4, label="this robot")
        axes.plot(np.real(m.loop), -np.imag(m.loop), color="black", lw=0.8, ls=(0, (3, 2)))
        axes.plot(-1.0, 0.0, "+", color="black", ms=7, mew=1.4)
        axes.text(0.03, 0.97, words, transform=axes.transAxes, va="top", fontsize=7.5, color=DARK, bbox=BOX)
        axes.set(xlim=(-2.6, 1.4), ylim=(-2.0, 2.0), aspect="equal")
    for k, band in enumerate(result.bands):
        panels[0].plot([], [], color=BAND_COLOURS[k], lw=0.8, label=band.name)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def plot_robust(result: ClosedLoop) -> Figure:
    """Singular values of S and T, disk margin for all commands at once, and coupling, with bands."""
    figure = new_figure(7.0, 5.0)
    panels, frequency = figure.subplots(2, 2, sharex=True), result.robust.frequency

    def fill(axes: Any, curves: list[np.ndarray], **look: Any) -> None:
        """The range of the curves (f,) [-] of a band's members."""
        if curves:
            axes.fill_between(frequency, np.min(curves, axis=0), np.max(curves, axis=0), lw=0, **look)

    curves = (("sigma_s", "max σ(S)"), ("sigma_t", "max σ(T)"), ("disk", "Disk margin, all commands"))
    for axes, (name, label) in zip(panels.flat, curves):
        for k, band in enumerate(result.bands):
            stable = [getattr(m, name) for m in band.members if m.stable]
            fill(axes, stable, color=BAND_COLOURS[k], alpha=0.25, label=band.name)
        axes.plot(frequency, getattr(result.robust, name), color="black", lw=1.1, label="this robot")
        axes.set(ylabel=label, yscale="log", xscale="log")
    coupling, gains = panels[1, 1], result.robust.gain_array  # its diagonal over frequency
    coupling.set_visible(len(result.margins) > 1)
    for j, m in enumerate(result.margins):
        colour = choose_colour(m.channel, j, result.robot.machine)
        drawn = [member.gain_array[:, j] for band in result.bands[:1] for member in band.members]
        fill(coupling, drawn, color=colour, alpha=0.2)
        coupling.plot(frequency, gains[:, j], color=colour, label=m.channel)
    coupling.legend(fontsize=7.5)
    coupling.axhline(1.0, **DASHED)
    coupling.set(ylabel="|Relative gain|; 1: no coupling", xscale="log", yscale="log")
    coupling.set_ylim(min(0.5, 0.8 * float(gains[gains > 0.0].min(initial=1.0))), max(2.0, 1.3 * float(gains.max())))
    panels[0, 0].set_ylim(bottom=0.02)
    panels[0, 1].set_ylim(0.09, 1.5 * max(1.0, float(result.robust.sigma_t.max())))
    panels[1, 0].set_ylim(0.3, 3.0)
    for axes in panels.flat:
        axes.set_xlim(frequency[0], frequency[-1])
        label_ticks(axes.xaxis, axes.yaxis)
    for axes in panels[1]:
        axes.set_xlabel("Frequency [Hz]")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def plot_root_locus(result: ClosedLoop) -> Figure:
    """Poles in the z plane over the gain of all commands; thin: constant damping (full) and frequency (dotted)."""
    figure = new_figure(5.4, 4.4)
    axes, turn = figure.subplots(), np.linspace(0.0, 2.0 * np.pi, 400)
    axes.fill(np.cos(turn), np.sin(turn), color="#f6f8fa", zorder=0)
    axes.plot(np.cos(turn), np.sin(turn), color="#333", lw=1.0)
    for damping in (0.1, 0.2, 0.4, 0.6, 0.8):
        end = np.pi / np.sqrt(1.0 - damping**2)
        z = np.exp(np.linspace(0.0, end, 200) * (-damping + 1j * np.sqrt(1.0 - damping**2)))
        axes.plot(np.real([z, z]).T, np.imag([z, z.conj()]).T, color=FAINT, lw=0.5)
        tag = z[np.argmin(np.abs(np.angle(z) - 0.82 * np.pi))]
        if damping < 0.7:  # further in, poles crowd the tag
            axes.text(tag.real, tag.imag, f"ζ {damping:g}", bbox=PLATE, **TAG)
    for share in (0.1, 0.2, 0.3, 0.4, 0.6, 0.8):  # of the Nyquist frequency
        s = share * np.pi * np.exp(1j * np.linspace(np.pi / 2.0, np.pi, 100))
        z = np.exp(s[np.abs(s.imag) <= np.pi])
        axes.plot(np.real([z, z]).T, np.imag([z, z.conj()]).T, color=FAINT, lw=0.5, ls=(0, (1, 1.5)))
        axes.text(1.08 * z[0].real, 1.06 * z[0].imag, f"{share * 0.5 / result.model.system.dt:g} Hz", **TAG)
    factors = np.geomspace(*FACTORS, 240)
    roots = np.array([np.linalg.eigvals(close(result.opened, g)) for g in factors])
    z, tint = roots[np.abs(roots) > 1e-3], np.log10(factors)[np.nonzero(np.abs(roots) > 1e-3)[0]]
    dots = axes.scatter(np.real(z), np.imag(z), c=tint, s=3, cmap="viridis", lw=0, zorder=3)
    loop = result.opened[: result.opened.ninputs, :]
    marks = ((loop.poles(), "x", "open-loop poles"), (loop.zeros(), "o", "open-loop zeros"),
             (np.linalg.eigvals(close(result.opened)), "s", "poles of this robot"))  # fmt: skip
    for z, mark, label in marks:
        z = z[(np.abs(z) > 1e-3) & (np.abs(z) < 2.0)]
        axes.plot(np.real(z), np.imag(z), mark, mfc="none", mec="black", ms=4.5, mew=0.9, label=label, zorder=4)
    over = np.flatnonzero((np.abs(roots).max(axis=1) > 1.0 + 1e-6) & (factors > 1.0))
    title = "Root locus over the gain of all commands"
    if result.robust.stable and len(over):
        title = f"Root locus; unstable from {factors[over[0]]:.2g} of the loop gain"
    axes.set(xlim=(-1.35, 1.35), ylim=(-1.25, 1.25), aspect="equal", xlabel="Re z", ylabel="Im z", title=title)
    axes.grid(False)
    axes.legend(loc="lower left", fontsize=7.5, frameon=True, framealpha=0.9, edgecolor="none")
    ticks, label = np.log10([0.02, 0.1, 0.3, 1, 3, 10, 20]), "Factor on the loop gain"
    figure.colorbar(dots, ax=axes, label=label, ticks=ticks, format=lambda tick, _: f"{10.0**tick:g}")
    return figure


def plot_delays(result: ClosedLoop) -> Figure:
    """Delay of each channel, from its reading through its slots to the middle of the held command, and what is left."""
    figure = new_figure(7.0, 1.1 + 0.5 * len(result.delays))
    axes = figure.subplots()
    parts = (
        ("to_control", "reading to law", "#1f6f8b"), ("to_write", "law to plant", "#68a6b9"),
        ("hold", "half a held frame", "#c8e0e5"), ("margin", "margin left", "#e3e6ea"),
    )  # fmt: skip
    left = np.zeros(len(result.delays))
    for name, label, colour in parts:
        widths = np.nan_to_num([1e3 * getattr(d, name) for d in result.delays], posinf=0.0)
        axes.barh(range(len(left)), widths, left=left, color=colour, label=label, height=0.6)
        left = left + widths
    for i, d in enumerate(result.delays):
        slots = "slots {} → {} → {}".format(*d.slots)
        rest = f", {d.spare_slots:.0f} slots to spare" if np.isfinite(d.spare_slots) else ""
        axes.text(left[i], i, f"  {slots}{rest}", va="center", fontsize=7.5, color=DARK)
    axes.set(yticks=range(len(result.delays)), yticklabels=[d.channel for d in result.delays], xlabel="Delay [ms]")
    axes.set_xlim(0.0, 1.45 * left.max())
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    figure.legend(loc="outside upper center", ncols=4)
    return figure


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
        axes.axvline(c.limit, **DASHED, label="linear limit")
        axes.axvline(1.0, color=FAINT, lw=0.8, label="this robot's gain")
        axes.set(xlabel="Factor on the loop gain", yscale="log", xlim=(0.0, 1.4 * c.limit))
        axes.set_ylim(0.45 * factor * c.amplitude[0], 1.5 * top)
        label_ticks(axes.yaxis)
        axes.set_title(f"{c.label} ({c.channel})".replace(" + ", "\n+ "), fontsize=8.5)
    panels[0].set_ylabel(f"Amplitude of the command [{shown_unit(cycles[0].unit)[0]}]")
    shown = {label: line for axes in panels for line, label in zip(*axes.get_legend_handles_labels())}
    figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=min(3, 2 * len(cycles)), fontsize=8)
    return figure


def plot_stability(result: ClosedLoop) -> Figure:
    """Spectral radius over two gains, blue stable, orange not, the boundary black, and over added command latency."""
    latency, gains, robot = result.latency, result.gains, result.robot
    figure = new_figure(7.0 if latency else 4.4, 3.3)
    panels = figure.subplots(1, 2, width_ratios=[1.45, 1.0]) if latency else [figure.subplots()]
    axes, labels, scales = panels[0], [], []
    for name in gains.names:
        unit = robot.machine.parameters[robot.indices(name)[0]].unit
        shown, factor = shown_unit(unit)
        if shown == unit and unit.startswith("m/"):  # a gain in metres per something is shown in millimetres
            shown, factor = "m" + unit, 1e3
        labels.append(f"{name.rsplit('.', 1)[-1]} [{shown}]")
        scales.append(factor)
    x, y = scales[0] * gains.first, scales[1] * gains.second
    nominal = scales[0] * gains.nominal[0], scales[1] * gains.nominal[1]
    colours = ListedColormap(INSIDE + OUTSIDE).with_extremes(under="#0b5570", over="#a83a12")
    norm = BoundaryNorm(LEVELS, colours.N)
    filled = axes.contourf(x, y, gains.radius, LEVELS, cmap=colours, norm=norm, extend="both")
    if gains.radius.min() < 1.0 < gains.radius.max():
        axes.contour(x, y, gains.radius, [1.0], colors="black", linewidths=1.4)
    if y[0] < 0.0:
        axes.axhline(0.0, **DASHED)
    if x[0] <= nominal[0] <= x[-1] and y[0] <= nominal[1] <= y[-1]:
        axes.plot(*nominal, "o", ms=6, mfc="white", mec="black", label="this robot")
        axes.legend(loc="upper right", frameon=True, framealpha=0.9, edgecolor="none")
    axes.set(xlabel=labels[0], ylabel=labels[1], title="Spectral radius; black line: 1", xlim=(x[0], x[-1]))
    axes.grid(False)
    figure.colorbar(filled, ax=axes, ticks=LEVELS, format="%g")
    if latency:
        axes, limit = panels[1], latency.limit
        axes.plot(latency.frames, latency.radius, color="#0072b2")
        axes.axhline(1.0, color="black", lw=0.9)
        axes.set_ylabel("Spectral radius")
        if limit > 0.0:  # neither nan nor unstable from the start
            axes.plot(limit, 1.0, "o", ms=6, mfc="white", mec="black")
            words = f"{limit:.1f} frames\n({1e3 * result.model.system.dt * limit:.0f} ms)"
            axes.annotate(words, (limit, 1.0), xytext=(-8, 8), textcoords="offset points", ha="right", fontsize=8)
        axes.set(xlabel="Added latency [frames]", title="Latency of all commands", xlim=(0.0, latency.frames[-1]))
    return figure


@matplotlib.rc_context(STYLE)
def plot_tuning(tuning: Tuning) -> Figure:
    """Steps of the channels; settling, overshoot, disk margin and noise of each controller, grey where missed."""
    channels = [s.channel for s in tuning.compared[0].steps]
    heights = [2.6, 1.1 + 0.24 * len(tuning.compared)]
    figure = new_figure(7.4, sum(heights))
    top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
    panels = top.subplots(1, len(channels), sharey=True, squeeze=False)[0]
    settled = [s.settling for t in tuning.compared for s in t.steps if np.isfinite(s.settling)]
    end = min(1.15 * max(settled, default=np.inf), tuning.compared[0].steps[0].time[-1])
    highest = 1.35 / 1.05
    for j, (axes, channel) in enumerate(zip(panels, channels)):
        for k, tuned in enumerate(tuning.compared):
            step, look = tuned.steps[j], {"color": CONTROLLERS[k % len(CONTROLLERS)], "lw": 1.1 if tuned.gains else 1.6}
            share = (step.output[:, j] - step.output[0, j]) / step.size
            highest = max(highest, float(np.nanmax(share)))
            axes.plot(step.time, share, **look)
        axes.axhline(1.0, **DASHED)
        axes.set(title=f"Step on {channel}", xlabel="Time [s]", xlim=(0.0, end))
    panels[0].set(ylabel="Response / step [-]", ylim=(-0.05, min(1.05 * highest, 2.2)))
    title = "No controller holds all requirements"
    if best := tuning.best:
        title = f"Fastest within the requirements: {best.name}, settles in {best.settling:.3g} s"
    top.suptitle(title, fontsize=10)
    wanted, (shown, factor) = tuning.requirements, shown_unit(tuning.noise_unit)
    noise = None if wanted.noise is None else factor * wanted.noise
    numbers = (
        ("settling", 1.0, "Settling [s]", wanted.settling, False),
        ("overshoot", 100.0, "Overshoot [%]", 100.0 * wanted.overshoot, False),
        ("disk_margin", 1.0, "Disk margin [-]", wanted.disk_margin, True),
        ("noise", factor, f"Command noise [{shown}]", noise, False),
    )
    rows = np.arange(len(tuning.compared))
    for axes, (name, scale, label, limit, above) in zip(bottom.subplots(1, 4, sharey=True), numbers):
        values = np.array([scale * getattr(t, name) for t in tuning.compared])
        axes.barh(rows, np.nan_to_num(values), color=[CONTROLLERS[k % len(CONTROLLERS)] for k in rows], height=0.62)
        top = max([*values[np.isfinite(values)], limit or 0.0]) or 1.0
        for row, value in zip(rows, values):
            text = f"{value if value > VISIBLE * top else 0.0:.3g}" if np.isfinite(value) else "-"
            at = max(np.nan_to_num(value), 0.0) + 0.02 * top
            axes.text(at, row, text, va="center", fontsize=7, color=DARK, bbox=BOX)
        if limit is not None:
            axes.axvline(limit, color="black", lw=1.0, ls=(0, (3, 2)))
            axes.axvspan(limit, 0.0 if above else 1.6 * top, color=GREY, alpha=0.12, lw=0)
        axes.set(xlabel=label, xlim=(0.0, 1.35 * top), yticks=rows, yticklabels=[t.name for t in tuning.compared])
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
    bottom.axes[0].invert_yaxis()
    return figure


def plot_uncertainty(found: Uncertainty) -> Figure:
    """Deviation of the robots of an answer with the weight that covers it; margins over amplitude with friction."""
    figure = new_figure(7.0 if found.cycles else 4.0, 3.0)
    panels = figure.subplots(1, 3 if found.cycles else 1, squeeze=False)[0]
    f = np.geomspace(found.frequency[0], found.frequency[-1], 200)
    panels[0].plot(found.frequency, found.deviation, ".", ms=3, color=GREY, label="robots of the answer")
    panels[0].plot(f, np.abs(found.weight(2j * np.pi * f)), color="black", lw=1.1, label="weight")
    panels[0].set(xscale="log", yscale="log", xlabel="Frequency [Hz]", ylabel="Relative deviation of the plant [-]")
    label_ticks(panels[0].xaxis, panels[0].yaxis)
    above: dict[str, Any] = {"fontsize": 7.5, "loc": "lower left", "bbox_to_anchor": (0.0, 1.0)}
    panels[0].legend(**above)
    thin: dict[str, Any] = {"lw": 0.9, "marker": ".", "ms": 3}
    ends = {"lower ends": thin | {"color": "#009e73"}, "upper ends": thin | {"color": "#cc79a7"}}
    ends = {"improved robot": IMPROVED, **ends}
    curves = (
        ("Gain margin [dB]", found.list_worst("gain_margin_db"), lambda c: decibel(c.factor)),
        ("Phase margin [deg]", found.list_worst("least_phase_deg"), attrgetter("phase_margin_deg")),
    )
    for axes, (name, cycles, margin) in zip(panels[1:], curves):
        unit, factor = shown_unit(cycles[0].unit)
        for cycle, (label, line) in reversed(list(zip(cycles, ends.items()))):  # the improved robot above the ends
            axes.plot(factor * cycle.amplitude, margin(cycle), **line, label=label)
        axes.set(xscale="log", xlabel=f"Command of {cycles[0].channel} [{unit}]", ylabel=name)
        axes.axhline(0.0, color="black", lw=0.8)
        label_ticks(axes.xaxis)
    if found.cycles:
        panels[1].legend(**above)
        panels[2].set_visible(np.isfinite(found.phase_margin_deg))
    return figure


def draw_figures(result: ClosedLoop, cycles: tuple[LimitCycles, ...] = ()) -> dict[str, bytes]:
    """File name -> PNG of every figure with something in it: no margins where no command acts, as of stuck joints."""
    by_runs, by_poles = [plot_steps, plot_bode, plot_delays], [plot_stability]
    if any(m.acts for m in result.margins):
        by_poles += [plot_margins, plot_nyquist, plot_robust, plot_root_locus]
    with matplotlib.rc_context(STYLE):
        drawn = {plot.__name__.removeprefix("plot_"): plot(result) for plot in (*by_runs, *by_poles)}
        for plot in () if result.robust.stable else by_poles:
            words = "unstable: no margins" if result.model.decides else "here poles, margins and maps mean little"
            drawn[plot.__name__.removeprefix("plot_")].suptitle(words, fontsize=9, color="#a83a12")
        drawn |= {"limit_cycles": plot_limit_cycles(cycles)} if cycles else {}
        drawn |= {"uncertainty": plot_uncertainty(result.uncertainty)} if result.uncertainty else {}
    return {f"{name}.png": render_png(figure) for name, figure in drawn.items()}
