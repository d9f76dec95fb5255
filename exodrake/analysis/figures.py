"""Figures of a closed loop: steps, poles, stability maps, frequency response, open loops."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.analysis.closed_loop import ClosedLoop
from exodrake.analysis.figure_style import DARK, draw_damping_grid, styled
from exodrake.analysis.frequency_response import FrequencyResponse, closed_response
from exodrake.analysis.limit_cycles import LimitCycles
from exodrake.analysis.margins import Margins
from exodrake.analysis.robustness_figures import (
    plot_delays,
    plot_limit_cycles,
    plot_nyquist,
    plot_robust,
    plot_root_locus,
)
from exodrake.analysis.stability_map_figure import plot_stability
from exodrake.analysis.step_response import StepResponse
from exodrake.core.display import colour_of, display_of
from exodrake.data.plot import new_figure, png_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WHITE = {"fc": "white", "ec": "none", "pad": 1.0}
NOTE = {"va": "center", "fontsize": 8, "color": DARK, "bbox": WHITE}


@styled
def plot_steps(result: ClosedLoop) -> Figure:
    """Output of all channels when each reference steps, one panel per channel that is stepped."""
    figure = new_figure(max(4.0, min(7.0, 1.0 + 2.0 * len(result.steps))), 2.7)
    panels = figure.subplots(1, len(result.steps), sharey=True, squeeze=False)[0]
    slowest = max((s.settling for s in result.steps if np.isfinite(s.settling)), default=np.inf)
    shown = min(1.4 * slowest, result.steps[0].time[-1])
    channels = result.opened.channels
    for axes, step in zip(panels, result.steps):
        change = (step.output - result.point.output) / step.size
        for j, name in enumerate(channels):
            look = {"lw": 1.5} if name == step.channel else {"lw": 0.9, "alpha": 0.75}
            axes.plot(step.time, change[:, j], color=colour_of(name, j, result.robot.machine), label=name, **look)
        axes.plot([step.time[0], 0, 0, step.time[-1]], [0, 0, 1, 1], color="#444", lw=0.8, ls=(0, (4, 2)))
        axes.set(xlim=(-0.04 * shown, shown), xlabel="Time [s]", title=f"Step on {step.channel}")
        axes.text(0.97, 0.55, step_words(step), transform=axes.transAxes, ha="right", **NOTE)
    panels[0].set(
        ylabel=f"{display_of(output_kind(result), result.robot.machine).label} / step [-]", ylim=panel_limits(result)
    )
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=len(channels))
    return figure


def panel_limits(result: ClosedLoop) -> tuple[float, float]:
    """Ordinates that show every step without letting an unstable one hide the rest."""
    change = [(s.output - result.point.output) / s.size for s in result.steps]
    low, high = min(float(c.min()) for c in change), max(float(c.max()) for c in change)
    return max(low - 0.05, -1.0), min(max(high, 1.0) + 0.12, 2.5)


def step_words(step: StepResponse) -> str:
    """Figures of a step in three lines."""
    lines = [f"rise {step.rise:.3g} s", f"overshoot {100 * step.overshoot:.1f} %", f"settles in {step.settling:.3g} s"]
    return "\n".join(line for line in lines if "nan" not in line)


def output_kind(result: ClosedLoop) -> str:
    """Kind of the columns that show the loop's reading."""
    machine = result.robot.machine
    assert machine.loop is not None
    return next(c.kind for c in machine.columns if c.signal == machine.loop.measured)


@styled
def plot_poles(result: ClosedLoop) -> Figure:
    """Poles in the unit circle, with curves of equal damping and equal frequency."""
    figure = new_figure(4.6, 4.4)
    axes = figure.subplots()
    draw_damping_grid(axes, result.model.period)
    z = np.array([pole.z for pole in result.model.poles()])
    inside = np.abs(z) < 1.0
    for shown, colour, size, width in ((z[inside], "#0072b2", 6, 1.4), (z[~inside], "#d55e00", 7, 1.8)):
        axes.plot(np.real(shown), np.imag(shown), "x", color=colour, ms=size, mew=width, zorder=4)
    reach = max(1.12, 1.08 * float(np.abs(z).max()))
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="Re z", ylabel="Im z")
    frame, radius = 1e3 * result.model.period, result.model.spectral_radius
    axes.set_title(f"Poles per {frame:g} ms frame, spectral radius {radius:.4f}")
    axes.grid(False)
    return figure


@styled
def plot_bode(result: ClosedLoop) -> Figure:
    """Frequency response from reference to reading per channel, measured and linear, and its coherence."""
    count = len(result.responses)
    figure = new_figure(min(7.0, 1.6 + 2.4 * count), 5.2)
    rows = figure.subplots(3, count, sharex=True, sharey="row", squeeze=False, height_ratios=[1.4, 1.2, 0.7])
    for j, response in enumerate(result.responses):
        draw_response(rows[:, j], result, response, colour_of(response.channel, j, result.robot.machine))
    rows[0, 0].legend(loc="lower left", frameon=True, facecolor="white", edgecolor="none", framealpha=1.0)
    for axes, name in zip(rows[:, 0], ("Gain [dB]", "Phase [deg]", "Coherence [-]")):
        axes.set_ylabel(name)
    figure.align_ylabels(rows[:, 0])
    return figure


def draw_response(column: Any, result: ClosedLoop, response: FrequencyResponse, colour: str) -> None:
    """Gain, phase and coherence of one channel: a line from the frame map, dots from the multisine."""
    gain, phase, coherence = column
    f, size = response.frequency, np.abs(response.measured)
    fine = np.geomspace(f[0], f[-1], 400)
    kinds = result.model.inputs[0].rsplit("_", 1)[0], output_kind(result)
    linear = closed_response(result.model, response.channel, kinds, fine)
    low, high = np.maximum(size - response.spread, 1e-6), size + response.spread
    gain.fill_between(f, decibel(low), decibel(high), color=colour, alpha=0.25, lw=0)
    gain.plot(fine, decibel(np.abs(linear)), color="black", lw=0.9, label="frame map")
    gain.plot(f, decibel(size), ".", ms=3, color=colour, label="multisine")
    phase.plot(fine, np.degrees(np.unwrap(np.angle(linear))), color="black", lw=0.9)
    phase.plot(f, np.degrees(np.unwrap(np.angle(response.measured))), ".", ms=3, color=colour)
    coherence.plot(f, response.coherence, ".", ms=3, color=colour)
    if np.isfinite(response.bandwidth):
        gain.axvline(response.bandwidth, color="#555", lw=0.7, ls=(0, (4, 2)))
        words = f"-3 dB at {response.bandwidth:.2f} Hz"
        gain.text(0.97, 0.95, words, transform=gain.transAxes, ha="right", va="top", fontsize=8, color=DARK)
    gain.set(title=f"{response.channel}: reference to reading", xscale="log", ylim=(-42, 12))
    phase.set(ylim=(-400, 20), yticks=[-360, -270, -180, -90, 0])
    coherence.set(xlabel="Frequency [Hz]", ylim=(-0.05, 1.08))


def decibel(size: np.ndarray) -> np.ndarray:
    """Amplitude ratio (n,) [-] in dB."""
    return 20.0 * np.log10(size)


@styled
def plot_margins(result: ClosedLoop) -> Figure:
    """Open loop of each channel, opened at its command, with gain and phase margins."""
    figure = new_figure(min(7.0, 1.6 + 2.4 * len(result.margins)), 4.2)
    rows = figure.subplots(2, len(result.margins), sharex=True, sharey="row", squeeze=False)
    for j, m in enumerate(result.margins):
        draw_open_loop(rows[0, j], rows[1, j], m, colour_of(m.channel, j, result.robot.machine))
    for axes, name in zip(rows[:, 0], ("|L| [dB]", "arg L [deg]")):
        axes.set_ylabel(name)
    figure.align_ylabels(rows[:, 0])
    return figure


def draw_open_loop(gain: Any, phase: Any, m: Margins, colour: str) -> None:
    """Bode lines of one open loop."""
    shown = (m.frequency >= 8e-4 * m.frequency[-1]) & (np.abs(m.loop) > 0.0)
    f, angle = m.frequency[shown], np.degrees(np.unwrap(np.angle(m.loop[shown])))
    gain.plot(f, decibel(np.abs(m.loop[shown])), color=colour)
    phase.plot(f, angle, color=colour)
    gain.axhline(0.0, color="black", lw=0.8)
    phase.axhline(-180.0, color="black", lw=0.8)
    for axes in (gain, phase):
        axes.set_xscale("log")
        if np.isfinite(m.crossover):
            axes.axvline(m.crossover, color="#555", lw=0.7, ls=(0, (4, 2)))
    gain.set(title=f"{m.channel}: open loop", ylim=(-25, 45))
    phase.text(0.04, 0.05, margin_words(m), transform=phase.transAxes, fontsize=8, color=DARK, bbox=WHITE)
    phase.set(xlabel="Frequency [Hz]", yticks=[-360, -270, -180, -90], ylim=(-390, -45))


def margin_words(m: Margins) -> str:
    """Margins in a few lines; those that are infinite left out."""
    if m.closed_unstable:
        return "unstable: no margins"
    lines = [f"gain margin {m.gain_margin:.2f}"] if np.isfinite(m.gain_margin) else []
    lines += [f"and down to {m.gain_low:.2g}"] if m.gain_low > 0.0 else []
    if np.isfinite(m.delay_margin):
        lines += [f"phase {np.degrees(m.phase_margin):.0f} deg at {m.crossover:.2f} Hz"]
        lines += [f"delay {1e3 * m.delay_margin:.3g} ms"]
    return "\n".join(lines)


DRAWINGS = {
    "steps": plot_steps,
    "poles": plot_poles,
    "stability": plot_stability,
    "bode": plot_bode,
    "margins": plot_margins,
    "nyquist": plot_nyquist,
    "robust": plot_robust,
    "root_locus": plot_root_locus,
    "delays": plot_delays,
}


def figures_of(result: ClosedLoop, cycles: tuple[LimitCycles, ...] = ()) -> dict[str, bytes]:
    """File name -> PNG of every figure; that of limit cycles where there are any."""
    figures = {f"{name}.png": png_of(draw(result)) for name, draw in DRAWINGS.items()}
    return figures | ({"limit_cycles.png": png_of(plot_limit_cycles(cycles))} if cycles else {})
