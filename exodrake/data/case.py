"""A case: a folder of logs from one robot in one state, and what is known about it, in `case.yaml` or from the logs.

The keys of `case.yaml` are in `docs/howto/diagnose.md`. What was done to a log's signals before stands in
`NAME.notes.txt` beside it, a sentence a line.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, time
from pathlib import Path
from typing import Any

from exodrake.core import schema
from exodrake.core.errors import InputError, argument, printable, short_repr
from exodrake.core.files import hash_file, is_file, is_folder, read_bytes, write_folder
from exodrake.core.plain import plain
from exodrake.data.formats import ending, log_bytes, read_log, read_table, stem
from exodrake.data.log import MODEL, Log, check_columns, merge_notes, regularise

ROLES = ("fit", "holdout")
PERIOD = 0.02  # s, frame of the nominal robot
FILE = "case.yaml"
NOTES, MOST_NOTES = ".notes.txt", 100  # ending of the file beside a log; lines of it that are read
LONGEST_FRAME = 10.0  # s; a longer one is a mistaken unit: quasi-static logs have frames of a second
EXPERIMENT = "experiment"  # protocol of a motion designed to tell explanations apart; no part of it is left out


@short_repr
@dataclass(frozen=True, eq=False)
class CaseLog:
    """One log of a case.

    Attributes:
        log: columns of the log.
        protocol: name of the motion.
        role: use of the log: "fit" or "holdout".
        repeats: file of the log whose reference this one runs again, or None.
        file: name of the log's file.
        date: date of its session, or None; logs of one date are one session.

    Examples:
        >>> import numpy as np
        >>> CaseLog(Log(np.arange(3.0), {"angle_MCP": np.zeros(3)}), "grasp", "fit", None, "a.csv").role
        'fit'
    """

    log: Log
    protocol: str
    role: str
    repeats: str | None
    file: str
    date: datetime | None = None


@short_repr
@dataclass(frozen=True, eq=False)
class Case:
    """Logs of one robot in one state.

    Attributes:
        name: name of the case.
        robot: overrides of nominal parameters as in the robot file.
        logs: logs of the case, fitted or held out.
        period: frame period [s].
        notes: what was assumed or mended while reading, a sentence each.
        hashes: file -> SHA-256 of each file that the case was read from.
        serial: serial number of the robot, or "".
        noise: column -> standard deviation of its noise [SI], where a filter hides it.

    Raises:
        InputError: for an unknown role, a doubled file, repeats of a log that is not there, and nothing to fit.

    Examples:
        >>> import exodrake as exo
        >>> log = exo.simulate(exo.load_robot(), "caging")
        >>> mine = Case("mine", {}, (exo.CaseLog(log, "caging", "fit", None, "a.csv"),))
        >>> len(mine.fit_logs)
        1
    """

    name: str
    robot: dict[str, Any]
    logs: tuple[CaseLog, ...]
    period: float = PERIOD
    notes: tuple[str, ...] = field(default=())
    hashes: dict[str, str] = field(default_factory=dict)
    serial: str = ""
    noise: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        files = [item.file for item in self.logs]
        for item in self.logs:
            where = f"{self.name}: log {item.file!r}"
            if item.role not in ROLES:
                raise InputError(f"{where}: role {item.role!r} is none of {', '.join(ROLES)}")
            if files.count(item.file) > 1:
                raise InputError(f"{where} comes twice")
            if item.repeats is not None and (item.repeats == item.file or item.repeats not in files):
                raise InputError(f"{where}: repeats {item.repeats!r}, which is no other log of the case")
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
        """Groups of two or more fitted logs that run the same reference in one session, and so show the noise."""
        before = {item.file: item.repeats for item in self.logs}
        groups: dict[tuple[str, datetime | None], list[CaseLog]] = {}
        for item in self.fit_logs:
            chain = [item.file]
            while (earlier := before.get(chain[-1])) is not None and earlier not in chain:
                chain.append(earlier)
            ring = chain[chain.index(earlier) :] if earlier in chain else chain[-1:]  # its first name in the alphabet
            groups.setdefault((min(ring), item.date), []).append(item)
        return tuple(tuple(group) for group in groups.values() if len(group) > 1)

    def is_copy(self, item: CaseLog) -> bool:
        """Whether a log repeats another one of its session, and so serves the noise alone."""
        group = next((group for group in self.repeat_groups if item in group), (item,))
        return item is not next((one for one in group if one.repeats is None), group[0])


def parse_date(written: str) -> datetime | None:
    """The moment that a date or time by ISO 8601 names, UTC where it names no zone; None of anything else."""
    try:
        found = datetime.fromisoformat(written)
    except ValueError:
        return None
    return found if found.tzinfo else found.replace(tzinfo=UTC)


def moment(value: Any, where: str) -> datetime:
    """A date, or a date with a time, by ISO 8601."""
    found = parse_date(value) if isinstance(value, str) else None
    if found is None:
        raise schema.refusal(where, f"wanted a date as 2026-03-05 or 2026-03-05T14:30, found {schema.quote(value)}")
    return found


DATE, TEXT = schema.optional(moment), schema.optional(schema.text())
KEYS = {"file": schema.text(), "role": schema.optional(schema.text(ROLES))}
LOG = schema.mapping(KEYS | {"protocol": TEXT, "repeats": TEXT, "date": DATE}, required=("file",))
SCHEMA = schema.mapping(
    {
        "name": schema.anything, "serial": schema.anything, "date": DATE,
        "robot": schema.optional(schema.names(schema.anything)),
        "period": schema.optional(schema.number(above=0.0, high=LONGEST_FRAME, unit="s")),
        "noise": schema.optional(schema.names(schema.number(low=0.0))),
        "logs": schema.listing(LOG, least=1, wanted="a list of logs"),
    },
    required=("logs",),
)  # fmt: skip


def log_names(folder: Path) -> list[str]:
    """Files of a folder that are logs by their ending, in order; hidden ones are none."""
    return sorted(item.name for item in folder.iterdir() if ending(item) and item.is_file() and item.name[0] != ".")


def find_logs(folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Logs of a folder without case.yaml, each with its `table`, and notes on what was assumed and left out."""
    files = log_names(folder)
    if not files:
        raise InputError(f"{folder}: no case.yaml and no logs")
    tables = {name: read_table(folder / name) for name in files}
    wanted = max(log.simulated for log in tables.values()) if all(log.simulated for log in tables.values()) else 0
    if wanted == MODEL:
        model = "exodrake simulated all its logs with a robot as its file states it: they are the model, not the robot"
        raise InputError(f"{folder}: {model}; name a log itself to read it anyway")
    left_out = [name for name in files if tables[name].simulated != wanted]
    notes = [f"{', '.join(left_out)}: left out, simulated by exodrake and not a log of the robot"] if left_out else []
    files = [name for name in files if name not in left_out]
    held_out = files[-1] if len(files) > 1 else None
    logs = [{"file": name, "role": "holdout" if name == held_out else "fit", "table": tables[name]} for name in files]
    roles = f"{len(files)} logs, held out: {held_out}, the others to fit" if held_out else "one log, to fit"
    return logs, [f"{folder.resolve().name}: no case.yaml; {roles}", *notes]


def written_date(date: datetime) -> str:
    """A moment by ISO 8601: the day alone where it is midnight of Coordinated Universal Time, else to the second."""
    whole = date.tzinfo == UTC and date.time() == time()
    return date.date().isoformat() if whole else date.isoformat().replace("+00:00", "Z")


def read_case(
    folder: str | Path, required: Sequence[str] = (), period: float | None = None, allow_outside: bool = False
) -> Case:
    """Read a case folder, or one log file as a case of itself. InputError names file and key, or file, column and row.

    Repeated rows and missing frames are mended and noted; a clock that steps backwards is refused.

    Args:
        folder: the folder, its case.yaml, or a log.
        required: as in `read_log`.
        period: frame [s] when case.yaml gives none; by default the step of each log's own clock.
        allow_outside: whether logs may lie outside the folder, by their names (`../a.csv`) or as links.

    Examples:
        >>> import exodrake as exo
        >>> exo.write_log(exo.simulate(exo.load_robot(), "caging"), "mine.csv")
        >>> read_case("mine.csv").fit_logs[0].file
        'mine.csv'
    """
    place, notes, hashes = Path(folder), list[str](), dict[str, str]()
    content: dict[str, Any] = {}
    entries: list[dict[str, Any]] = []
    if is_file(place) and place.name != FILE:
        name, entries, place = stem(place), [{"file": place.name}], place.parent
    else:
        place = place.parent if place.name == FILE and is_file(place) else place
        if not is_folder(place):
            raise InputError(f"{folder}: no such file or folder")
        if is_file(place / FILE):
            content, hashes[FILE] = SCHEMA(schema.read_yaml(place / FILE), str(place / FILE)), hash_file(place / FILE)
            for key in ("name", "serial"):
                content[key] = "" if content.get(key) is None else str(content[key])
            for log in content["logs"]:
                log |= {"role": log.get("role") or "fit", "date": log.get("date") or content.get("date")}
        for file in [entry["file"] for entry in content["logs"]] if content else log_names(place):
            if not allow_outside:
                check_inside(place, file, str(folder))
        entries, notes = (content["logs"], []) if content else find_logs(place)
        name = printable(content.get("name") or place.resolve().name)
    logs, period, done = [], content.get("period") or period, dict[str, Sequence[str]]()
    for entry in entries:
        path, repeats = place / entry["file"], entry.get("repeats")
        file = relative_name(entry["file"], place)
        table = entry["table"] if "table" in entry else read_table(path)
        check_columns(table, required)
        log, faults = regularise(table, period or table.dt)
        hashes[file] = hash_file(path)
        beside = path.with_name(notes_name(path))
        lines = read_bytes(beside).decode(errors="replace").splitlines() if is_file(beside) else []
        done[path.name] = [line.strip() for line in lines[:MOST_NOTES] if line.strip()]
        notes += [fault.replace(str(path), file) for fault in faults]  # the answer holds them
        protocol, repeats = entry.get("protocol") or stem(file), repeats and relative_name(repeats, place)
        logs.append(CaseLog(log, protocol, entry.get("role", "fit"), repeats, file, entry.get("date")))
    notes += merge_notes(done)
    marked = [item.file for item in logs if item.log.simulated]
    if marked and len(marked) < len(logs):
        measured = next(item.file for item in logs if not item.log.simulated)
        raise InputError(f"{name}: log {marked[0]!r} is simulated by exodrake, {measured!r} is not: not one robot")
    notes += [f"{', '.join(marked)}: simulated by exodrake, not measured"] if marked else []
    try:
        robot, serial, noise = content.get("robot") or {}, content.get("serial", ""), content.get("noise") or {}
        frame = float(period or (logs[0].log.dt if logs else PERIOD))
        return Case(name, robot, tuple(logs), frame, tuple(notes), hashes, serial, noise)
    except InputError as problem:
        raise InputError(f"{place / FILE}: {problem}") from None


type LogSource = Case | Log | str | Path | Sequence[Log | str | Path]


def gather_logs(
    logs: LogSource, held_out: Sequence[Log | str | Path] = (), period: float | None = None,
    required: Sequence[str] = (),
) -> Case:  # fmt: skip
    """The case of what a user names: a case or its folder, a log, its file, a DataFrame, or several of these.

    Logs are to fit, where a case and a folder do not state their roles, or held out; `required`: kinds of columns that
    each must have. The frame is `period` [s], or the step of each log's own clock. InputError where a file cannot be
    read, or no log is given to fit.
    """
    if isinstance(logs, str | Path) and is_folder(logs):
        logs = read_case(logs, required, period)
    case = logs if isinstance(logs, Case) else None
    items, notes = (list(case.logs), list(case.notes)) if case else ([], [])
    several = isinstance(logs, Sequence) and not isinstance(logs, str)
    fitted: Any = [] if case else logs if several else [logs]
    for role, given in (("fit", fitted), ("holdout", held_out)):
        for one in given:
            log = Log.from_pandas(one) if hasattr(one, "iloc") else one
            log = read_log(log, required) if isinstance(log, str | Path) else argument("logs", log, Log, str, Path)
            check_columns(log, required)
            log, faults = regularise(log, period or log.dt)
            notes += faults
            items.append(CaseLog(log, "", role, None, f"{Path(log.label).name} ({len(items) + 1})"))
    if case:
        return replace(case, logs=tuple(items))
    name = Path(items[0].log.label).name if items else "logs"
    return Case(name, {}, tuple(items), period or (items[0].log.dt if items else PERIOD), tuple(notes))


def write_case(case: Case, folder: str | Path, notes: Mapping[str, Sequence[str]] | None = None) -> None:
    """Write logs and case.yaml; `read_case` gives the same case back. A new folder appears whole or not at all.

    notes: what was done to the signals of a log before, by its file.

    Examples:
        >>> import exodrake as exo
        >>> log = exo.simulate(exo.load_robot(), "caging")
        >>> write_case(Case("mine", {}, (CaseLog(log, "caging", "fit", None, "a.csv"),)), "mine")
        >>> exo.read_case("mine").name
        'mine'
    """
    contents, logs = dict[str, bytes](), []
    for item in argument("case", case, Case).logs:
        check_inside(folder, item.file, case.name)
        contents[item.file] = log_bytes(item.log, Path(folder) / item.file)
        log = {"file": item.file, "role": item.role, "protocol": item.protocol, "repeats": item.repeats}
        log |= {"date": None if item.date is None else written_date(item.date)}
        logs.append({key: value for key, value in log.items() if value is not None})
    head = {"name": case.name} | ({"serial": case.serial} if case.serial else {})
    head |= {"robot": plain(case.robot), "period": float(case.period)}
    head |= {"noise": plain(case.noise)} if case.noise else {}
    text = schema.dump_yaml(head | {"logs": logs})
    contents |= {notes_name(file): "\n".join((*lines, "")).encode() for file, lines in (notes or {}).items() if lines}
    write_folder(folder, contents | {FILE: text.encode()})


def check_inside(folder: str | Path, file: str, where: str) -> None:
    """InputError, saying where the name stands, if a log's name or link leads out of the folder of its case."""
    try:
        inside = (Path(folder) / file).resolve().is_relative_to(Path(folder).resolve())
    except (OSError, ValueError, RuntimeError):  # a name too long, a null byte, a ring of links
        inside = False
    if not inside:
        raise schema.refusal(f"{where}: log {schema.quote(file)}", "lies outside the folder; --allow-outside reads it")


def relative_name(file: str, place: Path) -> str:
    """A log's name seen from the folder of its case, since answers hold it: no absolute path."""
    return os.path.relpath(file, place) if os.path.isabs(file) else file


def notes_name(file: str | Path) -> str:
    """Name of the file of notes of a log, a line each."""
    return stem(file) + NOTES
