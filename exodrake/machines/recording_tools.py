"""What the importers share: files of a set, logs of joints from arrays, and logs cut into fitted and held-out parts."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.case import CaseLog
from exodrake.data.log import Log


def find_files(path: Path, *patterns: str) -> list[Path]:
    """The file itself, or those of a folder by their patterns, in order. InputError if there are none."""
    found = [path] if path.is_file() else sorted(file for pattern in patterns for file in path.glob(pattern))
    if not found:
        raise InputError(f"{path}: no {patterns[0]}")
    return found


def joint_log(joints: Sequence[str], command: np.ndarray, angle: np.ndarray, frame: float, source: str) -> Log:
    """A log of joints from commands and angles (n, joints) [rad], a row a frame [s]; it starts at the first reading."""
    signals = {}
    for joint, wanted, found in zip(joints, command.T, angle.T, strict=True):
        start = np.full(len(found), found[0])
        signals |= {f"angle_ref_{joint}": wanted, f"angle_start_{joint}": start, f"angle_{joint}": found}
    return Log(frame * np.arange(len(angle)), signals, source=source)


def halve_log(log: Log, name: str) -> list[CaseLog]:
    """The first half to fit and the second held out, each from its own first reading on."""
    middle = len(log) // 2
    parts = (("first", "fit", slice(0, middle)), ("second", "holdout", slice(middle, None)))
    return [CaseLog(restart_log(log.rows(s)), name, role, None, f"{name}_{p}.csv.gz") for p, role, s in parts]


def restart_log(log: Log) -> Log:
    """A part of a log as one of its own: its clock from 0, and where it starts from its first readings."""
    starts = [column for column in log.columns if column.startswith(("angle_start_", "position_start_"))]
    anew = {column: np.full(len(log), log[column.replace("_start", "", 1)][0]) for column in starts}
    return Log(log.time - log.time[0], log.signals | anew, log.units, log.source)
