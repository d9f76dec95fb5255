"""What the importers share: logs of joints from arrays, and logs cut into what is fitted and what is held out."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.data.case import CaseLog
from exodrake.data.formats.npz import read_arrays
from exodrake.data.log import Log


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


def find_file(path: Path, name: str) -> Path:
    """The file itself, or the one of that name in a folder. InputError if there is none."""
    found = path / name if path.is_dir() else path
    if not found.is_file():
        raise InputError(f"{found}: no such file")
    return found


def read_text(path: Path) -> str:
    """Content of a text file. InputError for one that is none."""
    try:
        return read_bytes(path).decode()
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file") from None


def read_table(path: Path) -> np.ndarray:
    """A table of a NumPy file, or of text with commas. InputError for one that does not parse."""
    data = read_bytes(path)
    if path.suffix == ".npy":
        found = next(iter(read_arrays(data, str(path)).values()), np.zeros(0))
    else:
        try:
            found = np.array([line.split(",") for line in data.decode().splitlines() if line.strip()], float)
        except ValueError as error:
            raise InputError(f"{path}: not a table of numbers ({error})") from None
    if found.ndim != 2 or found.dtype.kind not in "fiu":
        raise InputError(f"{path}: {found.dtype} of shape {found.shape}, wanted a table of numbers")
    return found
