"""Figures of the page: measured, nominal and improved over time, and hysteresis loops."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.data.plot import STYLE, new_figure, save_png
from exodrake.report.blocks import AFTER, BEFORE, MEASURED

DPI = 110


def over_time(path: Path, time: np.ndarray, panels: Sequence[tuple], errors: bool = True) -> None:
    """Draws panels over time, one above the other.

    Args:
        path: PNG to write.
        time: (n,) [s].
        panels: label, measured, nominal, improved (n,) each.
        errors: whether the error of the improved robot is drawn below each panel.
    """
    import matplotlib

    step = 2 if errors else 1
    with matplotlib.rc_context(STYLE):
        figure = new_figure(9.0, 1.9 * step * len(panels) * (0.75 if errors else 1.0) + 0.5)
        heights = [2, 1] * len(panels) if errors else None
        axes = figure.subplots(step * len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for k, (label, measured, nominal, improved) in enumerate(panels):
            draw_signals(axes[step * k], time, measured, nominal, improved)
            axes[step * k].set_ylabel(label)
            if errors:
                axes[step * k + 1].plot(time, measured - improved, color=AFTER, lw=0.8)
                axes[step * k + 1].axhline(0.0, color=MEASURED, lw=0.5)
                axes[step * k + 1].set_ylabel("error left")
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
        axes[-1].set_xlabel("time [s]")
        axes[-1].set_xlim(time[0], time[-1])
        figure.align_ylabels()
        save_png(figure, path, DPI)


def draw_signals(axes: Any, time: np.ndarray, measured: np.ndarray, nominal: np.ndarray, improved: np.ndarray) -> None:
    """Draws a measured signal (n,) with two simulated ones."""
    axes.plot(time, nominal, color=BEFORE, lw=1.0, label="nominal")
    axes.plot(time, measured, color=MEASURED, lw=1.4, label="measured")
    axes.plot(time, improved, color=AFTER, lw=1.0, ls="--", label="improved")


def loops(path: Path, panels: Sequence[tuple]) -> None:
    """Draws hysteresis loops side by side: title; command, measured and predicted angle (n,) [deg]."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        figure = new_figure(2.6 * len(panels), 2.9)
        axes = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
        for axis, (title, command, measured, predicted) in zip(axes, panels, strict=True):
            axis.plot(command, measured, color=MEASURED, lw=1.4, label="measured")
            axis.plot(command, predicted, color=AFTER, lw=1.0, ls="--", label="predicted")
            axis.set_title(title)
            axis.set_xlabel("command [°]")
        axes[0].set_ylabel("angle [°]")
        axes[0].legend()
        save_png(figure, path, DPI)
