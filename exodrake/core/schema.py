"""Schemas of YAML content: checks that compose, and messages that name file and key of whatever is wrong.

    SCHEMA = mapping({"name": text(), "period": number(above=0.0), "logs": listing(LOG, least=1)}, required=("logs",))
    content = SCHEMA(read_yaml(path), str(path))

A schema is a function of a value and the place where it stands; it returns the value, or raises InputError.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from exodrake.core.errors import InputError

Schema = Callable[[Any, str], Any]
MAX_PLACE, MAX_SHOWN = 160, 40  # characters
MAX_WHOLE = 1_000_000_000  # of rows, frames and other counts


def shown(value: Any) -> str:
    """A value for a message, shortened, control characters escaped."""
    written = repr(value)
    return "nothing" if value is None else written if len(written) <= MAX_SHOWN else written[: MAX_SHOWN - 3] + "..."


def refusal(where: str, reason: str) -> InputError:
    """An InputError of one sentence: `where: reason`, of a long place only its end."""
    return InputError(f"{where if len(where) <= MAX_PLACE else '...' + where[-MAX_PLACE:]}: {reason}")


def inside(where: str, key: str) -> str:
    """The place of a key: `file, 'outer.inner'`."""
    name = key if len(key) <= MAX_SHOWN else key[: MAX_SHOWN - 3] + "..."
    return f"{where[:-1]}.{name}'" if where.endswith("'") else f"{where}, '{name}'"


def anything(value: Any, where: str) -> Any:
    """Any value."""
    return value


def flag(value: Any, where: str) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise refusal(where, f"wanted true or false, found {shown(value)}")
    return value


def text(choices: Sequence[str] = (), length: int | None = None) -> Schema:
    """Text: one of the choices if there are any, of that length if one is given."""

    def check(value: Any, where: str) -> str:
        if not isinstance(value, str) or (length is not None and len(value) != length):
            wanted = "text" if length is None else f"text of {length} character{'s' * (length > 1)}"
            raise refusal(where, f"wanted {wanted}, found {shown(value)}")
        if choices and value not in choices:
            raise refusal(where, f"{shown(value)} is none of {', '.join(choices)}")
        return value

    return check


def number(above: float = -math.inf, low: float = -math.inf, high: float = math.inf, unit: str = "") -> Schema:
    """A number in (above, inf) and [low, high], not NaN; infinite only if the range has no end there."""

    def check(value: Any, where: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise refusal(where, f"wanted a number{unit and f' [{unit}]'}, found {shown(value)}")
        try:
            found = float(value)
        except OverflowError:
            raise refusal(where, f"{shown(value)} is too large a number") from None
        if math.isnan(found):
            raise refusal(where, "is not a number (NaN)")
        if not (found > above or above == -math.inf) or not low <= found <= high:
            limits = [f"above {above:g}"] * (above > -math.inf) + [f"from {low:g}"] * (low > -math.inf)
            limits += [f"up to {high:g}"] * (high < math.inf)
            raise refusal(where, f"wanted a number {' '.join(limits)}{unit and f' {unit}'}, found {shown(value)}")
        return found

    return check


def whole(low: int = 0) -> Schema:
    """A whole number from `low` to MAX_WHOLE."""

    def check(value: Any, where: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= MAX_WHOLE:
            raise refusal(where, f"wanted a whole number from {low} to {MAX_WHOLE}, found {shown(value)}")
        return value

    return check


def optional(schema: Schema) -> Schema:
    """Schema that also takes null."""
    return lambda value, where: None if value is None else schema(value, where)


def listing(item: Schema, least: int = 0, length: int | None = None, wanted: str = "a list") -> Schema:
    """A list with at least so many items, or exactly so many; messages count items from 1."""

    def check(value: Any, where: str) -> list:
        if not isinstance(value, list) or len(value) < least or (length is not None and len(value) != length):
            raise refusal(where, f"wanted {wanted}, found {shown(value)}")
        return [item(one, f"{where} item {n + 1}") for n, one in enumerate(value)]

    return check


def names(item: Schema, least: int = 0) -> Schema:
    """A mapping from free names to what `item` takes."""

    def check(value: Any, where: str) -> dict[str, Any]:
        if not isinstance(value, Mapping) or len(value) < least:
            raise refusal(where, f"wanted names and values, found {shown(value)}")
        return {str(key): item(one, inside(where, str(key))) for key, one in value.items()}

    return check


def having(known: Mapping[str, Schema], required: Sequence[str] = ()) -> Schema:
    """A mapping whose known keys are checked; others pass as they are."""

    def check(value: Any, where: str) -> dict[str, Any]:
        found = value if isinstance(value, Mapping) else {}
        kept = mapping(known, required)({k: v for k, v in found.items() if k in known} if found else value, where)
        return {**found, **kept}

    return check


def mapping(known: Mapping[str, Schema], required: Sequence[str] = ()) -> Schema:
    """A mapping with known keys."""

    def check(value: Any, where: str) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise refusal(where, f"wanted keys and values ({', '.join(known)}), found {shown(value)}")
        for key in value:
            if key not in known:
                near = get_close_matches(str(key), list(known), n=1)
                hint = f"did you mean {near[0]!r}?" if near else f"known keys: {', '.join(known)}"
                raise refusal(where, f"unknown key {shown(str(key))}; {hint}")
        for key in required:
            if value.get(key) is None:
                raise refusal(where, f"key {key!r} is missing")
        return {key: known[key](one, inside(where, key)) for key, one in value.items()}

    return check


def either(mappings: Schema, others: Schema) -> Schema:
    """The first schema for a mapping, the second for anything else."""
    return lambda value, where: (mappings if isinstance(value, Mapping) else others)(value, where)
