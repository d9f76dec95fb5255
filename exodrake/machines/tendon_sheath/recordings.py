"""Bending joint of a flexible endoscope, `0.txt` ... `180.txt`: Nho et al., IEEE RA-L 2021. No licence is stated.

The file's name is the total bend of the sheath [deg]. Columns: trajectory time s (rows that repeat it are dropped),
commanded angle deg, velocity, measured angle deg (magnetic tracker), tensions and motor currents (not used). A folder's
configurations are fitted but the middle one, which is held out; one file alone is halved.
"""

from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.data.case import Case, CaseLog
from exodrake.data.log import Log
from exodrake.data.text import TextLayout, read_text
from exodrake.machines.library import find_files, halve_log, joint_log

FRAME = 0.025  # s
TIME, COMMAND, ANGLE, COLUMNS = 0, 1, 3, 8


def case(path: Path) -> Case:
    """The case of one configuration's file, or of a folder of them. InputError for a name that is no bend."""
    logs = [(f"bend_{f.stem}", read(f)) for f in sorted(find_files(path, "*.txt"), key=read_bend)]
    if len(logs) < 3:
        items = [item for name, log in logs for item in halve_log(log, name)]
    else:
        held = logs[len(logs) // 2][0]
        items = [CaseLog(log, n, "holdout" if n == held else "fit", None, f"{n}.csv.gz") for n, log in logs]
    return Case("tendon_sheath", {}, tuple(items), FRAME)


def read_bend(file: Path) -> float:
    """Total bend [rad] that a file's name says [deg]."""
    try:
        return float(np.radians(float(file.stem)))
    except ValueError:
        raise InputError(f"{file}: the name is no bend in degrees, such as 60.txt") from None


def read(file: Path) -> Log:
    """One configuration, a row for each time of the trajectory."""
    columns = read_text(read_bytes(file), str(file), TextLayout(heading=False))
    if len(columns) != COLUMNS:
        raise InputError(f"{file}: {len(columns)} columns, wanted {COLUMNS}")
    rows = np.column_stack([*columns.values()])
    rows = rows[np.concatenate([[True], np.diff(rows[:, TIME]) > 0])]
    command, angle = np.radians(rows[:, [COMMAND]]), np.radians(rows[:, [ANGLE]])
    log = joint_log(("bending",), command, angle, FRAME, str(file))
    return log.with_signals({"bend_bending": np.full(len(log), read_bend(file))})
