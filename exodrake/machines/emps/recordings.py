"""EMPS, `DATA_EMPS.mat`: Janot, Gautier, Brunot, "Data set and reference models of EMPS", 2019.

From nonlinearbenchmark.org; no licence is stated; a public benchmark that is to be cited. Columns: t s, qg reference m,
qm position m, vir controller output V, and the scalar gtau N/V. The motion repeats every 6.24 s: the first two cycles
are fitted, the rest is held out and repeats them.
"""

from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.data.case import Case, CaseLog
from exodrake.data.log import Log
from exodrake.data.tables import list_columns
from exodrake.machines.library import find_files, restart_log

FRAME, CYCLE = 1e-3, 6240  # s, rows
NAMES = ("t", "qg", "qm", "vir", "gtau")


def case(path: Path) -> Case:
    """The case of the MAT file or of its folder. InputError for variables that are missing or too short."""
    file = find_files(path, "DATA_EMPS.mat")[0]
    columns = list_columns(read_bytes(file), str(file))
    for name in NAMES:
        if name not in columns:
            raise InputError(f"{file}: no variable {name!r}, wanted {', '.join(NAMES)}")
    t, reference, place, volts, gain = (columns[name] for name in NAMES)
    if len({len(t), len(reference), len(place), len(volts)}) > 1 or len(t) < 3:
        raise InputError(f"{file}: t, qg, qm and vir differ in length, or are too short")
    start = {"position_start_carriage": np.full(len(place), place[0]), "speed_start_carriage": np.zeros(len(place))}
    signals = {"position_ref_carriage": reference, **start, "position_carriage": place}
    signals["force_carriage"] = gain[0] * volts
    kinds = {"force": "N", "speed": "m/s", "position": "m"}
    units = {name: kinds[name.split("_")[0]] for name in signals}
    log = Log(FRAME * np.arange(len(t)), signals, units, str(file))
    repeats = len(log) > 3 * CYCLE and np.allclose(reference[2 * CYCLE :], reference[: len(log) - 2 * CYCLE], atol=1e-9)
    middle = 2 * CYCLE if repeats else len(log) // 2
    parts = []
    for part in (slice(0, middle), slice(middle, None)):  # each starts at the speed of its first rows
        own = restart_log(log.rows(part))
        speed = float(own["position_carriage"][2] - own["position_carriage"][0]) / (2.0 * FRAME)
        parts.append(own.with_signals({"speed_start_carriage": np.full(len(own), speed)}))
    fitted = CaseLog(parts[0], "first", "fit", None, "first.csv.gz")
    held_out = CaseLog(parts[1], "second", "holdout", fitted.file if repeats else None, "second.csv.gz")
    return Case("emps", {}, (fitted, held_out), FRAME)
