"""Errors that a user can cause and mend, and short texts: a `repr` of one line, plural nouns, Markdown tables."""

from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import contextmanager
from dataclasses import fields

LONGEST, LONGEST_FIELD = 160, 40  # characters
MAX_MESSAGE, TAIL = 300, 120  # characters of a message, and of its end that a cut in the middle leaves
HINTS = 3  # names that a message proposes


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


class InputError(Exception):
    """Bad input from a user.

    The message is one sentence that names the thing (file, column, row, key, option) and where it came from, at most
    MAX_MESSAGE characters, control characters escaped. The command line prints it as one line and exits with status 2;
    a traceback would mean a bug of ours.

    Examples:
        >>> import exodrake as exo
        >>> try:
        ...     exo.load_robot("emsp")
        ... except InputError as problem:
        ...     print(problem)
        no robot file 'emsp', nor a machine of that name; did you mean emps?
    """

    def __init__(self, message: str) -> None:
        super().__init__(shorten(printable(message)))


@contextmanager
def require_extra(message: str) -> Iterator[None]:
    """InputError with this message if an import within fails, as of an extra that is not installed."""
    try:
        yield
    except ImportError:
        raise InputError(message) from None


def printable(text: str) -> str:
    """Text in one line, control characters shown escaped."""
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def shorten(text: str, most: int = MAX_MESSAGE) -> str:
    """Text of at most so many characters: what is longer loses its middle."""
    return text if len(text) <= most else f"{text[: most - TAIL - 5]} ... {text[-TAIL:]}"


def nearest(word: str, words: list[str]) -> str:
    """A hint at names that hold `word`, resemble it, or hold its last part or a part like it, in this order."""
    import difflib

    def choose(names: list[str]) -> list[str]:  # finger.kappa stands for finger.kappa.MCP
        return [name for name in names if not name.startswith(tuple(f"{one}." for one in names))][:HINTS]

    def holding(part: str) -> list[str]:
        within = [name for name in words if len(part) > 1 and part.lower() in name.lower()]
        return choose(sorted(within, key=lambda name: (part not in name, len(name))))

    def resembling(least: float) -> list[str]:
        return choose(difflib.get_close_matches(word, words, 2 * HINTS, least))

    last, parts = word.rpartition(".")[2], {part for name in words for part in name.replace("_", ".").split(".")}
    alike = difflib.get_close_matches(last, sorted(parts), 1, 0.8)
    close = holding(word) or resembling(0.8) or holding(last) or (alike and holding(alike[0])) or resembling(0.5)
    return f"; did you mean {' or '.join(close)}?" if close else ""


class MissingColumn(InputError):
    """A column that a machine needs is missing or empty in a log, which may be another machine's."""


def argument[T](name: str, value: T, *types: type) -> T:
    """The value of an argument. TypeError naming argument, types wanted and value for one of another type."""
    if isinstance(value, types):
        return value
    wanted = " or ".join("None" if one is type(None) else one.__name__ for one in types)
    raise TypeError(f"{name}: wanted {wanted}, got {type(value).__name__} ({brief(value)})")
