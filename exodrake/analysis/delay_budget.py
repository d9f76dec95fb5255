"""Delay budget of each channel: delays between a reading and its command, and the further delay that is allowed.

A task runs in the middle of its slot. One that comes before what it reads has the value of the frame before. A command
is held for a frame, which acts as a delay of half a frame.
"""

from __future__ import annotations

from dataclasses import dataclass

from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.margins import Margins
from exodrake.core.machine import Machine
from exodrake.core.part import Part


@dataclass(frozen=True)
class DelayBudget:
    """Delays of one channel [s].

    Attributes:
        channel: its name.
        slot: length of a slot.
        read_slot, control_slot, write_slot: in which the reading, the law and the command are executed.
        to_control: from reading to law.
        to_write: from law to the plant.
        hold: half a frame.
        margin: further delay at the limit of stability; nan if the loop is unstable, inf if there is none.
    """

    channel: str
    slot: float
    read_slot: int
    control_slot: int
    write_slot: int
    to_control: float
    to_write: float
    hold: float
    margin: float

    @property
    def total(self) -> float:
        """Delay that the schedule costs [s]."""
        return self.to_control + self.to_write + self.hold

    @property
    def spare_slots(self) -> float:
        """Number of slots by which the command may be late at the limit of stability."""
        return self.margin / self.slot


def slot_of(part: Part, channel: int, reads: str = "") -> int | None:
    """Slot in which a part handles a channel, in its task that reads a signal where one is named; None without one."""
    for task in part.tasks:
        if task.slots and (not reads or reads in task.reads):
            return task.slots[channel] if task.per_channel else task.slots[0]
    return None


def writer_of(machine: Machine, signal: str) -> Part:
    """The part that writes a signal."""
    return next(p for p in machine.parts if any(signal in output.writes for output in p.outputs))


def delay_budget(loop: FrameMap, margins: tuple[Margins, ...]) -> tuple[DelayBudget, ...]:
    """The delay budget of every channel."""
    machine, kinds = loop.robot.machine, loop.loop
    found = []
    for k, m in enumerate(margins):
        control = slot_of(writer_of(machine, kinds.command), k) or 0
        read = slot_of(writer_of(machine, kinds.measured), k)
        writes = [slot_of(part, k, kinds.command) for part in machine.parts if part.name != kinds.part]
        write = next((slot for slot in writes if slot is not None), control)  # a plant that reads the command at once
        read = control if read is None else read
        to_control, to_write = ((b - a) % machine.slots * machine.slot for a, b in ((read, control), (control, write)))
        found.append(
            DelayBudget(
                m.channel, machine.slot, read, control, write, to_control, to_write, 0.5 * machine.frame,
                m.delay_margin,
            )
        )  # fmt: skip
    return tuple(found)
