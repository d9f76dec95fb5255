"""Short texts: a `repr` of one line for results with arrays and logs, nouns after numbers, tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import fields

LONGEST, LONGEST_FIELD = 160, 40  # characters


def short_repr[T](cls: type[T]) -> type[T]:
    """Class decorator of a dataclass: fields in one line, arrays by shape, collections by length."""

    def __repr__(self) -> str:
        parts = ", ".join(f"{f.name}={brief(getattr(self, f.name))}" for f in fields(self) if f.repr)
        line = f"{type(self).__name__}({parts})"
        return line if len(line) <= LONGEST else line[: LONGEST - 4] + "...)"

    cls.__repr__ = __repr__
    return cls


def brief(value: object) -> str:
    """A value in a few characters."""
    shape = getattr(value, "shape", None)
    if shape:
        return f"array{tuple(shape)}"
    if isinstance(value, Mapping | list | tuple | set | frozenset) and isinstance(value, Sized):
        return f"{type(value).__name__}[{len(value)}]"
    written = repr(value).splitlines()[0] if repr(value) else ""
    return written if len(written) <= LONGEST_FIELD else written[: LONGEST_FIELD - 3] + "..."


def plural(count: int, noun: str) -> str:
    """A noun after a number: `robot` after 1, else `robots`."""
    return noun if count == 1 else f"{noun}s"


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Format a table; a heading that begins with `>` heads numbers, which are aligned right."""
    marks = ["---:" if heading.startswith(">") else "---" for heading in headings]
    lines = ([heading.removeprefix(">") for heading in headings], *rows)
    head, *body = ("| " + " | ".join(map(str, cells)) + " |" for cells in lines)
    return "\n".join([head, "|" + "|".join(marks) + "|", *body])
