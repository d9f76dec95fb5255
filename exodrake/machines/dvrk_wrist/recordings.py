"""Wrist of a da Vinci instrument, `exp*_q_des_raw.npy` and `exp*_q_act_raw.npy`: Hwang et al., IEEE RA-L 2020.

No licence is stated. Six joints commanded and measured by a camera; q4, q5, q6 [rad] are the wrist. Quasi-static: a
row about every second, read at rest, so that rows stand for frames of 1 s. Rows in which the camera saw nothing
(q_act = 0) are dropped. Each run's first half is fitted.
"""

from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.data.case import Case
from exodrake.data.formats.npz import read_arrays
from exodrake.data.log import Log
from exodrake.machines.library import find_files, halve_log, joint_log

FRAME = 1.0  # s
WRIST = slice(3, 6)
WANTED, SEEN = "_q_des_raw.npy", "_q_act_raw.npy"


def case(path: Path) -> Case:
    """The case of all runs in a folder, or of the one whose file is named."""
    runs = [(f.parent, f.name.split("_q_")[0]) for f in find_files(path, f"*{WANTED}")]
    items = [item for folder, run in runs for item in halve_log(read(folder, run), run)]
    return Case("dvrk_wrist", {}, tuple(items), FRAME)


def read(folder: Path, run: str) -> Log:
    """One run."""
    files = [folder / (run + ending) for ending in (WANTED, SEEN)]
    wanted, seen = (read_arrays(read_bytes(file), str(file)).get("", np.zeros(0)) for file in files)
    numbers = all(table.dtype.kind in "fiu" for table in (wanted, seen))
    if wanted.shape != seen.shape or seen.ndim != 2 or seen.shape[1] < WRIST.stop or not numbers:
        raise InputError(f"{folder / run}: shapes {wanted.shape} and {seen.shape}, wanted the same (n, 6) of numbers")
    known = ~np.all(seen == 0.0, axis=1)
    if not known.any():
        raise InputError(f"{folder / run}: the camera saw nothing in any row")
    return joint_log(("q4", "q5", "q6"), wanted[known, WRIST], seen[known, WRIST], FRAME, str(folder / run))
