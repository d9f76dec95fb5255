"""Case folders, read and written."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.files import is_file, is_folder, write_text
from exodrake.data.case import FILE, PERIOD, Case, CaseLog
from exodrake.data.case_file import case_text, find_logs, read_case_file
from exodrake.data.clock import regularise
from exodrake.data.columns import check_columns
from exodrake.data.formats import stem
from exodrake.data.log import REQUIRED, Log
from exodrake.data.log_file import read_table, write_log


def read_case(folder: str | Path, required: Sequence[str] = REQUIRED, period: float | None = None) -> Case:
    """Read a case folder, or one log file as a case of itself. InputError names file and key, or file, column and row.

    required: as in `read_log`. period: frame [s] when case.yaml gives none. Repeated rows and missing frames are
    mended and noted; a clock that steps backwards is refused.
    """
    place = Path(folder)
    if is_file(place) and place.name != FILE:
        return _case(stem(place), place.parent, [{"file": place.name}], {}, period or PERIOD, required)
    place = place.parent if place.name == FILE and is_file(place) else place
    if not is_folder(place):
        raise InputError(f"{folder}: no such folder")
    name = place.resolve().name
    if not (place / FILE).is_file():
        entries, notes = find_logs(place)
        return _case(name, place, entries, {}, period or PERIOD, required, notes)
    content = read_case_file(place / FILE)
    return _case(content.name or name, place, content.logs, content.robot, content.period or period or PERIOD, required)


def write_case(case: Case, folder: str | Path) -> None:
    """Write logs and case.yaml; `read_case` gives the same case back. A new folder appears whole or not at all."""
    target = Path(folder)
    if target.exists():
        _write_into(case, target)
        return
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        temporary.mkdir(parents=True)
        _write_into(case, temporary)
        temporary.replace(target)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _case(
    name: str,
    place: Path,
    entries: Sequence[dict[str, Any]],
    robot: dict[str, Any],
    period: float,
    required: Sequence[str],
    notes: Sequence[str] = (),
) -> Case:
    logs, said = [], list(notes)
    for entry in entries:
        log, faults = _read(place / entry["file"], required, period)
        said += faults
        protocol = entry.get("protocol") or stem(entry["file"])
        logs.append(CaseLog(log, protocol, entry.get("role", "fit"), entry.get("repeats"), entry["file"]))
    return Case(name, robot, tuple(logs), period, tuple(said))


def _read(path: Path, required: Sequence[str], period: float) -> tuple[Log, list[str]]:
    log = read_table(path)
    check_columns(log, required)
    return regularise(log, period)


def _write_into(case: Case, folder: Path) -> None:
    """Logs first: a folder with a case.yaml is complete."""
    for item in case.logs:
        path = folder / item.file
        if not path.resolve().is_relative_to(folder.resolve()):
            raise InputError(f"{case.name}: log {item.file!r} would be written outside {folder}")
        path.parent.mkdir(parents=True, exist_ok=True)
        write_log(item.log, path)
    write_text(folder / FILE, case_text(case))
