"""Requirements on a case for its diagnosis with a machine: channels, frame, length of logs, references of repeats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.data.case import Case
from exodrake.data.log import Log

SHORTEST = 100  # frames; at the Exo-Index's 20 ms that is 2 s, longer than the loop's memory
LONGEST = 90_000  # frames of all logs together, half an hour at 20 ms: beyond, a search takes hours and gigabytes
SAME = 1e-9  # s, two frame periods closer than this are one
REPEATS = 0.01  # of the motion, and of the rows, by which references of repeats may differ (assumed: rounding, jitter)


def check_case(case: Case, machine: Machine) -> None:
    """Refuses another frame or other channels than the machine's, logs too short or long, and false repeats.

    Raises:
        InputError: naming the log.
    """
    if abs(case.period - machine.frame) > SAME:
        raise InputError(f"{case.name}: frames of {case.period:g} s, {machine.name} has frames of {machine.frame:g} s")
    for item in case.logs:
        check_channels(item.log, item.file, machine)
    frames = sum(len(item.log) for item in case.logs)
    if frames > LONGEST:
        raise InputError(
            f"{case.name}: {frames} frames of logs, a diagnosis takes {LONGEST}; a few logs of a minute say as much"
        )
    check_repeats(case, machine)


def without_short_logs(case: Case, machine: Machine) -> Case:
    """The case without logs that are too short to tell anything, with a note; InputError if no fitted log is left."""
    short = [item for item in case.logs if len(item.log) < SHORTEST]
    if not short:
        return case
    least = f"{SHORTEST} ({SHORTEST * machine.frame:g} s)"
    gone = {item.file for item in short}
    kept = tuple(item for item in case.logs if item.file not in gone and item.repeats not in gone)
    if not any(item.role == "fit" for item in kept):
        item = short[0]
        raise InputError(f"{item.file}: {len(item.log)} frames, a diagnosis needs {least}")
    listed = ", ".join(sorted(gone))
    return replace(case, logs=kept, notes=(*case.notes, f"left out, since a diagnosis needs {least} frames: {listed}"))


def check_channels(log: Log, file: str, machine: Machine) -> None:
    """InputError naming a required column of one of the machine's wires or joints that the log lacks."""
    for column in machine.columns:
        channels = machine.channels(column.signal)
        for channel in channels if column.required else ():
            name = f"{column.kind}_{channel}"
            if name not in log.signals:
                raise InputError(
                    f"{file}: required column {name!r} is missing ({machine.name} has {', '.join(channels)})"
                )


def check_repeats(case: Case, machine: Machine) -> None:
    """InputError naming file, column and row where a log has another reference than the log that it is said to repeat.

    References that are constant in every log, such as initial states, may differ.
    """
    logs = {item.file: item.log for item in case.logs}
    repeats = [(item, logs[item.repeats]) for item in case.logs if item.repeats]
    for reference in machine.references:
        channels = machine.channels(reference.signal)
        for item, repeated in repeats:
            own, other = (log.array(reference.kind, channels) for log in (item.log, repeated))
            rows = min(len(own), len(other))
            motion = max(np.nanstd(own, axis=0).max(), np.nanstd(other, axis=0).max())
            apart = np.abs(own[:rows] - other[:rows]) > REPEATS * motion
            if motion > 0.0 and apart.any(axis=1).mean() > REPEATS:
                row, channel = np.argwhere(apart)[0]
                raise InputError(
                    f"{item.file}: column '{reference.kind}_{channels[channel]}', row {row + 2}: another reference "
                    f"than in {item.repeats}, which it is said to repeat"
                )
