"""Building blocks of HTML reports: tables, bars, drawings, headings; set by `templates/kit.html` in `base.html`."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from exodrake.core import templates

TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Table:
    """A table of texts; backticks mark code.

    Attributes:
        header: a title per column.
        rows: cells, a sequence per row.
        words: columns on the left that hold words; the others hold numbers and are aligned right.
        wide: whether the table fills the window.
        totals: rows at the end that are set off.
        folded: title behind which the table is hidden; shown at once if empty.
    """

    block: ClassVar[str] = "table"
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 1
    wide: bool = True
    totals: int = 0
    folded: str = ""


@dataclass(frozen=True)
class Bars:
    """Horizontal bars with a text at the end of each; backticks mark code.

    Attributes:
        rows: label, length as a fraction of the full width, text, whether it is in the accent colour.
        caption: text below.
        folded: title behind which the bars are hidden; shown at once if empty.
    """

    block: ClassVar[str] = "bars"
    rows: Sequence[tuple[str, float, str, bool]]
    caption: str = ""
    folded: str = ""


@dataclass(frozen=True)
class Drawing:
    """An SVG with its caption.

    Attributes:
        svg: an element (`svg.svg_of`), or a whole file where `alt` is given, which keeps its own style sheet.
        caption: text below; backticks mark code.
        wide: whether it fills the window.
        alt: what a whole file shows, for screen readers.
        folded: title behind which the drawing is hidden; shown at once if empty.
    """

    block: ClassVar[str] = "drawing"
    svg: str
    caption: str = ""
    wide: bool = False
    alt: str = ""
    folded: str = ""

    @property
    def base64(self) -> str:
        """The SVG file for a data URL."""
        return b64encode(self.svg.encode()).decode()


@dataclass(frozen=True)
class Heading:
    """A heading of the third level."""

    block: ClassVar[str] = "heading"
    text: str


Block = Table | Bars | Drawing | Heading


def shares(values: dict[str, float], caption: str = "") -> Bars:
    """Bars of fractions, in the order given; the largest fills most of the width, in the accent colour."""
    largest = max(*values.values(), 1e-9)
    rows = [(name, max(v, 0.0) / largest, f"{100 * v:.0f} %", v == largest) for name, v in values.items()]
    return Bars(rows, caption)


def render(template: str, folder: Path = TEMPLATES, **values: Any) -> str:
    """HTML from a template of `folder`, which may extend `base.html` and import `kit.html`."""
    return templates.render(template, folder, TEMPLATES, **values)
