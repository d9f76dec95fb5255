"""A fleet: the answers to many cases as one table, a row each, and as a Parquet file.

    rows = read_answers("answers")                  # folders that `exodrake diagnose --out` or `blind run` wrote
    write_text("fleet.parquet", table_bytes(rows))

A case belongs to the robot that its `serial` names (case.yaml), else to one of the case's own name.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from exodrake.core.child import in_child
from exodrake.core.errors import InputError, printable
from exodrake.core.files import is_file, is_folder, read_bytes
from exodrake.core.json_file import read_json
from exodrake.data.formats.parquet import parse_rows, pyarrow_of
from exodrake.diagnosis.answer import check_answer
from exodrake.diagnosis.many import ANSWER, FAILED

FAILURE = "FAILED"  # verdict of a case without an answer
MAGIC = b"PAR1"  # a Parquet file begins so
LATER = ("confirmed",)  # columns that tables of older versions lack
UNREADABLE = "its answer cannot be read"


@dataclass(frozen=True)
class Amount:
    """An amplitude of a named effect on a channel ("" for the whole robot) with its 90 % interval [unit]."""

    effect: str
    parameter: str
    channel: str
    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Row:
    """A case of a fleet.

    Attributes:
        case: name.
        serial: of its robot.
        machine: robot file that it was compared with.
        date: of its last session, or None.
        verdict: its word, or `FAILED`.
        block: where the gap lies.
        effects: ids that are named, or that an ambiguous verdict leaves.
        amounts: amplitudes of the effects.
        closure: fraction of the excess error that is gone; NaN if there was none.
        confirmed: whether held-out logs confirm the effects; None where they say nothing.
        before, after: RMS error of the nominal and the last robot [noise_std].
        began: date at which the case's own sessions changed; empty if they did not.
        run_time: of the diagnosis [s].
        reason: of a failure, else of the verdict.
        version, code: of what answered it.
    """

    case: str
    serial: str
    machine: str = ""
    date: datetime | None = None
    verdict: str = FAILURE
    block: str = ""
    effects: tuple[str, ...] = ()
    amounts: tuple[Amount, ...] = ()
    closure: float = float("nan")
    confirmed: bool | None = None
    before: float = float("nan")
    after: float = float("nan")
    began: str = ""
    run_time: float = float("nan")
    reason: str = ""
    version: str = ""
    code: str = ""


def row_of(answer: Mapping[str, Any], name: str) -> Row:
    """The row of a diagnosis.json. InputError naming the case, and the key of what is damaged."""
    found = check_answer(answer, name)
    made, rms = found.get("provenance") or {}, found["closure"].get("rms") or {}
    began = (found.get("since") or {}).get("began") or {}
    return Row(
        case=name,
        serial=found.get("serial") or found.get("case") or name,
        machine=made.get("robot") or "",
        date=found.get("date"),
        verdict=found["verdict"],
        block=found["where"]["block"],
        effects=tuple(found["equivalents"] or [e["id"] for e in found["effects"]]),
        amounts=tuple(amount for effect in found["effects"] for amount in amounts_of(effect)),
        closure=real(found["closure"]["overall"].get("value")),
        confirmed=found.get("confirmed"),
        before=real(rms.get("before")),
        after=real(rms.get("after")),
        began=began.get("value") or "",
        run_time=real(found.get("seconds")),
        reason="; ".join(found.get("reasons") or []),
        version=made.get("version") or "",
        code=str(made.get("code") or ""),
    )


def amounts_of(effect: Mapping[str, Any]) -> list[Amount]:
    """The first parameter of an effect, channel by channel where it has several."""
    for name, item in effect["parameters"].items():
        each = effect["channels"].get(name) or {"": item}
        head = effect["id"], printable(name)
        return [Amount(*head, printable(c), *ends(one), one["unit"]) for c, one in each.items()]
    return []


def ends(item: Mapping[str, Any]) -> tuple[float, float, float]:
    """Value, low and high of an interval."""
    return real(item.get("value")), real(item.get("low")), real(item.get("high"))


def real(value: float | None) -> float:
    """A number of a file, whose null is NaN."""
    return float("nan") if value is None else value


def read_answers(folder: str | Path) -> list[Row]:
    """Rows of all answers and failures in the folders of a folder, by robot and date.

    Raises:
        InputError: if the folder has no answers.
    """
    folder, rows = Path(folder), []
    for place in sorted(path for path in folder.iterdir() if is_folder(path)) if is_folder(folder) else ():
        name = printable(place.name)
        if is_file(place / ANSWER):
            try:
                rows.append(row_of(read_json(place / ANSWER), name))
            except InputError as error:
                rows.append(Row(name, name, reason=str(error)))
        elif is_file(place / FAILED):
            rows.append(Row(name, name, reason=failure_of(place / FAILED)))
    if not rows:
        raise InputError(f"{folder}: no answers in it (folders with {ANSWER}, as `exodrake diagnose --out` writes)")
    return ordered(rows)


def failure_of(path: Path) -> str:
    """Reason of a failure, by its file, or why that cannot be read."""
    try:
        failure = read_json(path)
    except InputError as error:
        return str(error)
    return printable(str(failure.get("reason", ""))) if isinstance(failure, Mapping) else f"{path}: {UNREADABLE}"


def ordered(rows: Iterable[Row]) -> list[Row]:
    """Rows by robot and date."""
    first = datetime.min.replace(tzinfo=UTC)
    return sorted(rows, key=lambda row: (row.serial, row.date or first, row.case))


def schema(arrow: Any) -> Any:
    """Columns of the table."""
    text, real = arrow.string(), arrow.float64()
    amount = arrow.struct([(f.name, text if f.type == "str" else real) for f in fields(Amount)])
    special = {
        "date": arrow.timestamp("s", tz="UTC"),
        "confirmed": arrow.bool_(),
        "effects": arrow.list_(text),
        "amounts": arrow.list_(amount),
    }
    kinds = {f.name: special.get(f.name, text if f.type == "str" else real) for f in fields(Row)}
    return arrow.schema(list(kinds.items()))


def table_bytes(rows: Iterable[Row]) -> bytes:
    """The table as Parquet. InputError without pyarrow."""
    arrow, parquet = pyarrow_of("the table")
    stream = io.BytesIO()
    parquet.write_table(arrow.Table.from_pylist([asdict(row) for row in rows], schema=schema(arrow)), stream)
    return stream.getvalue()


def read_table(path: str | Path) -> list[Row]:
    """Rows of a table. InputError for a damaged file, and naming a column that is missing or of another type."""
    data = read_bytes(path)
    if data[: len(MAGIC)] != MAGIC:
        raise InputError(f"{path}: neither a folder of answers nor a Parquet table")
    wanted = schema(pyarrow_of(str(path))[0])
    found = in_child(parse_rows, data, str(path), wanted, LATER, source=str(path), size=len(data))
    return ordered(row_from(values, str(path)) for values in found)


def row_from(values: dict[str, Any], source: str) -> Row:
    """A row of the table. InputError, saying where it comes from, for a cell or an item that is empty."""
    date = values["date"] and values["date"].astimezone(UTC)
    effects, items = values["effects"] or (), values["amounts"] or ()
    if None in effects or None in items:
        raise InputError(f"{source}: column {'effects' if None in effects else 'amounts'!r}: an item is empty")
    amounts = tuple(Amount(**cells_of(Amount, item, source)) for item in items)
    found = {
        "effects": tuple(map(printable, effects)),
        "amounts": amounts,
        "date": date,
        "confirmed": values["confirmed"],
    }
    return Row(**cells_of(Row, values, source) | found)


def cells_of(kind: type[Row] | type[Amount], values: Mapping[str, Any], source: str) -> dict[str, Any]:
    """Texts and numbers of a row or an amount by name."""
    found = {}
    for name, what in ((f.name, f.type) for f in fields(kind) if f.type in ("str", "float")):
        if values[name] is None and what == "str":
            raise InputError(f"{source}: column {name!r}: a cell is empty, wanted text")
        found[name] = printable(values[name]) if what == "str" else real(values[name])
    return found
