"""Figures of logs, for paper and screen, without a display: `save_png(plot_log(log, "caging"), "caging.png")`.

A log is solid, a nominal robot dotted and an improved one dashed, in every figure: `MEASURED`, `NOMINAL`, `IMPROVED`.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import write_bytes
from exodrake.model.display import Display, choose_colour, find_display
from exodrake.model.machine import Machine
from exodrake.model.units import find_kind

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from exodrake.data.log import Comparison, Log

# of Matplotlib; where channels have colours of their own, these replace `color`
MEASURED: dict[str, Any] = {"color": "#1f2328", "linestyle": "-", "linewidth": 1.1}
NOMINAL: dict[str, Any] = {"color": "#d55e00", "linestyle": (0, (1, 1.2)), "linewidth": 1.3}
IMPROVED: dict[str, Any] = {"color": "#0072b2", "linestyle": (0, (5, 1.5)), "linewidth": 1.2}
# suffixes of kinds that are drawn with another kind, or not at all
REFERENCE, ESTIMATE, DEVIATION = "_ref", "_est", "_std"
ASIDE = (REFERENCE, ESTIMATE, DEVIATION, "_start", "_true")
LONG = 6000  # rows: more of them cover each other; a log of two minutes at 50 Hz
STRETCHES = 240  # of a long log, about four pixels each on a screen
LINE, POINTS, MARGIN = 120, 72.0, 0.05  # characters of a line of details; points in an inch; inches at the top
NARROWEST, WIDEST, PER_INCH = 7.0, 12.0, 10.0  # width of a figure [inches], s of a long log in an inch
SIZES = (11.0, 7.5)  # of title and details [points]
SMALL, MOST_ROWS = 60, 30  # dots an inch and rows of a table of a log in a notebook
MOST_NAMES = 8  # of channels in a legend, so that it is no longer than its panel
STYLE: dict[Any, Any] = {
    "font.size": 9, "axes.titlesize": 10, "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.7,
    "axes.grid": True, "grid.color": "#e3e6ea", "grid.linewidth": 0.6, "lines.linewidth": 1.1, "legend.frameon": False,
    "xtick.major.width": 0.7, "ytick.major.width": 0.7, "axes.axisbelow": True, "axes.labelpad": 4,
}  # fmt: skip


def list_kinds(log: Log, machine: Machine | None = None) -> list[str]:
    """Kinds of columns with a panel each, those of the machine first; a reference is drawn with its kind."""
    named = [c.kind for c in machine.columns] if machine else []
    named += [find_kind(c) or c.rsplit("_", 1)[0] for c in log.columns]
    return [kind for kind in dict.fromkeys(named) if log.names(kind) and not kind.endswith(ASIDE)]


def plot_log(
    log: Log, title: str = "", other: Log | None = None, names: tuple[str, str] = ("", "other"),
    machine: Machine | None = None, details: Sequence[str] = (), remarks: Mapping[str, str] | None = None,
    difference: bool = False,
) -> Figure:  # fmt: skip
    """Draws a log: a panel per kind of column over one time axis.

    Args:
        log: what is drawn; references are dashed, estimates have a band of two standard deviations. A long one is
            drawn by the mean and the range of stretches of time, without its references.
        title: above the figure.
        other: a second log on the same axes, dotted; of two, the one that the nominal robot wrote is the dotted one.
        names: of the two logs in the legend.
        machine: whose labels, units and colours are used; those of `display` without one.
        details: lines below the title.
        remarks: kind -> text above its panel.
        difference: draw the second log less the first below each panel.

    Raises:
        InputError: the log has no column that could be drawn.
    """
    import matplotlib

    kinds = list_kinds(log, machine)
    if not kinds:
        raise InputError(f"{log.label}: nothing to draw: no column but the time and references")
    width = min(WIDEST, max(NARROWEST, log.duration / PER_INCH)) if len(log) > 1 else NARROWEST
    thinner = (NARROWEST / width) ** 0.5
    swapped = other is not None and log.nominal and not other.nominal
    first, second = (NOMINAL, MEASURED) if swapped else (MEASURED, NOMINAL)
    below = [kind for kind in kinds if difference and other is not None and other.names(kind)]
    heights = [height for kind in kinds for height in ((1.65, 0.75) if kind in below else (1.65,))]
    with matplotlib.rc_context({**STYLE, "lines.linewidth": STYLE["lines.linewidth"] * thinner}):
        figure = new_figure(width, 0.7 + sum(heights))
        rows = iter(figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0])
        panels = {}
        for kind in kinds:
            axes = panels[kind] = next(rows)
            draw_panel(axes, log, kind, machine, first)
            axes.set_title((remarks or {}).get(kind, ""), loc="right", fontsize=7.5, color="#445", pad=3)
            lower = next(rows) if kind in below else None
            factor = display_in(log, kind, machine).factor
            for i, name in enumerate(other.names(kind) if other is not None else ()):
                assert other is not None
                style = second | {"color": choose_colour(name, i, machine), "linewidth": second["linewidth"] * thinner}
                axes.plot(other.time, display_in(other, kind, machine).factor * other[f"{kind}_{name}"], **style)
                if lower is not None and log.has(f"{kind}_{name}"):
                    error = other.sample(f"{kind}_{name}", log.time) - log[f"{kind}_{name}"]
                    lower.plot(log.time, factor * error, color=style["color"], lw=0.9)
            if lower is not None:
                lower.axhline(0.0, color="#889", lw=0.6)
                lower.set_ylabel("difference", fontsize=7.5)
        figure.axes[-1].set_xlabel("Time [s]")
        figure.axes[-1].set_xlim(log.time[0], log.time[-1] if len(log) > 1 else None)
        add_legends(panels, log, dict(zip(names, (first, second))) if other is not None else {})
        figure.align_ylabels(figure.axes)
        if title or any(details):  # title and smaller lines at the top left; the panels keep below them
            lines = [line for detail in details for line in wrap(detail, LINE)]
            inch = 1.0 / figure.get_figheight()
            above, rest = 1.5 * SIZES[0] / POINTS * bool(title), 1.35 * SIZES[1] / POINTS * len(lines)  # inches
            layout: Any = figure.get_layout_engine()
            layout.set(rect=(0.0, 0.0, 1.0, 1.0 - (above + rest + MARGIN) * inch))
            style = {"ha": "left", "va": "top", "linespacing": 1.3}
            figure.text(0.01, 1.0 - MARGIN * inch, title, fontsize=SIZES[0], fontweight="bold", **style)
            top = 1.0 - (above + MARGIN) * inch
            figure.text(0.01, top, "\n".join(lines), fontsize=SIZES[1], color="#445", **style)
    return figure


def log_html(log: Log) -> str:
    """A log in a notebook: its headline, a table of its signals with unit, rows and range, and a small figure."""
    rows = []
    for name in log.columns[:MOST_ROWS]:
        values = log[name][np.isfinite(log[name])]
        ends = [f"{values.min():.4g}", f"{values.max():.4g}"] if len(values) else ["", ""]
        cells = (escape(name), escape(log.units[name]), f"{len(values)}", *ends)
        rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    more = len(log.columns) - len(rows)
    heads = "".join(f"<th>{head}</th>" for head in ("signal", "unit", "samples", "lowest", "highest"))
    span = f", {log.time[0]:g} to {log.time[-1]:g} s" if len(log) else ""
    html = f"<b>{escape(log.label)}</b>: {len(log)} rows{span}<table><tr>{heads}</tr>{''.join(rows)}</table>"
    html += f"<p>and {more} more</p>" if more else ""
    if not len(log) or not list_kinds(log):
        return html
    return f'{html}<img alt="" src="data:image/png;base64,{b64encode(render_png(plot_log(log), SMALL)).decode()}">'


def display_in(log: Log, kind: str, machine: Machine | None) -> Display:
    """Label and unit of a kind of column, for the unit that the log has it in."""
    return find_display(kind, machine, log.units[f"{kind}_{log.names(kind)[0]}"] if log.names(kind) else "")


def draw_panel(
    axes: Any, log: Log, kind: str, machine: Machine | None = None, style: Mapping[str, Any] = MEASURED
) -> None:
    """Draws the columns of one kind, with their references dashed and their estimates."""
    display = display_in(log, kind, machine)
    for i, name in enumerate(log.names(kind)):
        colour = choose_colour(name, i, machine)
        values, look = display.factor * log[f"{kind}_{name}"], {"color": colour, "ls": style["linestyle"]}
        if len(values) <= LONG:
            axes.plot(log.time, values, label=name, **look)
        else:  # the envelope and the mean of stretches of time
            stretch = choose_stretch(len(values), 2 * STRETCHES)
            low, high = np.sort(envelope(values[:, None], stretch).reshape(-1, 2), axis=1).T
            blocks = split_stretches(np.column_stack([log.time, values]), stretch)
            count = np.isfinite(blocks).sum(axis=1)  # the mean is NaN in a stretch without a sample
            at, mean = np.where(count > 0, np.nansum(blocks, axis=1) / np.maximum(count, 1), np.nan).T
            axes.fill_between(at, low, high, color=colour, alpha=0.3, lw=0)
            axes.plot(at, mean, label=name, **look)
        reference = f"{kind}{REFERENCE}_{name}"
        if log.has(reference) and len(log) <= LONG:
            wanted = display.factor * log[reference]
            axes.plot(log.time, wanted, color=colour, lw=0.9, ls=(0, (4, 2)), alpha=0.75)
        if log.has(f"{kind}{ESTIMATE}_{name}"):  # a thin line, in a band of two standard deviations if the log has them
            mean = display.factor * log[f"{kind}{ESTIMATE}_{name}"]
            axes.plot(log.time, mean, color="black", lw=0.6)
            if log.has(f"{kind}{DEVIATION}_{name}"):
                band = 2.0 * display.factor * log[f"{kind}{DEVIATION}_{name}"]
                axes.fill_between(log.time, mean - band, mean + band, color=colour, alpha=0.2, lw=0)
    axes.set_ylabel(display.axis)
    axes.margins(y=0.08)


def add_legends(panels: Mapping[str, Any], log: Log, logs: Mapping[str, Mapping[str, Any]]) -> None:
    """Colours beside the first panel of each set of channels, with what lines mean; `logs`: name -> style."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    explained: set[tuple[str, ...]] = set()
    for kind, axes in panels.items():
        if log.names(kind) in explained:
            continue
        drawn, _ = axes.get_legend_handles_labels()
        handles: list[Any] = [Line2D([], [], color=line.get_color(), label=line.get_label()) for line in drawn]
        if len(handles) > MOST_NAMES:
            more = Line2D([], [], ls="", label=f"and {len(handles) - MOST_NAMES} more")
            handles = [*handles[:MOST_NAMES], more]
        for name, style in logs.items() if not explained else ():
            handles += [Line2D([], [], **{**style, "color": "#555"}, label=name)] * bool(name)
        explained.add(log.names(kind))
        if len(log) > LONG:
            handles.append(Patch(color="#555", alpha=0.3, lw=0, label="range"))
        elif log.names(kind + REFERENCE):
            handles.append(Line2D([], [], color="#555", lw=0.9, ls=(0, (4, 2)), label="reference"))
        if log.names(kind + ESTIMATE):
            handles.append(Line2D([], [], color="black", lw=0.6, label="estimate"))
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.04), handlelength=1.8, borderaxespad=0.3)


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of some inches, with constrained layout, that needs no display."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def render_png(figure: Figure, dpi: int = 200) -> bytes:
    """The figure as PNG."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def save_png(figure: Figure, path: str | Path, dpi: int = 200) -> None:
    """Writes a figure as PNG, whole or not at all. InputError for a file that cannot be written."""
    write_bytes(path, render_png(figure, dpi))


def choose_stretch(samples: int, most: int) -> int:
    """Samples of a stretch with which the envelope of a log has `most` samples or fewer; 1 where the log has."""
    return 1 if samples <= most else -(-samples // max(most // 2, 1))


def envelope(values: np.ndarray, stretch: int) -> np.ndarray:
    """Least and largest of each stretch of values (n, columns), in their order: (2 ceil(n / stretch), columns)."""
    if stretch <= 1:
        return values
    blocks = split_stretches(values, stretch)
    missing = np.isnan(blocks)
    least = np.where(missing, np.inf, blocks).argmin(axis=1)
    largest = np.where(missing, -np.inf, blocks).argmax(axis=1)
    at = np.stack([np.minimum(least, largest), np.maximum(least, largest)], axis=1)
    return np.take_along_axis(blocks, at, axis=1).reshape(-1, values.shape[1])


def split_stretches(values: np.ndarray, stretch: int) -> np.ndarray:
    """Values (n, columns) in stretches, (ceil(n / stretch), stretch, columns), the last one filled with NaN."""
    padded = np.pad(values, ((0, -len(values) % stretch), (0, 0)), constant_values=np.nan)
    return padded.reshape(-1, stretch, values.shape[1])


def remarks(found: Comparison, log: Log, machine: Machine | None = None) -> dict[str, str]:
    """RMS differences of each kind of column in words, for the panels of `plot_log`."""
    said = {}
    for kind in list_kinds(log, machine):
        display = display_in(log, kind, machine)
        values = {n: found.signals[f"{kind}_{n}"] for n in log.names(kind) if f"{kind}_{n}" in found.signals}
        if values and find_kind(f"{kind}_x") == kind:
            listed = ", ".join(f"{name} {display.factor * one.rms:.3g}" for name, one in values.items())
            said[kind] = f"RMS difference: {listed} {display.symbol}".replace(" °", "°").rstrip()
    return said
