"""What a case must be to be diagnosed with a machine: its channels, its frame, logs neither too short nor too long."""

from __future__ import annotations

from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.data.case import Case
from exodrake.data.log import Log

SHORTEST = 100  # frames; at the Exo-Index's 20 ms that is 2 s, longer than the loop's memory
LONGEST = 90_000  # frames of all logs together, half an hour at 20 ms: beyond, a search takes hours and gigabytes
SAME = 1e-9  # s, two frame periods closer than this are one


def check_case(case: Case, machine: Machine) -> None:
    """InputError, naming the log, for another frame or other channels than the machine's, and logs too short or
    long.
    """
    if abs(case.period - machine.frame) > SAME:
        raise InputError(f"{case.name}: frames of {case.period:g} s, {machine.name} has frames of {machine.frame:g} s")
    for item in case.logs:
        check_channels(item.log, item.file, machine)
        if len(item.log) < SHORTEST:
            raise InputError(
                f"{item.file}: {len(item.log)} frames, a diagnosis needs {SHORTEST} ({SHORTEST * machine.frame:g} s)"
            )
    frames = sum(len(item.log) for item in case.logs)
    if frames > LONGEST:
        raise InputError(
            f"{case.name}: {frames} frames of logs, a diagnosis takes {LONGEST}; a few logs of a minute say as much"
        )


def check_channels(log: Log, file: str, machine: Machine) -> None:
    """InputError naming a required column of one of the machine's wires or joints that the log lacks."""
    for column in machine.columns:
        channels = machine.axes.of(machine.signal[column.signal].axis)
        for channel in channels if column.required else ():
            name = f"{column.kind}_{channel}"
            if name not in log.signals:
                raise InputError(
                    f"{file}: required column {name!r} is missing ({machine.name} has {', '.join(channels)})"
                )
