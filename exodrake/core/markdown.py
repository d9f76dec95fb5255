"""Tables in Markdown."""

from collections.abc import Iterable, Sequence


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Format a table; a heading that begins with `>` heads numbers, which are aligned right."""
    marks = ["---:" if heading.startswith(">") else "---" for heading in headings]
    lines = ([heading.removeprefix(">") for heading in headings], *rows)
    head, *body = ("| " + " | ".join(map(str, cells)) + " |" for cells in lines)
    return "\n".join([head, "|" + "|".join(marks) + "|", *body])
