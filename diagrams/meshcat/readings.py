"""What surrounds a recording: title, scale of loads, live readings, and controls to play, pause and scrub."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.templates import render
from exodrake.diagrams.meshcat.scene import GHOSTLY

TEMPLATES = Path(__file__).parent / "templates"
# load as a share of the highest -> sRGB; slack is grey
STOPS = ((0.0, (0.55, 0.60, 0.67)), (0.35, (0.96, 0.76, 0.22)), (0.7, (0.91, 0.36, 0.13)), (1.0, (0.69, 0.02, 0.15)))


def colours(share: np.ndarray) -> np.ndarray:
    """Colours of loads.

    Args:
        share: (n,) loads over the highest [-].

    Returns:
        (n, 3) linear RGB, as Meshcat's materials take them.
    """
    at = np.array([x for x, _ in STOPS])
    srgb = np.column_stack([np.interp(share, at, [rgb[i] for _, rgb in STOPS]) for i in range(3)])
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)  # the sRGB standard's curve


def with_readings(html: str, title: str, readings: dict[str, Any], details: Sequence[str], label: str) -> str:
    """A Meshcat recording with title, scale, live readings and controls.

    Args:
        html: from `Meshcat.StaticHtml`.
        title: plain text.
        readings: time, step, tendons, joints, load, unit, angle, ghost, names, top as lists.
        details: lines below the title.
        label: what is coloured, and by what.
    """
    scale = [(round(100 * share), [round(255 * c) for c in rgb]) for share, rgb in STOPS]
    tops = [f"{top:.3g}" for top in (min(readings["top"]), max(readings["top"]))]
    highest = f"{' to '.join(dict.fromkeys(tops))} {readings['unit']}".replace(" deg", "°")
    added = render(
        "recording.html", TEMPLATES, title=title, readings=readings, stops=STOPS, scale=scale, details=details,
        label=label, highest=highest, ghost=[round(255 * c) for c in GHOSTLY[:3]],
    )  # fmt: skip
    html = html.replace("<title>Drake MeshCat</title>", f"<title>{escape(title)}</title>")
    head, end, tail = html.rpartition("</body>")
    return head + added + end + tail
