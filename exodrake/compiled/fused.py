"""Prints the parts in front of the bus as one leaf: fewer Python events, the same arithmetic in the same order.

The parts that tick with the plant, and those that share a slot with them, stand first in a machine's table, so their
numbers and states lie first in the flat vectors. The group is a machine of its own, given what it reads from outside.
"""

from __future__ import annotations

from dataclasses import replace

from exodrake.compiled.schedule import indent, outputs, task_lines, tick, views
from exodrake.core.machine import Machine
from exodrake.core.part import Part, Task

GROUP = "plant"


def plant_blocks(machine: Machine) -> tuple[Part, ...]:
    """The leading parts that tick with the plant or share a slot with one that does."""
    slots = {s for b in machine.parts if any(not t.slots for t in b.tasks) for t in b.tasks for s in t.slots}
    members = []
    for part in machine.parts:
        if not any(not t.slots or slots & set(t.slots) for t in part.tasks):
            break
        members.append(part)
    return tuple(members)


def plant_machine(machine: Machine) -> Machine | None:
    """The group as a machine; None where fusing would leave out a ticking part or hide direct feedthrough."""
    members = plant_blocks(machine)
    written = {w for b in members for o in b.outputs for w in o.writes}
    read = {w for b in members for t in b.tasks for w in t.reads} - written
    ticking = {b.name for b in machine.parts if any(not t.slots for t in b.tasks)}
    through = {w for b in members for o in b.outputs for w in o.reads} - written
    if through or not ticking or not ticking <= {b.name for b in members}:
        return None
    wires = tuple(w for w in machine.signals if w.name in written)
    given = tuple(w.name for w in machine.signals if w.name in read)
    acting = {effect.id for part in members for effect in machine.effects_on(part)}
    effects = tuple(effect for effect in machine.effects if effect.id in acting)
    return replace(
        machine, name=GROUP, signals=wires, parts=members, inputs=given, columns=(), variants={}, effects=effects
    )


def sampled(plant: Machine) -> dict[tuple[int, ...], list[Task]]:
    """Sampled tasks of the group by the slots that they share."""
    found: dict[tuple[int, ...], list[Task]] = {}
    for part in plant.parts:
        for task in part.tasks:
            if task.slots:
                found.setdefault(task.slots, []).append(task)
    return found


def outside(plant: Machine, tasks: list[Task]) -> tuple[str, ...]:
    """Wires that some tasks read from outside the group, in the table's order."""
    return tuple(w for w in plant.inputs if any(w in t.reads for t in tasks))


def plant_tasks(plant: Machine) -> list[Task]:
    """Tasks that run at the plant's tick."""
    return [t for b in plant.parts for t in b.tasks if not t.slots]


def slot_function(slots: tuple[int, ...]) -> str:
    """Name of the function that runs in some slots; without slots, at the plant's tick."""
    return "_".join(["slot", *(str(s) for s in slots)]) if slots else "tick"


def print_fused(machine: Machine) -> list[str]:
    """`plant__leaf__hold`, `__tick` and one function a set of slots, over (memory, p, ...): states, then wires."""
    plant = plant_machine(machine)
    if plant is None:
        return []
    lines = [function(plant, "hold", [], outputs(plant))]
    ticks = ["for _ in range(substeps):", *("    " + line for line in tick(plant))]
    lines.append(function(plant, "tick", ["dt", "substeps", *outside(plant, plant_tasks(plant))], ticks))
    for slots, tasks in sampled(plant).items():
        own = ["channel"] if tasks[0].per_channel else []
        given = [*own, *outside(plant, tasks)]
        lines.append(function(plant, slot_function(slots), given, task_lines(plant, slots[0], "channel")))
    return lines


def function(plant: Machine, name: str, given: list[str], body: list[str]) -> str:
    """One function over the group's memory."""
    size = state_size(plant)
    head = f"@njit(cache=True)\ndef {GROUP}__leaf__{name}({', '.join(['memory', 'p', *given])}):\n"
    return head + indent([f"state, w = memory[:{size}], memory[{size}:]", *views(plant), *body])


def state_size(machine: Machine) -> int:
    """Length of the flat state of all parts."""
    return sum(sum(machine.part_size(part)) for part in machine.parts)
