"""Figure of the workspaces (paper Fig. 13): full range of motion and assisted range."""

import numpy as np

from exodrake.data.plot import new_figure, png_of
from exodrake.identification.workspace.area import reach
from exodrake.identification.workspace.chain import DISTAL, FINGERTIP, Ranges, tip


def workspace_figure(lengths, ranges: Ranges, assisted=None) -> bytes:
    """Draw fingertip and distal phalanx as PNG for phalanx lengths (3,) [m]; `assisted` may be None."""
    figure = new_figure(10.5, 5.6)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for panel, what in zip(panels, (FINGERTIP, DISTAL), strict=True):
        whole = reach(lengths, ranges, what)
        _fill(panel, whole, "0.25", 0.25, f"full range of motion, {1e6 * whole.area:.0f} mm²")
        if assisted is not None:
            wired = assisted.region(lengths, what)
            _fill(panel, wired, "#c8372d", 0.45, f"assisted, nominal robot, {1e6 * wired.area:.0f} mm²")
        _finger(panel, lengths, ranges)
        panel.set_title(f"{what} workspace", fontsize=11)
        panel.set_xlabel("x, along the proximal phalanx at MCP 0 [mm]")
        panel.legend(loc="upper left", fontsize=8, framealpha=0.95)
        panel.set_aspect("equal")
        panel.grid(color="0.9", lw=0.6)
        panel.set_axisbelow(True)
    panels[0].set_ylabel("y, palmar [mm]")
    panels[0].set_ylim(90, -55)  # palmar down, as the hand lies
    return png_of(figure, dpi=130)


def _fill(panel, region, colour: str, alpha: float, label: str) -> None:
    for number, part in enumerate(getattr(region, "geoms", [region])):
        x, y = 1e3 * np.array(part.exterior.coords).T
        panel.fill(x, y, color=colour, alpha=alpha, lw=0, label=label if number == 0 else None)
        panel.plot(x, y, color=colour, lw=1)


def _finger(panel, lengths, ranges: Ranges) -> None:
    """Draw the finger at the middle of its ranges."""
    q = [float(np.mean(span)) for span in ranges]
    bone = np.array([lengths[0], lengths[1], 0.0])
    joints = [np.zeros(2), tip((lengths[0], 0, 0), q[0], 0, 0), tip(bone, *q), tip(lengths, *q)]
    x, y = 1e3 * np.array(joints).T
    panel.plot(x, y, "-o", color="#1f4f7a", lw=3, ms=6, mfc="white", zorder=5, label="finger, mid range")
