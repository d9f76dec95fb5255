"""Small pieces of HTML: escaped text, tables, figures, tiles."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape


def text(words: str) -> str:
    """Text with `code` between backticks, escaped."""
    pieces = [escape(piece) for piece in words.split("`")]
    return "".join(piece if i % 2 == 0 else f"<code>{piece}</code>" for i, piece in enumerate(pieces))


def paragraph(words: str, kind: str = "") -> str:
    """A paragraph of text; nothing for empty words."""
    mark = f' class="{kind}"' if kind else ""
    return f"<p{mark}>{text(words)}</p>" if words else ""


def heading(level: int, words: str) -> str:
    """A heading."""
    return f"<h{level}>{text(words)}</h{level}>"


def table(
    header: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1, wide: bool = True, sums: int = 0
) -> str:
    """A table of texts. words: columns on the left that hold words, not numbers; sums: last rows set off."""
    rows = list(rows)

    def line(cells: Sequence[str], tag: str, mark: str = "") -> str:
        inner = "".join(f"<{tag}{'' if i < words else ' class=n'}>{text(cell)}</{tag}>" for i, cell in enumerate(cells))
        return f"<tr{mark}>{inner}</tr>"

    body = [line(row, "td", ' class="sum"' if i >= len(rows) - sums else "") for i, row in enumerate(rows)]
    kind = ' class="wide"' if wide else ""
    head = f"<thead>{line(header, 'th')}</thead>"
    return f'<div class="scroll"><table{kind}>{head}<tbody>{"".join(body)}</tbody></table></div>'


def figure(drawing: str, caption: str = "", wide: bool = False) -> str:
    """A drawing (SVG or image element) with its caption."""
    below = f"<figcaption>{text(caption)}</figcaption>" if caption else ""
    return f'<figure><div class="{"wide-figure" if wide else ""}">{drawing}</div>{below}</figure>'


def picture(svg: str, label: str) -> str:
    """A whole SVG file as an image, so that its style stays its own."""
    return f'<img alt="{escape(label)}" src="data:image/svg+xml;base64,{b64encode(svg.encode()).decode()}">'


def tiles(items: Iterable[tuple[str, str]]) -> str:
    """Large numbers with a line below each."""
    inner = "".join(f'<div class="tile"><b>{text(big)}</b><span>{text(small)}</span></div>' for big, small in items)
    return f'<div class="tiles">{inner}</div>'


def pair(*parts: str) -> str:
    """Parts side by side where there is room."""
    return f'<div class="pair">{"".join(f"<div>{part}</div>" for part in parts if part)}</div>'


def bullets(items: Iterable[str]) -> str:
    """A list; nothing for no items."""
    inner = "".join(f"<li>{text(item)}</li>" for item in items)
    return f"<ul>{inner}</ul>" if inner else ""


def folded(title: str, content: str) -> str:
    """Content behind a line that opens it."""
    return f"<details><summary>{text(title)}</summary>{content}</details>"


def legend(items: Iterable[tuple[str, str]], band: str = "") -> str:
    """Colours and what they mean; band: meaning of the grey band."""
    inner = "".join(f'<span><i style="border-color:{colour}"></i>{text(name)}</span>' for colour, name in items)
    return f'<div class="legend">{inner}{f"<span><i class=band></i>{text(band)}</span>" if band else ""}</div>'
