"""Case folders, read and written."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from exodrake.core.argument import argument
from exodrake.core.errors import InputError, printable
from exodrake.core.files import is_file, is_folder, sha256_of, write_folder
from exodrake.core.schema import refusal, shown
from exodrake.data.case import FILE, PERIOD, Case, CaseLog
from exodrake.data.case_file import CaseFile, case_text, find_logs, log_names, read_case_file
from exodrake.data.clock import regularise
from exodrake.data.formats import stem
from exodrake.data.log import check_columns
from exodrake.data.log_file import log_bytes, read_table
from exodrake.data.notes import read_notes
from exodrake.data.simulated import simulated_notes


def read_case(
    folder: str | Path,
    required: Sequence[str] = (),
    period: float | None = None,
    allow_outside: bool = False,
) -> Case:
    """Read a case folder, or one log file as a case of itself. InputError names file and key, or file, column and row.

    Repeated rows and missing frames are mended and noted; a clock that steps backwards is refused.

    Args:
        folder: the folder, its case.yaml, or a log.
        required: as in `read_log`.
        period: frame [s] when case.yaml gives none.
        allow_outside: whether logs may lie outside the folder, by their names (`../a.csv`) or as links.
    """
    place = Path(folder)
    if is_file(place) and place.name != FILE:
        return _case(stem(place), place.parent, [{"file": place.name}], {}, period or PERIOD, required)
    place = place.parent if place.name == FILE and is_file(place) else place
    if not is_folder(place):
        raise InputError(f"{folder}: no such folder")
    if is_file(place / FILE):
        content, notes, read_from = read_case_file(place / FILE), [], place / FILE
    else:
        for file in log_names(place) if not allow_outside else ():
            check_inside(place, file, str(folder))
        (entries, notes), read_from = find_logs(place), None
        content = CaseFile(None, {}, None, tuple(entries))
    name = printable(content.name or place.resolve().name)
    for entry in content.logs if not allow_outside else ():
        check_inside(place, entry["file"], str(folder))
    return _case(
        name, place, content.logs, content.robot, content.period or period or PERIOD, required, notes, read_from,
        content.serial,
    )  # fmt: skip


def write_case(case: Case, folder: str | Path) -> None:
    """Write logs and case.yaml; `read_case` gives the same case back. A new folder appears whole or not at all."""
    for item in argument("case", case, Case).logs:
        check_inside(folder, item.file, case.name)
    contents = {item.file: log_bytes(item.log, Path(folder) / item.file) for item in case.logs}
    write_folder(folder, contents | {FILE: case_text(case).encode()})


def check_inside(folder: str | Path, file: str, where: str) -> None:
    """InputError, saying where the name stands, if a log's name or link leads out of the folder of its case."""
    try:
        inside = (Path(folder) / file).resolve().is_relative_to(Path(folder).resolve())
    except (OSError, ValueError, RuntimeError):  # a name too long, a null byte, a ring of links
        inside = False
    if not inside:
        raise refusal(f"{where}: log {shown(file)}", "lies outside the folder; --allow-outside reads it")


def _case(
    name: str,
    place: Path,
    entries: Sequence[dict[str, Any]],
    robot: dict[str, Any],
    period: float,
    required: Sequence[str],
    notes: Sequence[str] = (),
    read_from: Path | None = None,
    serial: str = "",
) -> Case:
    logs, said = [], list(notes)
    hashes = {} if read_from is None else {FILE: sha256_of(read_from)}
    for entry in entries:
        path, repeats = place / entry["file"], entry.get("repeats")
        file = _relative(entry["file"], place)
        table = entry["table"] if "table" in entry else read_table(path)
        check_columns(table, required)
        log, faults = regularise(table, period)
        log = replace(log, simulated=table.simulated)
        hashes[file] = sha256_of(path)
        said += read_notes(path)
        said += [fault.replace(str(path), file) for fault in faults]  # the answer holds them
        protocol = entry.get("protocol") or stem(file)
        repeats = repeats and _relative(repeats, place)
        logs.append(CaseLog(log, protocol, entry.get("role", "fit"), repeats, file, entry.get("date")))
    said += simulated_notes({item.file: item.log for item in logs}, name)
    return Case(name, robot, tuple(logs), period, tuple(said), hashes, serial)


def _relative(file: str, place: Path) -> str:
    """A log's name seen from the folder of its case, since answers hold it: no absolute path."""
    return os.path.relpath(file, place) if os.path.isabs(file) else file
