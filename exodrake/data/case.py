"""A case: a folder of logs from one robot in one state, and what is known about it.

`case.yaml` in the folder:

    name: wearer 3, Tuesday              # default: the folder's name
    robot: {tendon: {stiffness: 2500}}   # overrides of the nominal numbers, if any
    period: 0.02                         # s, the frame; default 0.02
    logs:
      - {file: sweeps_1.csv.gz, role: fit}
      - {file: sweeps_2.csv.gz, role: fit, repeats: sweeps_1.csv.gz}     # same reference again: gives the noise floor
      - {file: grasps.csv.gz, role: holdout, protocol: grasps}           # default protocol: the file's name

Without it, every log in the folder counts: all to fit but the last by name, which is held out. No other file is read.
"""

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.data.clock import regularise
from exodrake.data.log import REQUIRED, Log, write_log

ROLES = ("fit", "holdout")
PERIOD = 0.02  # s, frame of the nominal robot
FILE = "case.yaml"


@dataclass(frozen=True, eq=False)
class CaseLog:
    """One log of a case. repeats: file of the log whose reference this one runs again, or None."""

    log: Log
    protocol: str
    role: str
    repeats: str | None
    file: str


@dataclass(frozen=True, eq=False)
class Case:
    """Logs of one robot in one state.

    robot: overrides of the nominal numbers as in the robot file. period: frame [s]. notes: what was assumed or mended
    while reading. InputError for an unknown role, a doubled file, repeats of a log that is not there, and nothing to
    fit.
    """

    name: str
    robot: dict[str, Any]
    logs: tuple[CaseLog, ...]
    period: float = PERIOD
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        files = [item.file for item in self.logs]
        for item in self.logs:
            if item.role not in ROLES:
                raise InputError(f"{self.name}: log {item.file!r}: role {item.role!r} is none of {', '.join(ROLES)}")
            if files.count(item.file) > 1:
                raise InputError(f"{self.name}: log {item.file!r} comes twice")
            if item.repeats is not None and (item.repeats == item.file or item.repeats not in files):
                raise InputError(
                    f"{self.name}: log {item.file!r}: repeats {item.repeats!r}, which is no other log of the case"
                )
        if not self.fit_logs:
            raise InputError(f"{self.name}: no log has the role 'fit'")

    @property
    def fit_logs(self) -> tuple[CaseLog, ...]:
        """Logs to fit, in order."""
        return tuple(item for item in self.logs if item.role == "fit")

    @property
    def holdout_logs(self) -> tuple[CaseLog, ...]:
        """Logs held out, in order; may be empty."""
        return tuple(item for item in self.logs if item.role == "holdout")

    @property
    def repeat_groups(self) -> tuple[tuple[CaseLog, ...], ...]:
        """Groups of two or more logs that run the same reference, in order."""
        heads = {item.file: item.repeats for item in self.logs}
        groups: dict[str, list[CaseLog]] = {}
        for item in self.logs:
            groups.setdefault(_head(item.file, heads), []).append(item)
        return tuple(tuple(group) for group in groups.values() if len(group) > 1)


def read_case(folder: str | Path, required: Sequence[str] = REQUIRED, period: float | None = None) -> Case:
    """Read a case folder, or one log file as a case of itself. InputError names file and key, or file, column and row.

    required: as in `read_log`. period: frame [s] when case.yaml gives none. Repeated rows and missing frames are
    mended and noted; a clock that steps backwards is refused.
    """
    from exodrake.core.files import is_file, is_folder
    from exodrake.data.case_file import find_logs, read_case_file
    from exodrake.data.formats.table import stem

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
    page = read_case_file(place / FILE)
    return _case(page.name or name, place, page.logs, page.robot, page.period or period or PERIOD, required)


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
    from exodrake.data.formats.table import stem

    logs, said = [], list(notes)
    for entry in entries:
        log, faults = _read(place / entry["file"], required, period)
        said += faults
        protocol = entry.get("protocol") or stem(entry["file"])
        logs.append(CaseLog(log, protocol, entry.get("role", "fit"), entry.get("repeats"), entry["file"]))
    if all(item.role == "fit" for item in logs):
        said.append(f"{name}: no log is held out, so closure cannot be judged on motion the fit never saw")
    return Case(name, robot, tuple(logs), period, tuple(said))


def _read(path: Path, required: Sequence[str], period: float) -> tuple[Log, list[str]]:
    from exodrake.data.formats.table import check_columns, read_table

    log = read_table(path)
    check_columns(log, required)
    return regularise(log, period)


def _write_into(case: Case, folder: Path) -> None:
    """Logs first: a folder with a case.yaml is complete."""
    from exodrake.core.files import write_text
    from exodrake.data.case_file import case_text

    for item in case.logs:
        path = folder / item.file
        if not path.resolve().is_relative_to(folder.resolve()):
            raise InputError(f"{case.name}: log {item.file!r} would be written outside {folder}")
        path.parent.mkdir(parents=True, exist_ok=True)
        write_log(item.log, path)
    write_text(folder / FILE, case_text(case))


def _head(file: str, heads: dict[str, str | None]) -> str:
    """The first log of the chain of repeats; a ring of repeats ends at its first name in the alphabet."""
    seen = [file]
    while (before := heads.get(seen[-1])) is not None:
        if before in seen:
            return min(seen[seen.index(before) :])
        seen.append(before)
    return seen[-1]
