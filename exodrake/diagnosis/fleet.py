"""A fleet: the answers to many cases as a table, also as a Parquet file, and changes over the cases of a robot.

    rows = read_answers("answers")                  # folders that `exodrake diagnose --out` or `blind run` wrote
    write_text("fleet.parquet", table_bytes(rows))

A case belongs to the robot that its `serial` names (case.yaml), else to one of its own.
"""

from __future__ import annotations

import io
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError, printable
from exodrake.core.files import is_folder, read_bytes
from exodrake.core.processes import in_child
from exodrake.core.schema import having, read_json
from exodrake.data.formats.parquet import import_pyarrow, parse_rows
from exodrake.diagnosis.change_point import DRAWS, LEAST, ROUNDING, Change, ChangePoint
from exodrake.diagnosis.many import ANSWER, FAILED, FAILURE, check_answer, line
from exodrake.diagnosis.result import CAUSE, NAMED, NO_GAP, RETUNE
from exodrake.machines.robot_file import machine_folders, machine_named

MAGIC = b"PAR1"  # a Parquet file begins so
LATER = ("confirmed",)  # columns that tables of older versions lack
MOST = 60  # points of a trend


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
    """A case of a fleet."""

    case: str
    serial: str  # of its robot
    machine: str = ""  # robot file that it was compared with
    date: datetime | None = None  # of its last session
    verdict: str = FAILURE
    block: str = ""  # where the gap lies
    effects: tuple[str, ...] = ()  # ids that are named, or that an ambiguous verdict leaves
    amounts: tuple[Amount, ...] = ()  # amplitudes of the effects
    closure: float = float("nan")  # fraction of the excess error that is gone; NaN if there was none
    confirmed: bool | None = None  # whether held-out logs confirm the effects; None where they say nothing
    before: float = float("nan")  # RMS error of the nominal robot [noise_std]
    after: float = float("nan")  # the same of the last robot [noise_std]
    began: str = ""  # date at which the case's own sessions changed; empty if they did not
    run_time: float = float("nan")  # of the diagnosis [s]
    reason: str = ""  # of a failure, else of the verdict
    version: str = ""  # of what answered it
    code: str = ""


def read_row(answer: Mapping[str, Any], name: str) -> Row:
    """The row of a diagnosis.json. InputError naming the case, and the key of what is damaged."""
    found = check_answer(answer, name)
    made, rms, amounts = found.get("provenance") or {}, found["closure"].get("rms") or {}, []
    causes = [effect for effect in found["effects"] if effect.get("role", CAUSE) == CAUSE]
    for effect in causes:  # its first parameter, channel by channel where it has several
        for parameter, item in list(effect["parameters"].items())[:1]:
            for channel, one in (effect["channels"].get(parameter) or {"": item}).items():
                head = effect["id"], printable(parameter), printable(channel)
                value, low, high = (to_float(one.get(end)) for end in ("value", "low", "high"))
                amounts.append(Amount(*head, value, low, high, one["unit"]))
    return Row(
        name, found.get("serial") or name, made.get("robot") or "", found.get("date"), found["verdict"],
        found["where"]["block"], tuple(found["equivalents"] or [e["id"] for e in causes]), tuple(amounts),
        closure=to_float(found["closure"]["overall"].get("value")), confirmed=found.get("confirmed"),
        before=to_float(rms.get("before")), after=to_float(rms.get("after")),
        began=((found.get("since") or {}).get("began") or {}).get("value") or "",
        run_time=to_float(found.get("seconds")), reason="; ".join(found.get("reasons") or []),
        version=made.get("version") or "", code=str(made.get("code") or ""),
    )  # fmt: skip


def to_float(value: float | None) -> float:
    """A number of a file, whose null is NaN."""
    return float("nan") if value is None else value


def find_answers(*sources: str | Path) -> dict[str, Path]:
    """Files of answers and failures by the name of their case; several of one name have those of their folders, too.

    sources: files that `exodrake diagnose --json` wrote, of one case or of several, folders of these or of folders with
    `diagnosis.json`, and such a folder itself.
    """
    found: dict[Path, Path] = {}  # place -> file
    for source in map(Path, sources):
        kinds = ("*.json", f"*/{FAILED}", f"*/{ANSWER}", ANSWER)  # of two in a folder the last counts
        for file in (file for kind in kinds for file in source.glob(kind)) if is_folder(source) else [source]:
            found[(file.parent if file.name in (ANSWER, FAILED) else file).resolve()] = file
    counts, root = Counter(place.name for place in found), os.path.commonpath([place.parent for place in found] or "/")
    names = (place.name if counts[place.name] == 1 else os.path.relpath(place, root) for place in found)
    return {printable(name.removesuffix(".json")): file for name, file in zip(names, found.values())}


def read_answers(*sources: str | Path) -> list[Row]:
    """Rows of `find_answers` by robot and date; InputError for a file that is no answer, and without answers."""
    rows, stated = [], set(map(Path, sources))
    for name, file in find_answers(*sources).items():
        try:
            content = read_json(file)
            if isinstance(content, list):
                named = ((one, having({"case": line}, ("case",))(one, str(file))["case"]) for one in content)
                rows += [read_row(one, case) for one, case in named]
            elif file.name == FAILED:
                rows.append(Row(name, name, reason=having({"reason": line})(content, str(file)).get("reason", "")))
            else:
                rows.append(read_row(content, name))
        except InputError as error:
            if file in stated:
                raise
            rows += [Row(name, name, reason=str(error))] if file.name in (ANSWER, FAILED) else []
    if not rows:
        names = ", ".join(map(str, sources))
        raise InputError(f"{names}: no answers in it (folders with {ANSWER}, or files of `exodrake diagnose --json`)")
    return sort_rows(rows)


def sort_rows(rows: Iterable[Row]) -> list[Row]:
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
    return arrow.schema([(f.name, special.get(f.name, text if f.type == "str" else real)) for f in fields(Row)])


def table_bytes(rows: Iterable[Row]) -> bytes:
    """The table as Parquet. InputError without pyarrow."""
    arrow, parquet = import_pyarrow("the table")
    stream = io.BytesIO()
    parquet.write_table(arrow.Table.from_pylist([asdict(row) for row in rows], schema=schema(arrow)), stream)
    return stream.getvalue()


def read_table(path: str | Path) -> list[Row]:
    """Rows of a table. InputError for a damaged file, and naming a column that is missing or of another type."""
    data = read_bytes(path)
    if data[: len(MAGIC)] != MAGIC:
        raise InputError(f"{path}: neither a folder of answers nor a Parquet table")
    wanted = schema(import_pyarrow(str(path))[0])
    found = in_child(parse_rows, data, str(path), wanted, LATER, source=str(path), size=len(data))

    def read_cells(kind: type[Row] | type[Amount], values: Mapping[str, Any]) -> dict[str, Any]:
        texts = {f.name: values[f.name] for f in fields(kind) if f.type == "str"}
        if empty := next((name for name, cell in texts.items() if cell is None), None):
            raise InputError(f"{path}: column {empty!r}: a cell is empty, wanted text")
        numbers = {f.name: to_float(values[f.name]) for f in fields(kind) if f.type == "float"}
        return {name: printable(cell) for name, cell in texts.items()} | numbers

    rows = []
    for values in found:
        effects, amounts = values["effects"] or (), values["amounts"] or ()
        if empty := next((n for n, items in (("effects", effects), ("amounts", amounts)) if None in items), None):
            raise InputError(f"{path}: column {empty!r}: an item is empty")
        row = read_cells(Row, values) | {"effects": tuple(map(printable, effects)), "confirmed": values["confirmed"]}
        row["amounts"] = tuple(Amount(**read_cells(Amount, item)) for item in amounts)
        rows.append(Row(**row, date=values["date"] and values["date"].astimezone(UTC)))
    return sort_rows(rows)


@dataclass(frozen=True, eq=False)
class Trend:
    """Trend of the amplitude of a cause over the cases of a robot."""

    serial: str  # of the robot
    effect: str
    parameter: str  # `1 / stiffness` for a reciprocal
    channel: str
    unit: str
    first: datetime  # date of the first case
    times: np.ndarray  # (points,) since then [d]
    values: np.ndarray  # (points,) amplitudes [unit]
    p: float  # p-value of no change, corrected for the number of trends of the robot
    change: Change | None  # None where p is above the level

    def moment(self, time: float) -> str:
        """Day of a time [d]."""
        return (self.first + timedelta(days=float(time))).date().isoformat()


def find_trends(rows: Sequence[Row]) -> list[Trend]:
    """Trends of one robot's rows, the clearest change first; none with too few dated cases.

    The scatter is estimated: the stated intervals hold the error of the law, alike in all cases. Null values have none,
    so the p-value of a series with some is that of a permutation test (Fisher 1935).
    """
    dated, trends = [(row, row.date) for row in rows if row.date is not None], []
    keys = dict.fromkeys((a.effect, a.parameter, a.channel, a.unit) for row, _ in dated for a in row.amounts)
    series = [(key, *found) for key in keys if len((found := follow_amount(dated, key))[0]) >= LEAST]
    for (effect, parameter, channel, unit), times, values, absent in series:
        if np.isinf(null_value(effect, parameter)):
            parameter, unit = f"1 / {parameter}", f"1/({unit})"
        spread, p, change = float(np.ptp(values)), 1.0, None
        if spread > 0.0:
            scan, alone = ChangePoint(times, (ROUNDING * spread) ** 2 * np.eye(len(times)), grid=1), None
            if absent:  # share of the orders of the values that show a change as clear, for values of any law
                rng = np.random.default_rng(len(values))
                odds = scan.log_odds(np.column_stack([values, *(rng.permutation(values) for _ in range(DRAWS))]))
                alone = float(np.mean(odds >= odds[0] - ROUNDING))
            p, change = scan.judge(values, len(series), alone)
        trends.append(Trend(rows[0].serial, effect, parameter, channel, unit, dated[0][1], times, values, p, change))
    return sorted(trends, key=lambda t: (t.p, -(t.change.size if t.change else 0.0)))


@cache
def null_value(effect: str, parameter: str) -> float:
    """Value of an effect's parameter where the effect is absent; 0 of an effect that no machine has."""
    effects = (known for name in machine_folders() for known in machine_named(name).effects if known.id == effect)
    return next((p.null for known in effects for p in known.parameters if p.name == parameter), 0.0)


def follow_amount(
    rows: Sequence[tuple[Row, datetime]], key: tuple[str, str, str, str]
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Days since the first row and amplitudes (points,) of a cause [unit], and whether a case lacks it.

    A case without a gap, to be retuned, or that names another effect counts with the null value; other cases without
    the cause do not count. Amplitudes are reciprocal where the null value is infinite, as of a stiffness. Where there
    are too many, medians of consecutive ones are used, since a mean would turn a step into a slope.
    """
    null, days, values, missed = null_value(*key[:2]), [], [], False
    for row, date in rows:
        own = [a.value for a in row.amounts if (a.effect, a.parameter, a.channel, a.unit) == key]
        absent = row.verdict in (NO_GAP, RETUNE, NAMED) and not own
        if (own and row.verdict == NAMED) or absent:
            value = own[0] if own else null
            values.append(1.0 / value if np.isinf(null) and value != 0.0 else value)
            days.append((date - rows[0][1]) / timedelta(days=1))
            missed |= absent
    known = np.isfinite(values)
    times, at, counts = np.unique(np.array(days)[known], return_inverse=True, return_counts=True)
    means = np.bincount(at, np.array(values)[known], len(times)) / counts
    groups = [g for g in np.array_split(np.arange(len(times)), min(MOST, max(len(times), 1))) if len(g)]
    return np.array([times[g].mean() for g in groups]), np.array([np.median(means[g]) for g in groups]), missed
