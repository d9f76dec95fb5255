"""case.yaml: read with every key checked, and written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from exodrake.core.errors import InputError
from exodrake.core.files import read_yaml

if TYPE_CHECKING:
    from exodrake.data.case import Case

LONGEST_FRAME = 10.0  # s; a longer one is a mistaken unit: quasi-static logs have frames of a second
KEYS = ("name", "robot", "period", "logs")
LOG_KEYS = ("file", "role", "protocol", "repeats")


@dataclass(frozen=True)
class CaseFile:
    """What a case.yaml says. logs: one dict per log with `file`, and `role`, `protocol`, `repeats` where given."""

    name: str | None
    robot: dict[str, Any]
    period: float | None
    logs: tuple[dict[str, Any], ...]


def check_keys(given: Any, allowed: Sequence[str], where: str) -> Mapping[str, Any]:
    """The mapping itself. InputError if it is none, or has a key that is not allowed (with the nearest one that is)."""
    if not isinstance(given, Mapping):
        raise InputError(f"{where}: wanted keys and values ({', '.join(allowed)}), found {_shown(given)}")
    for key in given:
        if key not in allowed:
            near = get_close_matches(str(key), allowed, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"known keys: {', '.join(allowed)}"
            raise InputError(f"{where}: unknown key {str(key)!r}; {hint}")
    return given


def read_case_file(path: Path) -> CaseFile:
    """Read and check a case.yaml. InputError names file and key."""
    page = check_keys(read_yaml(path), KEYS, str(path))
    logs = page.get("logs")
    if not isinstance(logs, list) or not logs:
        raise InputError(f"{path}: key 'logs': wanted a list of logs, found {_shown(logs)}")
    robot = page.get("robot") or {}
    if not isinstance(robot, Mapping):
        raise InputError(f"{path}: key 'robot': wanted overrides by name, found {_shown(robot)}")
    name = page.get("name")
    entries = tuple(_entry(item, f"{path}: key 'logs', item {n + 1}") for n, item in enumerate(logs))
    _check_files(entries, path)
    return CaseFile(None if name is None else str(name), _numbers(robot), _period(page.get("period"), path), entries)


def find_logs(folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Entries for a folder without case.yaml, and a note on what was assumed. InputError for a folder without logs."""
    from exodrake.data.formats.table import ending

    files = sorted(item.name for item in folder.iterdir() if ending(item) and item.is_file() and item.name[0] != ".")
    if not files:
        raise InputError(f"{folder}: no case.yaml and no logs")
    held_out = files[-1] if len(files) > 1 else None
    entries = [{"file": name, "role": "holdout" if name == held_out else "fit"} for name in files]
    return entries, [f"{folder}: no case.yaml; {len(files)} logs, held out: {held_out or 'none'}, the others to fit"]


def case_text(case: "Case") -> str:
    """case.yaml of a case."""
    logs = []
    for item in case.logs:
        entry = {"file": item.file, "role": item.role, "protocol": item.protocol, "repeats": item.repeats}
        logs.append({key: value for key, value in entry.items() if value is not None})
    page = {"name": case.name, "robot": _plain(case.robot), "period": float(case.period), "logs": logs}
    return yaml.safe_dump(page, sort_keys=False, allow_unicode=True)


def _entry(item: Any, where: str) -> dict[str, Any]:
    from exodrake.data.case import ROLES

    entry = dict(check_keys(item, LOG_KEYS, where))
    for key, value in entry.items():
        if not isinstance(value, str) and not (value is None and key != "file"):
            raise InputError(f"{where}: key {key!r}: wanted text, found {_shown(value)}")
    if not entry.get("file"):
        raise InputError(f"{where}: key 'file' is missing")
    entry["role"] = entry.get("role") or "fit"
    if entry["role"] not in ROLES:
        raise InputError(f"{where}: key 'role': {entry['role']!r} is none of {', '.join(ROLES)}")
    return entry


def _check_files(entries: Sequence[dict[str, Any]], path: Path) -> None:
    files = [entry["file"] for entry in entries]
    for number, entry in enumerate(entries):
        where = f"{path}: key 'logs', item {number + 1}"
        if files.index(entry["file"]) != number:
            raise InputError(f"{where}: key 'file': {entry['file']!r} comes twice")
        if entry.get("repeats") and (entry["repeats"] == entry["file"] or entry["repeats"] not in files):
            raise InputError(f"{where}: key 'repeats': {entry['repeats']!r} is no other log of the case")
    if all(entry["role"] != "fit" for entry in entries):
        raise InputError(f"{path}: key 'logs': no log has the role 'fit'")


def _period(value: Any, path: Path) -> float | None:
    number = _numbers(value)
    if number is None:
        return None
    if isinstance(number, bool) or not isinstance(number, int | float) or not 0 < number <= LONGEST_FRAME:
        raise InputError(f"{path}: key 'period': wanted seconds between 0 and {LONGEST_FRAME:g}, found {_shown(value)}")
    return float(number)


def _numbers(value: Any) -> Any:
    """YAML 1.1 reads 1e-3 as text (it wants 1.0e-3): text that is a number becomes one, at any depth."""
    if isinstance(value, Mapping):
        return {str(key): _numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_numbers(item) for item in value]
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value


def _plain(value: Any) -> Any:
    """Values YAML can write: numpy numbers and arrays as Python's own."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value


def _shown(value: Any) -> str:
    text = repr(value)
    return "nothing" if value is None else text if len(text) <= 40 else text[:37] + "..."
