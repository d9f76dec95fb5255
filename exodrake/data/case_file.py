"""case.yaml: read by its schema, and written."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.plain import plain
from exodrake.core.schema import anything, listing, mapping, names, number, optional, refusal, text
from exodrake.core.yaml_file import dump_yaml, read_yaml
from exodrake.data.case import ROLES, Case
from exodrake.data.formats import ending

LONGEST_FRAME = 10.0  # s; a longer one is a mistaken unit: quasi-static logs have frames of a second
LOG = mapping(
    {"file": text(), "role": optional(text(ROLES)), "protocol": optional(text()), "repeats": optional(text())},
    required=("file",),
)
SCHEMA = mapping(
    {
        "name": anything,
        "robot": optional(names(anything)),
        "period": optional(number(above=0.0, high=LONGEST_FRAME, unit="s")),
        "logs": listing(LOG, least=1, wanted="a list of logs"),
    },
    required=("logs",),
)


@dataclass(frozen=True)
class CaseFile:
    """Content of a case.yaml: name, overrides of parameters, frame period [s], and keys of each log."""

    name: str | None
    robot: dict[str, Any]
    period: float | None
    logs: tuple[dict[str, Any], ...]


def read_case_file(path: Path) -> CaseFile:
    """Reads and checks a case.yaml; InputError names file and key."""
    content = SCHEMA(read_yaml(path), str(path))
    logs = tuple({**log, "role": log.get("role") or "fit"} for log in content["logs"])
    _check_files(logs, f"{path}, 'logs'")
    name = content.get("name")
    return CaseFile(None if name is None else str(name), content.get("robot") or {}, content.get("period"), logs)


def find_logs(folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Logs of a folder without case.yaml, and a note on what was assumed; InputError for a folder without logs."""
    files = sorted(item.name for item in folder.iterdir() if ending(item) and item.is_file() and item.name[0] != ".")
    if not files:
        raise InputError(f"{folder}: no case.yaml and no logs")
    held_out = files[-1] if len(files) > 1 else None
    logs = [{"file": name, "role": "holdout" if name == held_out else "fit"} for name in files]
    return logs, [
        f"{folder.resolve().name}: no case.yaml; {len(files)} logs, held out: {held_out or 'none'}, the others to fit"
    ]


def case_text(case: Case) -> str:
    """case.yaml of a case."""
    logs = []
    for item in case.logs:
        log = {"file": item.file, "role": item.role, "protocol": item.protocol, "repeats": item.repeats}
        logs.append({key: value for key, value in log.items() if value is not None})
    return dump_yaml({"name": case.name, "robot": plain(case.robot), "period": float(case.period), "logs": logs})


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
