"""Style of the closed loop's figures, and the grid of equal damping and frequency in the z plane."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.data.plot import STYLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FAINT, GREY, DARK = "#9aa2ad", "#5b6470", "#333333"
PLATE = {"boxstyle": "round,pad=0.1", "fc": "#f6f8fa", "ec": "none"}
TAG: dict[str, Any] = {"fontsize": 6.5, "color": GREY, "ha": "center", "va": "center"}


def styled(draw: Callable[[Any], Figure]) -> Callable[[Any], Figure]:
    """Draws under the style of the package's figures."""

    @wraps(draw)
    def drawn(result: Any) -> Figure:
        import matplotlib

        with matplotlib.rc_context(STYLE):
            return draw(result)

    return drawn


def draw_damping_grid(axes: Any, period: float) -> None:
    """Draws the unit circle, and z = exp(s T) for constant damping ratio and for constant natural frequency."""
    turn = np.linspace(0.0, 2.0 * np.pi, 400)
    axes.fill(np.cos(turn), np.sin(turn), color="#f6f8fa", zorder=0)
    axes.plot(np.cos(turn), np.sin(turn), color="#333", lw=1.0)
    for damping in (0.1, 0.2, 0.4, 0.6, 0.8):
        end = np.pi / np.sqrt(1.0 - damping**2)
        z = np.exp(np.linspace(0.0, end, 200) * (-damping + 1j * np.sqrt(1.0 - damping**2)))
        for side in (z, z.conj()):
            axes.plot(np.real(side), np.imag(side), color=FAINT, lw=0.5)
        tag = z[np.argmin(np.abs(np.angle(z) - 0.82 * np.pi))]
        if damping < 0.7:  # further in, poles crowd the tag
            axes.text(tag.real, tag.imag, f"ζ {damping:g}", bbox=PLATE, **TAG)
    for share in (0.1, 0.2, 0.3, 0.4, 0.6, 0.8):  # of the Nyquist frequency
        hertz = share * 0.5 / period
        radius = 2.0 * np.pi * hertz * period
        angle = np.linspace(np.pi / 2.0, np.pi, 100)
        s = radius * np.exp(1j * angle)
        z = np.exp(s[np.abs(s.imag) <= np.pi])
        for side in (z, z.conj()):
            axes.plot(np.real(side), np.imag(side), color=FAINT, lw=0.5, ls=(0, (1, 1.5)))
        axes.text(1.08 * z[0].real, 1.06 * z[0].imag, f"{hertz:g} Hz", **TAG)
