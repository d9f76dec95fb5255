"""SO-101 arm, folders with `control.csv` and `state_motor.csv`: isaac-sim2real/sage, Apache-2.0.

Positions commanded and measured [rad], joints as in `joint_list.txt`, time stamps in us. Rows of both files belong
together by number: the recorder's clock ticks every 20.06 ms on average, which counts as the frame of 20 ms. Each
run's first half is fitted.
"""

from pathlib import Path

import numpy as np

from exodrake.core.files import read_bytes
from exodrake.data.case import Case
from exodrake.data.log import Log
from exodrake.data.text import read_text
from exodrake.machines.library import find_files, halve_log, joint_log

FRAME = 0.02  # s
CONTROL, STATE, LIST = "control.csv", "state_motor.csv", "joint_list.txt"


def case(path: Path) -> Case:
    """The case of one run's folder, or of a folder of runs. InputError names file and row."""
    runs = [file.parent for file in find_files(path, CONTROL, f"*/{CONTROL}")]
    items = [item for run in runs for item in halve_log(read(run), run.name)]
    return Case("so101", {}, tuple(items), FRAME)


def read(run: Path) -> Log:
    """One run."""
    joints = read_bytes(run / LIST).decode(errors="replace").replace("_", "").split()
    wanted = [f"positions[{k}]" for k in range(len(joints))]  # a column holds lists
    tables = (read_text(read_bytes(run / name), str(run / name), wanted=wanted) for name in (CONTROL, STATE))
    command, angle = (np.column_stack([*table.values()]) for table in tables)
    rows = min(len(command), len(angle))
    return joint_log(joints, command[:rows], angle[:rows], FRAME, str(run))
