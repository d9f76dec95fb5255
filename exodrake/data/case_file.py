"""case.yaml: read by its schema, and written."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, time
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.plain import plain
from exodrake.core.schema import anything, listing, mapping, names, number, optional, refusal, shown, text
from exodrake.core.yaml_file import dump_yaml, read_yaml
from exodrake.data.case import ROLES, Case, date_of
from exodrake.data.formats import ending
from exodrake.data.log_file import read_table
from exodrake.data.simulated import robot_logs

LONGEST_FRAME = 10.0  # s; a longer one is a mistaken unit: quasi-static logs have frames of a second


def moment(value: Any, where: str) -> datetime:
    """A date, or a date with a time, by ISO 8601."""
    found = date_of(value) if isinstance(value, str) else None
    if found is None:
        raise refusal(where, f"wanted a date as 2026-03-05 or 2026-03-05T14:30, found {shown(value)}")
    return found


LOG = mapping(
    {
        "file": text(),
        "role": optional(text(ROLES)),
        "protocol": optional(text()),
        "repeats": optional(text()),
        "date": optional(moment),
    },
    required=("file",),
)
SCHEMA = mapping(
    {
        "name": anything,
        "serial": anything,
        "date": optional(moment),
        "robot": optional(names(anything)),
        "period": optional(number(above=0.0, high=LONGEST_FRAME, unit="s")),
        "logs": listing(LOG, least=1, wanted="a list of logs"),
    },
    required=("logs",),
)


@dataclass(frozen=True)
class CaseFile:
    """Content of a case.yaml: name, overrides of parameters, frame period [s], keys of each log, and serial number."""

    name: str | None
    robot: dict[str, Any]
    period: float | None
    logs: tuple[dict[str, Any], ...]
    serial: str = ""


def read_case_file(path: Path) -> CaseFile:
    """Reads and checks a case.yaml; InputError names file and key."""
    content = SCHEMA(read_yaml(path), str(path))
    date = content.get("date")
    logs = tuple({**log, "role": log.get("role") or "fit", "date": log.get("date") or date} for log in content["logs"])
    _check_files(logs, f"{path}, 'logs'")
    name, serial = (None if content.get(key) is None else str(content[key]) for key in ("name", "serial"))
    return CaseFile(name, content.get("robot") or {}, content.get("period"), logs, serial or "")


def log_names(folder: Path) -> list[str]:
    """Files of a folder that are logs by their ending, in order; hidden ones are none."""
    return sorted(item.name for item in folder.iterdir() if ending(item) and item.is_file() and item.name[0] != ".")


def find_logs(folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Logs of a folder without case.yaml, each with its `table`, and notes on what was assumed and left out.

    InputError for a folder without logs of a robot.
    """
    files = log_names(folder)
    if not files:
        raise InputError(f"{folder}: no case.yaml and no logs")
    tables = {name: read_table(folder / name) for name in files}
    files, notes = robot_logs(tables, str(folder))
    held_out = files[-1] if len(files) > 1 else None
    logs = [{"file": name, "role": "holdout" if name == held_out else "fit", "table": tables[name]} for name in files]
    roles = f"{len(files)} logs, held out: {held_out}, the others to fit" if held_out else "one log, to fit"
    return logs, [f"{folder.resolve().name}: no case.yaml; {roles}", *notes]


def case_text(case: Case) -> str:
    """case.yaml of a case."""
    logs = []
    for item in case.logs:
        log = {"file": item.file, "role": item.role, "protocol": item.protocol, "repeats": item.repeats}
        log["date"] = None if item.date is None else written_date(item.date)
        logs.append({key: value for key, value in log.items() if value is not None})
    head = {"name": case.name} | ({"serial": case.serial} if case.serial else {})
    return dump_yaml(head | {"robot": plain(case.robot), "period": float(case.period), "logs": logs})


def written_date(date: datetime) -> str:
    """A moment by ISO 8601: the day alone where it is midnight of Coordinated Universal Time, else to the second."""
    whole = date.tzinfo == UTC and date.time() == time()
    return date.date().isoformat() if whole else date.isoformat().replace("+00:00", "Z")


def _check_files(logs: Sequence[dict[str, Any]], where: str) -> None:
    """Refuses a file named twice, repeats of no other log, and a case with nothing to fit."""
    files = [log["file"] for log in logs]
    for n, log in enumerate(logs):
        if files.index(log["file"]) != n:
            raise refusal(f"{where} item {n + 1}, 'file'", f"{log['file']!r} comes twice")
        if log.get("repeats") and (log["repeats"] == log["file"] or log["repeats"] not in files):
            raise refusal(f"{where} item {n + 1}, 'repeats'", f"{log['repeats']!r} is no other log of the case")
    if all(log["role"] != "fit" for log in logs):
        raise refusal(where, "no log has the role 'fit'")
