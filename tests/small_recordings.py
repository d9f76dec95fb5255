"""Small recordings in the form of the four sets of real machines."""

from pathlib import Path

import numpy as np
from scipy.io import savemat

SETS = ("emps", "tendon_sheath", "so101", "dvrk_wrist")


def made(name: str, folder: Path) -> Path:
    """A small set in the form of the real one."""
    n = np.arange(40)
    if name == "emps":
        columns = {"t": 1e-3 * n, "qg": 1e-4 * n, "qm": 1e-4 * n - 1e-6, "vir": 0.1 * n}
        savemat(folder / "DATA_EMPS.mat", {k: v[:, None] for k, v in columns.items()} | {"gtau": 35.0})
    elif name == "tendon_sheath":
        for bend in (0, 60, 120):
            rows = np.column_stack([0.025 * (n // 4), 1.0 * n, n, 0.5 * n + bend, n, n, n, n])
            np.savetxt(folder / f"{bend}.txt", rows, delimiter=", ")
    elif name == "so101":
        (folder / "run").mkdir()
        (folder / "run" / "joint_list.txt").write_text("Rotation\nPitch\nElbow\nWrist_Pitch\nWrist_Roll\nJaw\n")
        lists = [f'{20059.7 * k},"{[float(0.1 * k + j) for j in range(6)]}"' for k in n]
        (folder / "run" / "control.csv").write_text("\n".join(["timestamp,positions", *lists]))
        (folder / "run" / "state_motor.csv").write_text("\n".join(["timestamp,positions", *lists]))
    else:
        act = np.ones((40, 6)) + 0.01 * n[:, None]
        act[7] = 0.0
        np.save(folder / "exp3_q_act_raw.npy", act)
        np.save(folder / "exp3_q_des_raw.npy", np.tile(n[:, None], (1, 6)))
    return folder
