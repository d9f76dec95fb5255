"""A case: a folder of logs from one robot in one state, and what is known about it.

`case.yaml` in the folder:

    name: wearer 3, Tuesday              # default: the folder's name
    serial: exo-07                       # which robot of a fleet, if it matters
    date: 2026-03-03                     # of all logs that have none; ISO 8601, with a time if need be
    robot: {tendon: {stiffness: 2500}}   # overrides of the nominal parameters, if any
    period: 0.02                         # s, the frame; default 0.02
    logs:
      - {file: sweeps_1.csv.gz, role: fit}
      - {file: sweeps_2.csv.gz, role: fit, repeats: sweeps_1.csv.gz}     # same reference again: gives the noise
      - {file: grasps.csv.gz, role: holdout, protocol: grasps}           # default protocol: the file's name
      - {file: experiment.csv, role: fit}    # protocol `experiment`, of `exodrake experiment`: used in full length
      - {file: later.csv.gz, date: 2026-03-05}                           # a later session of the same robot

Without it, every log in the folder counts: all to fit but the last by name, which is held out. No other file is read.
Logs that exodrake simulated are left out beside measured ones (`data.simulated`).
"""

from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.short_repr import short_repr
from exodrake.data.log import Log

ROLES = ("fit", "holdout")
PERIOD = 0.02  # s, frame of the nominal robot
FILE = "case.yaml"
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

    Raises:
        InputError: for an unknown role, a doubled file, repeats of a log that is not there, and nothing to fit.
    """

    name: str
    robot: dict[str, Any]
    logs: tuple[CaseLog, ...]
    period: float = PERIOD
    notes: tuple[str, ...] = field(default=())
    hashes: dict[str, str] = field(default_factory=dict)
    serial: str = ""

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
        """Groups of two or more fitted logs that run the same reference in one session, in order.

        Between sessions the robot may change, so these do not show the noise. Neither do held-out logs, which decide
        nothing but the closure.
        """
        heads = {item.file: item.repeats for item in self.logs}
        groups: dict[tuple[str, datetime | None], list[CaseLog]] = {}
        for item in self.fit_logs:
            groups.setdefault((_head(item.file, heads), item.date), []).append(item)
        return tuple(tuple(group) for group in groups.values() if len(group) > 1)

    def is_copy(self, item: CaseLog) -> bool:
        """Whether a log repeats another one of its session, and so serves the noise alone."""
        group = next((group for group in self.repeat_groups if item in group), (item,))
        return item is not next((one for one in group if one.repeats is None), group[0])


def date_of(written: str) -> datetime | None:
    """The moment that a date or time by ISO 8601 names, UTC where it names no zone; None of anything else."""
    try:
        found = datetime.fromisoformat(written)
    except ValueError:
        return None
    return found if found.tzinfo else found.replace(tzinfo=UTC)


def _head(file: str, heads: dict[str, str | None]) -> str:
    """The first log of the chain of repeats; a ring of repeats ends at its first name in the alphabet."""
    seen = [file]
    while (before := heads.get(seen[-1])) is not None:
        if before in seen:
            return min(seen[seen.index(before) :])
        seen.append(before)
    return seen[-1]
