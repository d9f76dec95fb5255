"""Readers of the four sets of recordings: EMPS, tendon sheath, SO-101 arm and wrist of a da Vinci instrument.

python -m studies.real_machines.recordings DIR/emps emps --out my_case
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import click
import numpy as np

from exodrake.cli.main import OneLineErrors
from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.data.case import Case, CaseLog, write_case
from exodrake.data.formats.csv import TextLayout, read_text
from exodrake.data.formats.npz import read_arrays
from exodrake.data.log import Log
from exodrake.data.tables import list_columns

# s, of the frames of each set
EMPS_FRAME, SHEATH_FRAME, SO101_FRAME, WRIST_FRAME = 1e-3, 0.025, 0.02, 1.0


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


EMPS_CYCLE = 6240  # rows
EMPS_NAMES = ("t", "qg", "qm", "vir", "gtau")


def read_emps(path: Path) -> Case:
    """EMPS, `DATA_EMPS.mat`: Janot, Gautier, Brunot, "Data set and reference models of EMPS", 2019.

    From nonlinearbenchmark.org; no licence is stated; a public benchmark that is to be cited. Columns: t s, qg
    reference m, qm position m, vir controller output V, and the scalar gtau N/V. The motion repeats every 6.24 s: the
    first two cycles are fitted, the rest is held out and repeats them.

    Returns the case of the MAT file or of its folder. InputError for variables that are missing or too short.
    """
    file = find_files(path, "DATA_EMPS.mat")[0]
    columns = list_columns(read_bytes(file), str(file))
    for name in EMPS_NAMES:
        if name not in columns:
            raise InputError(f"{file}: no variable {name!r}, wanted {', '.join(EMPS_NAMES)}")
    t, reference, place, volts, gain = (columns[name] for name in EMPS_NAMES)
    if len({len(t), len(reference), len(place), len(volts)}) > 1 or len(t) < 3:
        raise InputError(f"{file}: t, qg, qm and vir differ in length, or are too short")
    start = {"position_start_carriage": np.full(len(place), place[0]), "speed_start_carriage": np.zeros(len(place))}
    signals = {"position_ref_carriage": reference, **start, "position_carriage": place}
    signals["force_carriage"] = gain[0] * volts
    kinds = {"force": "N", "speed": "m/s", "position": "m"}
    units = {name: kinds[name.split("_")[0]] for name in signals}
    log = Log(EMPS_FRAME * np.arange(len(t)), signals, units, str(file))
    two = 2 * EMPS_CYCLE
    repeats = len(log) > 3 * EMPS_CYCLE and np.allclose(reference[two:], reference[: len(log) - two], atol=1e-9)
    middle = two if repeats else len(log) // 2
    parts = []
    for part in (slice(0, middle), slice(middle, None)):  # each starts at the speed of its first rows
        own = restart_log(log.rows(part))
        speed = float(own["position_carriage"][2] - own["position_carriage"][0]) / (2.0 * EMPS_FRAME)
        parts.append(own.with_signals({"speed_start_carriage": np.full(len(own), speed)}))
    fitted = CaseLog(parts[0], "first", "fit", None, "first.csv.gz")
    held_out = CaseLog(parts[1], "second", "holdout", fitted.file if repeats else None, "second.csv.gz")
    return Case("emps", {}, (fitted, held_out), EMPS_FRAME)


TIME, COMMAND, ANGLE, COLUMNS = 0, 1, 3, 8


def read_sheath(path: Path) -> Case:
    """Bending joint of a flexible endoscope, `0.txt` ... `180.txt`: Nho et al., IEEE RA-L 2021. No licence is stated.

    The file's name is the total bend of the sheath [deg]. Columns: trajectory time s (rows that repeat it are dropped),
    commanded angle deg, velocity, measured angle deg (magnetic tracker), tensions and motor currents (not used). A
    folder's configurations are fitted but the middle one, which is held out; one file alone is halved.

    Returns the case of one configuration's file, or of a folder of them. InputError for a name that is no bend.
    """
    logs = [(f"bend_{f.stem}", read_configuration(f)) for f in sorted(find_files(path, "*.txt"), key=read_bend)]
    if len(logs) < 3:
        items = [item for name, log in logs for item in halve_log(log, name)]
    else:
        held = logs[len(logs) // 2][0]
        items = [CaseLog(log, n, "holdout" if n == held else "fit", None, f"{n}.csv.gz") for n, log in logs]
    return Case("tendon_sheath", {}, tuple(items), SHEATH_FRAME)


def read_bend(file: Path) -> float:
    """Total bend [rad] that a file's name says [deg]."""
    try:
        return float(np.radians(float(file.stem)))
    except ValueError:
        raise InputError(f"{file}: the name is no bend in degrees, such as 60.txt") from None


def read_configuration(file: Path) -> Log:
    """The log of one configuration, a row for each time of the trajectory."""
    columns = read_text(read_bytes(file), str(file), TextLayout(heading=False))
    if len(columns) != COLUMNS:
        raise InputError(f"{file}: {len(columns)} columns, wanted {COLUMNS}")
    rows = np.column_stack([*columns.values()])
    rows = rows[np.concatenate([[True], np.diff(rows[:, TIME]) > 0])]
    command, angle = np.radians(rows[:, [COMMAND]]), np.radians(rows[:, [ANGLE]])
    log = joint_log(("bending",), command, angle, SHEATH_FRAME, str(file))
    return log.with_signals({"bend_bending": np.full(len(log), read_bend(file))})


CONTROL, STATE, LIST = "control.csv", "state_motor.csv", "joint_list.txt"


def read_so101(path: Path) -> Case:
    """SO-101 arm, folders with `control.csv` and `state_motor.csv`: isaac-sim2real/sage, Apache-2.0.

    Positions commanded and measured [rad], joints as in `joint_list.txt`, time stamps in us. Rows of both files belong
    together by number: the recorder's clock ticks every 20.06 ms on average, which counts as the frame of 20 ms. Each
    run's first half is fitted.

    Returns the case of one run's folder, or of a folder of runs. InputError names file and row.
    """
    runs = [file.parent for file in find_files(path, CONTROL, f"*/{CONTROL}")]
    items = [item for run in runs for item in halve_log(read_so101_run(run), run.name)]
    return Case("so101", {}, tuple(items), SO101_FRAME)


def read_so101_run(run: Path) -> Log:
    """The log of one run."""
    joints = read_bytes(run / LIST).decode(errors="replace").replace("_", "").split()
    command, angle = (read_positions(run / name, len(joints)) for name in (CONTROL, STATE))
    rows = min(len(command), len(angle))
    return joint_log(joints, command[:rows], angle[:rows], SO101_FRAME, str(run))


def read_positions(file: Path, joints: int) -> np.ndarray:
    """The lists in column `positions` (n, joints)."""
    found = read_text(read_bytes(file), str(file), wanted=[f"positions[{k}]" for k in range(joints)])
    return np.column_stack([*found.values()])


WRIST = slice(3, 6)
WANTED, SEEN = "_q_des_raw.npy", "_q_act_raw.npy"


def read_wrist(path: Path) -> Case:
    """Wrist of a da Vinci instrument, `exp*_q_des_raw.npy` and `exp*_q_act_raw.npy`: Hwang et al., IEEE RA-L 2020.

    No licence is stated. Six joints commanded and measured by a camera; q4, q5, q6 [rad] are the wrist. Quasi-static: a
    row about every second, read at rest, so that rows stand for frames of 1 s. Rows in which the camera saw nothing
    (q_act = 0) are dropped. Each run's first half is fitted.

    Returns the case of all runs in a folder, or of the one whose file is named.
    """
    runs = [(f.parent, f.name.split("_q_")[0]) for f in find_files(path, f"*{WANTED}")]
    items = [item for folder, run in runs for item in halve_log(read_wrist_run(folder, run), run)]
    return Case("dvrk_wrist", {}, tuple(items), WRIST_FRAME)


def read_wrist_run(folder: Path, run: str) -> Log:
    """The log of one run."""
    files = [folder / (run + ending) for ending in (WANTED, SEEN)]
    wanted, seen = (read_arrays(read_bytes(file), str(file)).get("", np.zeros(0)) for file in files)
    numbers = all(table.dtype.kind in "fiu" for table in (wanted, seen))
    if wanted.shape != seen.shape or seen.ndim != 2 or seen.shape[1] < WRIST.stop or not numbers:
        raise InputError(f"{folder / run}: shapes {wanted.shape} and {seen.shape}, wanted the same (n, 6) of numbers")
    known = ~np.all(seen == 0.0, axis=1)
    if not known.any():
        raise InputError(f"{folder / run}: the camera saw nothing in any row")
    return joint_log(("q4", "q5", "q6"), wanted[known, WRIST], seen[known, WRIST], WRIST_FRAME, str(folder / run))


READERS: dict[str, Callable[[Path], Case]] = {
    "emps": read_emps, "tendon_sheath": read_sheath, "so101": read_so101, "dvrk_wrist": read_wrist,
}  # fmt: skip


@click.command(cls=OneLineErrors)
@click.argument("recording", type=click.Path(path_type=Path))
@click.argument("machine", type=click.Choice(tuple(READERS)))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder of the case.")
def main(recording: Path, machine: str, out: Path) -> None:
    """Turn RECORDING, a file or folder of the set of MACHINE, into a case."""
    case = READERS[machine](recording)
    write_case(case, out)
    click.echo(f"{out}: {len(case.logs)} logs; exodrake diagnose {out} --robot {machine}")


if __name__ == "__main__":
    main()
