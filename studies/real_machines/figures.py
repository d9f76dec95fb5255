"""Drawings of the hardware page: measured, nominal and improved over time, and hysteresis loops."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

MEASURED, BEFORE, AFTER = "#1f2933", "#d9822b", "#1d4ed8"


def over_time(path: Path, time: np.ndarray, panels: Sequence[tuple], errors: bool = True) -> None:
    """Panels over time [s]: label, measured, before, after (n,) each, with the error after below each where wanted."""
    import matplotlib.pyplot as plt

    rows = len(panels) * (2 if errors else 1)
    figure, axes = plt.subplots(
        rows,
        1,
        figsize=(9.0, 1.9 * rows),
        sharex=True,
        squeeze=False,
        height_ratios=[2, 1] * len(panels) if errors else None,
    )
    for k, (label, measured, before, after) in enumerate(panels):
        top = axes[k * (2 if errors else 1), 0]
        top.plot(time, before, color=BEFORE, lw=1.0, label="nominal")
        top.plot(time, measured, color=MEASURED, lw=1.4, label="measured")
        top.plot(time, after, color=AFTER, lw=1.0, ls="--", label="improved")
        top.set_ylabel(label)
        if errors:
            low = axes[2 * k + 1, 0]
            low.plot(time, measured - after, color=AFTER, lw=0.8)
            low.axhline(0.0, color=MEASURED, lw=0.5)
            low.set_ylabel("error left")
    axes[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False, fontsize=8)
    axes[-1, 0].set_xlabel("time [s]")
    save(figure, path)


def loops(path: Path, panels: Sequence[tuple]) -> None:
    """Side by side: title, command, measured and improved angle (n,) [deg]."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        1, len(panels), figsize=(2.6 * len(panels), 2.9), sharex=True, sharey=True, squeeze=False
    )
    for axis, (title, command, measured, after) in zip(axes[0], panels, strict=True):
        axis.plot(command, measured, color=MEASURED, lw=1.4, label="measured")
        axis.plot(command, after, color=AFTER, lw=1.0, ls="--", label="predicted")
        axis.set_title(title, fontsize=9)
        axis.set_xlabel("command [°]")
    axes[0, 0].set_ylabel("angle [°]")
    axes[0, 0].legend(frameon=False, fontsize=8)
    save(figure, path)


def save(figure, path: Path) -> None:
    """Writes a figure and closes it."""
    import matplotlib.pyplot as plt

    for axis in figure.axes:
        axis.spines[["top", "right"]].set_visible(False)
    figure.align_ylabels()
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
