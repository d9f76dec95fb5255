"""The page around a recording: title, tension scale, live readings; `#t=1.5` in the address stops there."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.templates import render

TEMPLATES = Path(__file__).parent / "templates"
# tension as a share of F_max -> sRGB; slack is grey
STOPS = ((0.0, (0.55, 0.60, 0.67)), (0.35, (0.96, 0.76, 0.22)), (0.7, (0.91, 0.36, 0.13)), (1.0, (0.69, 0.02, 0.15)))


def colours(share: np.ndarray) -> np.ndarray:
    """Colours of tensions.

    Args:
        share: (n,) tensions over F_max [-].

    Returns:
        (n, 3) linear RGB, as Meshcat's materials take them.
    """
    at = np.array([x for x, _ in STOPS])
    srgb = np.column_stack([np.interp(share, at, [rgb[i] for _, rgb in STOPS]) for i in range(3)])
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)  # the sRGB standard's curve


def with_readings(html: str, title: str, readings: dict[str, Any]) -> str:
    """A Meshcat page with title, scale and live readings.

    Args:
        html: from `Meshcat.StaticHtml`.
        title: plain text.
        readings: time, step, tendons, joints, tension, angle, top as lists.
    """
    scale = [(round(100 * share), [round(255 * c) for c in rgb]) for share, rgb in STOPS]
    added = render("recording.html", TEMPLATES, title=title, readings=readings, stops=STOPS, scale=scale)
    html = html.replace("<title>Drake MeshCat</title>", f"<title>{escape(title)}</title>")
    head, end, tail = html.rpartition("</body>")
    return head + added + end + tail
