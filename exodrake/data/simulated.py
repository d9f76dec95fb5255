"""The mark of logs that exodrake simulated: a field in memory, the column `simulated [-]` in a file of any format.

    1   MODEL: of a robot as its file states it, nominal or improved
    2   CHANGED: of a robot with effects, parameters or parts changed for the run, which may stand for a real one

A folder without case.yaml takes no simulated log beside measured ones, and none of a MODEL at all. A log that is named,
as a file or in case.yaml, is taken, with a note; measured and simulated logs in one case.yaml are refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.log import Log

COLUMN = "simulated"
MODEL, CHANGED = 1, 2


def with_mark(log: Log) -> Log:
    """The log as a file holds it: of a simulated one, the mark as its last column."""
    return log.with_signals({COLUMN: np.full(len(log), float(log.simulated))}, {COLUMN: "-"}) if log.simulated else log


def without_mark(log: Log) -> Log:
    """The log of a file, the mark as its field; a column of this name that holds anything else stays a column."""
    values = log.signals.get(COLUMN)
    if values is None or not len(values) or values[0] not in (MODEL, CHANGED) or np.any(values != values[0]):
        return log
    return replace(log.only([name for name in log.columns if name != COLUMN]), simulated=int(values[0]))


def robot_logs(logs: Mapping[str, Log], folder: str) -> tuple[list[str], list[str]]:
    """Logs of a folder that may be the robot's, by name, and a note on those left out; InputError if there are none."""
    highest = max(log.simulated for log in logs.values())
    wanted = highest if all(log.simulated for log in logs.values()) else 0
    if wanted == MODEL:
        raise InputError(
            f"{folder}: exodrake simulated all its logs with a robot as its file states it: they are the model, not the"
            " robot; name a log itself to read it anyway"
        )
    left_out = [name for name, log in logs.items() if log.simulated != wanted]
    notes = [f"{', '.join(left_out)}: left out, simulated by exodrake and not a log of the robot"] if left_out else []
    return [name for name in logs if name not in left_out], notes


def simulated_notes(logs: Mapping[str, Log], folder: str) -> list[str]:
    """A note on simulated logs of a case; InputError naming one that stands beside a measured one."""
    marked: Sequence[str] = [name for name, log in logs.items() if log.simulated]
    if marked and len(marked) < len(logs):
        measured = next(name for name in logs if name not in marked)
        raise InputError(f"{folder}: log {marked[0]!r} is simulated by exodrake, {measured!r} is not: not one robot")
    return [f"{', '.join(marked)}: simulated by exodrake, not measured"] if marked else []
