"""Headings of columns, a name with its unit, and columns under headings in SI."""

from collections.abc import Iterable, Mapping

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.units import check_unit, default_unit, to_si

SEPARATORS = {";": "';'", "\t": "tabs"}
LARGEST = 1e12  # in SI: beyond any signal of a robot, and the square of a sum of squares is still finite


def heading(name: str, unit: str) -> str:
    """`tension_AF [N]`."""
    return f"{name} [{unit}]"


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
        InputError: naming a column that comes twice, whose unit is unknown or unsuitable, or a value beyond any signal.
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
    return signals, known
