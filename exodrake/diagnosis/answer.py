"""The answer of a diagnosis as its diagnosis.json holds it: what readers of that file rely on, checked.

Further keys pass as they are, and so does a verdict word that is unknown here: an answer of a newer version has both.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError, printable
from exodrake.core.schema import (
    Schema,
    anything,
    flag,
    having,
    listing,
    names,
    number,
    optional,
    read_json,
    refusal,
    shown,
    text,
)
from exodrake.data.case import date_of

WORD = re.compile(r"[A-Z][A-Z_]{0,30}")


def line() -> Schema:
    """Text, with whatever no terminal or file would take shown escaped."""
    return lambda value, where: printable(text()(value, where))


def verdict(value: Any, where: str) -> str:
    """A word in capitals."""
    if not WORD.fullmatch(text()(value, where)):
        raise refusal(where, f"wanted a word in capitals, found {shown(value)}")
    return value


def moment(value: Any, where: str) -> datetime:
    """A date by ISO 8601, in UTC."""
    found = date_of(text()(value, where))
    try:
        return found.astimezone(UTC)  # pyright: ignore[reportOptionalMemberAccess]
    except (AttributeError, OverflowError):
        raise refusal(where, f"wanted a date as 2026-03-05, found {shown(value)}") from None


REAL = optional(number())  # null: not a number
INTERVAL = having({"value": REAL, "low": REAL, "high": REAL, "unit": line()}, ("unit",))
SHARE = having({"value": REAL})
EFFECT = having(
    {
        "id": line(),
        "kind": optional(line()),
        "role": optional(line()),
        "share": optional(SHARE),
        "rivals": optional(listing(having({"id": line(), "share": SHARE}, ("id",)))),
        "parameters": names(INTERVAL),
        "channels": names(names(INTERVAL)),
    },
    ("id", "parameters", "channels"),
)
SCHEMA = having(
    {
        "case": optional(line()),
        "serial": optional(line()),
        "date": optional(moment),
        "verdict": verdict,
        "where": having({"block": line()}, ("block",)),
        "effects": listing(EFFECT),
        "equivalents": listing(line()),
        "remainder": optional(having({"value": REAL, "noise_std": REAL, "block": optional(line())})),
        "confirmed": optional(flag),
        "closure": having({"overall": having({"value": REAL}), "rms": optional(names(REAL))}, ("overall",)),
        "reasons": optional(listing(line())),
        "seconds": REAL,
        "since": optional(having({"began": optional(having({"value": optional(line())}))})),
        "provenance": optional(
            having({"robot": optional(line()), "version": optional(line()), "code": optional(anything)})
        ),
    },
    required=("verdict", "where", "effects", "equivalents", "closure"),
)


def read_answer(path: str | Path) -> dict[str, Any]:
    """A diagnosis.json. InputError naming the file, and the key of what is missing or of another type."""
    return check_answer(read_json(path), str(path))


def check_answer(answer: Any, where: str) -> dict[str, Any]:
    """An answer as plain data, its `date` as a moment. InputError as `read_answer`."""
    if not isinstance(answer, dict):
        raise InputError(f"{where}: no answer of a diagnosis, found {shown(answer)}")
    return SCHEMA(answer, where)
