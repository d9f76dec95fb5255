"""Headings of columns, a name with its unit, and columns under headings in SI."""

import unicodedata
from collections.abc import Iterable, Mapping

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.units import check_unit, default_unit, kind_of, to_si

SEPARATORS = {";": "';'", "\t": "tabs"}
LARGEST = 1e12  # in SI: beyond any signal of a robot, and the square of a sum of squares is still finite


def heading(name: str, unit: str) -> str:
    """`tension_AF [N]`."""
    return f"{name} [{unit}]"


def seen(name: str) -> str:
    """A name as a reader sees it: without signs that cannot be seen, any blank as a space."""
    kinds = ((unicodedata.category(sign), sign) for sign in name)
    return "".join(" " if kind.startswith("Z") else sign for kind, sign in kinds if kind not in ("Cf", "Cc")).strip()


def refuse_doubled(names: Iterable[str], source: str) -> None:
    """InputError for a column that comes twice, also where only signs that cannot be seen tell the two apart."""
    known: set[str] = set()
    for name in map(seen, names):
        if name in known:
            raise InputError(f"{source}: column {name!r} comes twice")
        known.add(name)


def refuse_unclear(names: Iterable[str], source: str) -> None:
    """InputError for a name with signs that cannot be seen, or one that is another name, or a kind, in other letters.

    Letters are others in capitals and in other forms of Unicode.
    """
    known: dict[str, str] = {}
    for name in names:
        if not name.isprintable():
            raise InputError(f"{source}: column {name!r}: its name holds a sign that cannot be seen")
        plain = unicodedata.normalize("NFKC", name).casefold()
        if (other := known.setdefault(plain, name)) != name:
            raise InputError(f"{source}: column {name!r} is {other!r} in other letters, so one of them is too much")
        kind = kind_of(plain)
        if kind is not None and kind_of(name) is None:
            raise InputError(f"{source}: column {name!r}: did you mean {kind + name[len(kind) :]!r}?")


def split_heading(text: str, source: str) -> tuple[str, str]:
    """(name, unit) of a heading. InputError when the brackets or the name are absent."""
    name, bracket, rest = text.strip().partition("[")
    unit, closing, tail = rest.partition("]")
    if not bracket or not closing or tail.strip() or not name.strip():
        raise InputError(
            f"{source}: column heading {text.strip()!r}: wanted a name and a unit in brackets, like 'tension_AF [N]'"
        )
    return name.strip(), unit


def refuse_separator(cells: list[str], source: str) -> None:
    """InputError for a heading that other separators than commas leave in one cell."""
    found = next((said for sign, said in SEPARATORS.items() if len(cells) == 1 and sign in cells[0].strip()), None)
    if found:
        raise InputError(
            f"{source}: cells are separated by {found}, wanted ','; `exodrake import` converts such a file"
        )


def columns_in_si(
    columns: Iterable[tuple[str, np.ndarray]], source: str, units: Mapping[str, str] | None = None
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Values (n,) [SI] by name, time among them, and their SI units.

    Args:
        columns: (heading, values (n,)) pairs.
        source: name for messages.
        units: of columns whose heading is a bare name, else SI by their kind; None: each heading has its unit.

    Raises:
        InputError: naming a column that comes twice, or in other letters, whose unit is unknown or unsuitable, or a
            value beyond any signal.
    """
    signals: dict[str, np.ndarray] = {}
    known: dict[str, str] = {}
    for text, values in columns:
        if units is not None and "[" not in text:
            name = text.strip()
            unit = units.get(name) or default_unit(name)
        else:
            name, unit = split_heading(text, source)
        if name in signals:
            raise InputError(f"{source}: column {name!r} comes twice")
        where = f"{source}, column {name!r}"
        known[name] = check_unit(name, unit, where)
        signals[name] = to_si(values, unit, where)
        wrong = np.flatnonzero(np.abs(signals[name]) > LARGEST)
        if len(wrong):
            value = signals[name][wrong[0]]
            reason = "infinite" if np.isinf(value) else f"{value:g} in SI is beyond any signal"
            raise InputError(f"{where}, row {int(wrong[0]) + 1}: {reason}")
    refuse_unclear(signals, source)
    return signals, known
