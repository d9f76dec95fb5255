"""SO-101 arm, folders with `control.csv` and `state_motor.csv`: isaac-sim2real/sage, Apache-2.0.

Positions commanded and measured [rad], joints as in `joint_list.txt`, time stamps in us. Rows of both files belong
together by number: the recorder's clock ticks every 20.06 ms on average, which counts as the frame of 20 ms. Each
run's first half is fitted.
"""

import csv
import json
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.case import Case
from exodrake.data.log import Log
from exodrake.machines.recording_tools import find_file, halve_log, joint_log, read_text

FRAME = 0.02  # s
CONTROL, STATE, LIST = "control.csv", "state_motor.csv", "joint_list.txt"


def case(path: Path) -> Case:
    """The case of one run's folder, or of a folder of runs. InputError names file and row."""
    runs = [path] if (path / CONTROL).is_file() else sorted(p.parent for p in path.glob(f"*/{CONTROL}"))
    if not runs:
        raise InputError(f"{path}: no {CONTROL}, here or one folder below")
    items = [item for run in runs for item in halve_log(read(run), run.name)]
    return Case("so101", {}, tuple(items), FRAME)


def read(run: Path) -> Log:
    """One run."""
    joints = [name.replace("_", "") for name in read_text(find_file(run, LIST)).split()]
    command, angle = (positions(find_file(run, name), len(joints)) for name in (CONTROL, STATE))
    rows = min(len(command), len(angle))
    return joint_log(joints, command[:rows], angle[:rows], FRAME, str(run))


def positions(file: Path, joints: int) -> np.ndarray:
    """The lists in column `positions` (n, joints)."""
    found = []
    for number, row in enumerate(csv.DictReader(read_text(file).splitlines())):
        try:
            values = [float(v) for v in json.loads(row["positions"])]
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError):
            raise InputError(f"{file}: column 'positions', row {number + 1}: no list of numbers") from None
        if len(values) != joints:
            raise InputError(f"{file}: column 'positions', row {number + 1}: {len(values)} numbers, wanted {joints}")
        found.append(values)
    if not found:
        raise InputError(f"{file}: no rows")
    return np.array(found)
