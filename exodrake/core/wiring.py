"""Checks of a machine's signals and schedule, and the order in which its outputs are computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from exodrake.core.errors import InputError, nearest
from exodrake.core.part import Part, Task, module_name, part_modules, points_of

if TYPE_CHECKING:
    from exodrake.core.machine import Machine


def check_signals(machine: Machine) -> None:
    """Every signal that a part reads has one writer, and direct feedthrough has no loop.

    Raises:
        InputError: naming machine, part and signal.
    """
    known = {s.name for s in machine.signals}
    written: dict[str, str] = dict.fromkeys(machine.inputs, "outside")
    for part in machine.parts:
        for name in (name for output in part.outputs for name in output.writes):
            if name not in known:
                raise InputError(f"{machine.name}: {part.name} writes unknown signal {name!r}")
            if name in written:
                raise InputError(f"{machine.name}: signal {name!r} is written by {written[name]} and by {part.name}")
            written[name] = part.name
    for part in machine.parts:
        for name in (name for task in (*part.tasks, *part.outputs) for name in task.reads):
            if name not in written:
                raise InputError(f"{machine.name}: {part.name} reads signal {name!r}, which nothing writes")
    feedthrough_order(machine)


def feedthrough_order(machine: Machine) -> list[tuple[Part, int]]:
    """Outputs as (part, index of the output), each after the signals it reads.

    Raises:
        InputError: for an algebraic loop, naming the parts in it.
    """
    waiting = [(part, k) for part in machine.parts for k in range(len(part.outputs))]
    ready, order = set(machine.inputs), []
    while waiting:
        computable = [(part, k) for part, k in waiting if set(part.outputs[k].reads) <= ready]
        if not computable:
            names = sorted({part.name for part, _ in waiting})
            raise InputError(f"{machine.name}: algebraic loop through {', '.join(names)}")
        for part, k in computable:
            ready |= set(part.outputs[k].writes)
        order += computable
        waiting = [pair for pair in waiting if pair not in computable]
    return order


def check_schedule(machine: Machine) -> None:
    """Every slot exists and holds one task, except that tasks of the same channels may share their slots.

    Raises:
        InputError: naming machine, slot and tasks.
    """
    taken: dict[int, tuple[str, Task]] = {}
    for part in machine.parts:
        for task in part.tasks:
            own = f"{part.name}.{task.function}"
            for slot in task.slots:
                if not 0 <= slot < machine.slots:
                    raise InputError(f"{machine.name}: {own} runs in slot {slot}, but a frame has {machine.slots}")
                name, other = taken.setdefault(slot, (part.name, task))
                shared = other.per_channel and task.per_channel and other.slots == task.slots
                if other is not task and not shared:
                    raise InputError(f"{machine.name}: slot {slot} holds both {name}.{other.function} and {own}")


def check_effects(machine: Machine) -> None:
    """Names of part modules and ids of effects are unique, and each effect acts at known points of one part.

    Raises:
        InputError: naming machine or effect.
    """
    homes: dict[str, object] = {}
    for module in (m for part in machine.parts for m in part_modules(part)):
        if homes.setdefault(module_name(module), module) is not module:
            raise InputError(f"{machine.name}: two modules of parts are called {module_name(module)!r}")
    points = points_of(machine.parts)
    for i, effect in enumerate(machine.effects):
        if effect.id in {other.id for other in machine.effects[:i]}:
            raise InputError(f"{machine.name}: two effects have the id {effect.id!r}")
        for point in effect.at:
            if point not in points:
                hint = nearest(point, list(points))
                raise InputError(f"{effect.id} acts at {point!r}, which {machine.name} lacks{hint}")
        parts = sorted({points[point].name for point in effect.at})
        if len(parts) > 1:
            raise InputError(f"{effect.id} acts on {' and '.join(parts)}; an effect acts on one part only")
