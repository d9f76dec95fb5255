"""Building blocks of HTML reports: tables, bars, drawings; set by `templates/kit.html` in `base.html`.

Matplotlib figures become inline SVG: the fonts of the report, no ids that clash, no reference to the outside.
"""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from html import escape
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from exodrake.core import templates
from exodrake.data import plot
from exodrake.diagnosis.change_point import Change
from exodrake.model.display import SYMBOLS, shown_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


INK, SOFT, RULE, LINE, BAND = "#1c2430", "#5d6778", "#e4e7ec", "#98a2b3", "#dfe5ec"
MEASURED, BEFORE, AFTER = (style["color"] for style in (plot.MEASURED, plot.NOMINAL, plot.IMPROVED))
# colours that are variables of the report's style sheet, so that figures follow a dark scheme
VARIABLES = {
    INK: "ink", SOFT: "soft", RULE: "rule", LINE: "line", BAND: "band", MEASURED: "ink", BEFORE: "before",
    AFTER: "after",
}  # fmt: skip
STYLE: dict[Any, Any] = {
    "font.family": "sans-serif", "font.size": 9, "svg.fonttype": "none", "axes.linewidth": 0.6,
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": LINE, "axes.labelcolor": INK,
    "text.color": INK, "xtick.color": SOFT, "ytick.color": SOFT, "xtick.major.width": 0.6, "ytick.major.width": 0.6,
    "xtick.major.size": 2.5, "ytick.major.size": 2.5, "xtick.minor.size": 0, "ytick.minor.size": 0,
    "axes.titlesize": 9, "axes.titleweight": "bold",
    "axes.titlelocation": "left", "axes.labelsize": 9, "legend.frameon": False, "axes.axisbelow": True,
    "lines.solid_joinstyle": "round", "figure.facecolor": "none", "axes.facecolor": "none", "savefig.facecolor": "none",
}  # fmt: skip
DPI = 220  # of what is drawn as pixels inside an SVG


def house_style() -> Any:
    """Context manager under which figures of a report are drawn."""
    import matplotlib

    return matplotlib.rc_context(STYLE)


def render_svg(figure: Figure, name: str, label: str) -> str:
    """A figure of `house_style` as an SVG element, its ids from a name unique in the report, with a label of it."""
    import matplotlib

    stream = StringIO()
    with matplotlib.rc_context({"svg.hashsalt": name, **STYLE}):
        figure.savefig(stream, format="svg", dpi=DPI, metadata={"Date": None, "Creator": None})
    svg = stream.getvalue()  # as an element of HTML: without prologue, metadata, name spaces and unused ids
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", svg).replace("xlink:href", "href")
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', svg))
    for colour, name in VARIABLES.items():
        svg = svg.replace(colour, f"var(--{name})")
    svg = re.sub(r'\sid="([^"]*)"', lambda found: found[0] if found[1] in used else "", svg)
    head = rf'<svg viewBox="\1" role="img" aria-label="{escape(label)}">'
    return re.sub(r'<svg[^>]*viewBox="([^"]*)"[^>]*>', head, svg, count=1)


TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Table:
    """A table of texts; backticks mark code.

    The left columns hold `words`, the others numbers, which are aligned right; it may fill the window. A title `folded`
    hides it.
    """

    block: ClassVar[str] = "table"
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 1
    wide: bool = True
    folded: str = ""


@dataclass(frozen=True)
class Bars:
    """Horizontal bars: label, length as a fraction of the full width, text at the end, whether in the accent colour.

    Backticks mark code.
    """

    block: ClassVar[str] = "bars"
    rows: Sequence[tuple[str, float, str, bool]]


@dataclass(frozen=True)
class Drawing:
    """An SVG element (`render_svg`) with its caption, or a whole file, which keeps its own style sheet, with an `alt`.

    Backticks mark code. A wide one fills the window; `alt` says what it shows.
    """

    block: ClassVar[str] = "drawing"
    svg: str
    caption: str = ""
    wide: bool = False
    alt: str = ""

    @property
    def base64(self) -> str:
        """The SVG file for a data URL."""
        return b64encode(self.svg.encode()).decode()


Block = Table | Bars | Drawing | str  # a text is a heading of the third level


def render(template: str, folder: Path = TEMPLATES, **values: Any) -> str:
    """HTML from a template of `folder`, which may extend `base.html` and import `kit.html`."""
    return templates.render(template, folder, TEMPLATES, **values)


def timeline(
    title: str, first: datetime | None, unit: str, times: Sequence[float], rows: Mapping[str, Sequence[float]],
    change: Change | None,
) -> dict[str, Any]:  # fmt: skip
    """Plain data of a quantity: title, unit shown, values, and its change if it has one.

    first: date from which times count [d], shown as POSIX times [s]; None of times of a log [s]. times: (n,) of the
    values. rows: `values`, `low` and `high` (n,) [unit].
    """
    name, factor = shown_unit(unit)

    def clock(times: Sequence[float]) -> list[float]:
        return list(times) if first is None else [(first + timedelta(days=t)).timestamp() for t in times]

    found: dict[str, Any] = {"title": title, "dates": first is not None, "unit": SYMBOLS.get(name, name)}
    found |= {key: [factor * float(value) for value in values] for key, values in rows.items()}
    found["times"] = clock(times)
    if change is not None:
        found["began"] = clock(change.began)
        found["path"] = [[*clock([t]), factor * y] for t, y in change.path(times[0], times[-1])]
    return found
