"""Simulation of a machine's drives alone, frame by frame on measured commands and loads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.schedule import outer_reads
from exodrake.core.machine import Machine
from exodrake.core.segment import CommandLink


class Drive:
    """The drives of a machine without its other parts, advanced frame by frame between readings of their positions.

    Attributes:
        state: (states,) at rest.
        channel: (states,) the channel that each state belongs to.
    """

    def __init__(self, machine: Machine, values: np.ndarray, link: CommandLink) -> None:
        part = next(b for b in machine.parts if b.name == link.part)
        self.compiled, self.slots, self.dt = compile_machine(machine).moves, machine.slots, machine.slot
        self.p = values[[i for i, info in enumerate(machine.parameters) if info.part == part.name]]
        self.state = np.zeros(sum(machine.part_size(part)))
        states = (*part.states, *(s for e in machine.effects_on(part) for s in e.states))
        self.channel = np.concatenate([np.repeat(np.arange(machine.width(s.axis)), s.width) for s in states])
        (task,) = (t for t in part.tasks if not t.slots)
        self.loads = [name for name in outer_reads(part, task.reads) if name != link.received]
        self.switch = write_slot(machine, link.received) - write_slot(machine, machine.column(link.output).signal)

    def moves(
        self, states: np.ndarray, before: np.ndarray, after: np.ndarray, loads: Mapping[str, np.ndarray]
    ) -> np.ndarray:
        """Advances states (n, states) in place by one frame, in which the commands (n, channels) change.

        Returns:
            (n, channels) by how much the positions moved.
        """
        moved, given = np.empty(before.shape), (loads[name] for name in self.loads)
        self.compiled(states, self.p, self.dt, self.slots, self.switch, before, after, *given, moved)
        return moved


def write_slot(machine: Machine, signal: str) -> int:
    """First slot in which the part that writes a signal runs."""
    part = next(b for b in machine.parts if any(signal in o.writes for o in b.outputs))
    return min(slot for task in part.tasks for slot in task.slots)


def load_kinds(machine: Machine, link: CommandLink) -> dict[str, str]:
    """Signals that the drive reads besides its command, and the column kinds that measure them."""
    part = next(b for b in machine.parts if b.name == link.part)
    read = {name for t in part.tasks if not t.slots for name in outer_reads(part, t.reads)} - {link.received}
    imposed = {i.signal: s.output for s in machine.segments for i in s.imposed if not i.part}
    return {name: imposed[name] for name in sorted(read)}


@dataclass(frozen=True, eq=False)
class Record:
    """Measured command, position and loads by signal, each (n, channels) [SI] without gaps."""

    command: np.ndarray
    position: np.ndarray
    loads: Mapping[str, np.ndarray]

    def loads_at(self, frame: int) -> dict[str, np.ndarray]:
        """Loads (channels,) by signal in a frame."""
        return {name: rows[frame] for name, rows in self.loads.items()}
