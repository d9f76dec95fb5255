"""Figures of logs, for paper and screen. matplotlib is imported inside the functions that draw, and needs no display.

figure = plot_log(log, "caging")        # or log.plot()
save_png(figure, "caging.png")
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from exodrake.core.errors import InputError
from exodrake.core.files import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from exodrake.data.log import Log

# kind -> (label, unit shown, factor from SI); `tension` shows its reference too, `angle` its estimate
PANELS = {
    "tension": ("Tension", "N", 1.0),
    "stroke": ("Stroke", "mm", 1e3),
    "speed_cmd": ("Command", "mm/s", 1e3),
    "angle": ("Joint angle", "rad", 1.0),
}
REFERENCE = {"tension": "tension_ref", "stroke": "stroke_ref", "angle": "angle_ref"}
WIRE_COLOURS = {"AF": "#0072b2", "MF": "#009e73", "AE": "#d55e00"}  # Okabe and Ito: told apart by all eyes
JOINT_COLOURS = {"MCP": "#332288", "PIP": "#aa4499", "DIP": "#999933"}  # Tol's muted scheme
SPARE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#332288", "#aa4499")
STYLE: dict[Any, Any] = {
    "font.size": 9, "axes.titlesize": 10, "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.7,
    "axes.grid": True, "grid.color": "#e3e6ea", "grid.linewidth": 0.6, "lines.linewidth": 1.1, "legend.frameon": False,
    "xtick.major.width": 0.7, "ytick.major.width": 0.7, "axes.axisbelow": True, "axes.labelpad": 4,
}  # fmt: skip


def colour_of(name: str, place: int) -> str:
    """Colour of a wire or joint, by name where known."""
    return WIRE_COLOURS.get(name) or JOINT_COLOURS.get(name) or SPARE[place % len(SPARE)]


def plot_log(log: Log, title: str = "", other: Log | None = None, names: tuple[str, str] = ("", "other")) -> Figure:
    """A panel per kind of column over one time axis: tension on its reference, stroke, speed command, joint angles.

    Args:
        title: above the figure. other: a second log, drawn dotted on the same axes. names: of the two in the legend.
    Raises InputError for a log with none of these columns.
    """
    import matplotlib
    from matplotlib.figure import Figure

    kinds = [kind for kind in PANELS if log.names(kind)]
    if not kinds:
        raise InputError(f"{log.label}: nothing to draw: no column of kind {', '.join(PANELS)}")
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 0.7 + 1.55 * len(kinds)), layout="constrained")
        rows = figure.subplots(len(kinds), 1, sharex=True, squeeze=False)[:, 0]
        for axes, kind in zip(rows, kinds):
            draw_panel(axes, log, kind)
            if other is not None:
                draw_other(axes, other, kind)
        add_legends(rows, kinds, log, names if other is not None else None)
        rows[-1].set_xlabel("Time [s]")
        rows[-1].set_xlim(log.time[0], log.time[-1] if len(log) > 1 else None)
        figure.align_ylabels(rows)
        if title:
            figure.suptitle(title, fontsize=11, fontweight="bold", x=0.01, ha="left")
    return figure


def draw_panel(axes: Any, log: Log, kind: str) -> None:
    """Lines of one kind, with their reference dashed and their estimate as a band of two standard deviations."""
    label, unit, factor = PANELS[kind]
    for i, name in enumerate(log.names(kind)):
        colour = colour_of(name, i)
        axes.plot(log.time, factor * log[f"{kind}_{name}"], color=colour, label=name)
        wanted = f"{REFERENCE.get(kind, kind)}_{name}"
        if kind in REFERENCE and log.has(wanted):
            axes.plot(log.time, factor * log[wanted], color=colour, lw=0.9, ls=(0, (4, 2)), alpha=0.75)
        if log.has(f"{kind}_est_{name}"):
            draw_estimate(axes, log, kind, name, colour)
    axes.set_ylabel(f"{label} [{unit}]")
    axes.margins(y=0.08)


def draw_estimate(axes: Any, log: Log, kind: str, name: str, colour: str) -> None:
    """An estimate as a thin line, with a band of two standard deviations where the log has them."""
    mean = log[f"{kind}_est_{name}"]
    axes.plot(log.time, mean, color="black", lw=0.6)
    if log.has(f"{kind}_std_{name}"):
        spread = 2.0 * log[f"{kind}_std_{name}"]
        axes.fill_between(log.time, mean - spread, mean + spread, color=colour, alpha=0.2, lw=0)


def draw_other(axes: Any, other: Log, kind: str) -> None:
    """The second log's lines of this kind, dotted."""
    for i, name in enumerate(other.names(kind)):
        factor, colour = PANELS[kind][2], colour_of(name, i)
        axes.plot(other.time, factor * other[f"{kind}_{name}"], color=colour, ls=(0, (1, 1.2)), lw=1.3)


def add_legends(rows: Any, kinds: list[str], log: Log, names: tuple[str, str] | None) -> None:
    """Colours beside the first panel of each set of channels, with what dashed and dotted mean."""
    from matplotlib.lines import Line2D

    explained: set[tuple[str, ...]] = set()
    for axes, kind in zip(rows, kinds):
        handles, _ = axes.get_legend_handles_labels()
        if log.names(kind) in explained:
            continue
        explained.add(log.names(kind))
        if kind in REFERENCE and log.names(REFERENCE[kind]):
            handles.append(Line2D([], [], color="#555", lw=0.9, ls=(0, (4, 2)), label="reference"))
        if log.names(f"{kind}_est"):
            handles.append(Line2D([], [], color="black", lw=0.6, label="estimate"))
        if names is not None and axes is rows[0]:
            handles += [Line2D([], [], color="#555", label=names[0])] if names[0] else []
            handles.append(Line2D([], [], color="#555", lw=1.3, ls=(0, (1, 1.2)), label=names[1]))
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.04), handlelength=1.8, borderaxespad=0.3)


def png_of(figure: Figure, dpi: int = 200) -> bytes:
    """The figure as PNG."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def save_png(figure: Figure, path: str | Path, dpi: int = 200) -> None:
    """Writes a figure as PNG, whole or not at all; InputError naming a file that cannot be written."""
    write_bytes(path, png_of(figure, dpi))
