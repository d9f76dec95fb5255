"""A machine: parts joined by wires, a schedule of slots, the effect library of effects, and the layout of its
numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from exodrake.core.effect import Effect
from exodrake.core.errors import InputError, nearest
from exodrake.core.parameter import ParameterInfo, Tolerance
from exodrake.core.part import Field, Part, Task
from exodrake.core.signal import Axes, Delay, Signal


@dataclass(frozen=True)
class Column:
    """A log column family: its kind, the signal that it shows, and its label and unit in figures and reports.

    An empty label is made from the kind, an empty unit from the signal's (`display.SHOWN`).
    """

    kind: str
    signal: str
    required: bool = True
    label: str = ""
    unit: str = ""
    delay: Delay | None = None


@dataclass(frozen=True)
class Observer:
    """How a run may be made to follow a log, so that errors of a part do not go round the loop.

    imposed: column kind whose wire takes its measured values. held: column kind that is held near its measured values
    by an observer: each frame, state (block, name) moves by `gain` of the difference, divided by the number `per`.
    """

    measured_input: str
    output: str
    state: tuple[str, str]
    divisor: str
    gain: float


@dataclass(frozen=True)
class Machine:
    """Who is wired to whom, and when.

    Attributes:
        frame, slots: frame period [s] and slots in it; tasks run in the middle of their slot, and the plant ticks
            `substeps` times a slot.
        given: wires that come from outside, one row a frame.
        columns: what a log shows.
        variants: functions of pages replaced by others of the same form ("page.function" -> function).
        noise, resolution: numbers that are 0 where a run is noise-free, or unrounded.
        compared: column kinds that a diagnosis compares; `floors` gives their noise from the sensors' numbers [SI].
        segments: what lies between two measured wires, and the column kind that it ends in.
        scatter: numbers that differ from one such machine to the next, as the robot file says.
        depth: effects that a diagnosis may name together.
        steered: how a run can follow a log, if it can.
        colours: of channels in figures; the others take theirs from a palette.
        operating_point: channel -> reference [SI] at which `analyse` linearises the loop.
    """

    name: str
    axes: Axes
    signals: tuple[Signal, ...]
    parts: tuple[Part, ...]
    inputs: tuple[str, ...]
    columns: tuple[Column, ...]
    effects: tuple[Effect, ...] = ()
    frame: float = 0.02
    slots: int = 10
    variants: Mapping[str, Callable] = field(default_factory=dict)
    noise: tuple[str, ...] = ()
    resolution: tuple[str, ...] = ()
    compared: tuple[str, ...] = ()
    noise_std: Callable[[Callable[[str], float]], dict[str, float]] | None = None
    segments: Mapping[str, str] = field(default_factory=dict)
    tolerances: tuple[Tolerance, ...] = ()
    max_effects: int = 2
    observer: Observer | None = None
    colours: Mapping[str, str] = field(default_factory=dict)
    operating_point: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_wiring(self)
        check_schedule(self)
        check_effects(self)

    @property
    def slot(self) -> float:
        """Length of a slot [s]."""
        return self.frame / self.slots

    @cached_property
    def signal(self) -> dict[str, Signal]:
        """Wires by name."""
        return {w.name: w for w in self.signals}

    @property
    def references(self) -> tuple[Column, ...]:
        """Columns whose wires come from outside: what the machine is asked to do, one row a frame."""
        return tuple(c for wire in self.inputs for c in self.columns if c.signal == wire)

    def width(self, axis: str) -> int:
        """How many channels `over` has."""
        return len(self.axes.of(axis))

    def effects_on(self, part: Part) -> tuple[Effect, ...]:
        """Effects of the effect library that sit on this block."""
        pages = {module_name(page) for page in part_modules(part)}
        return tuple(effect for effect in self.effects if next(iter(effect.at)).split(".")[0] in pages)

    @cached_property
    def parameters(self) -> tuple[ParameterInfo, ...]:
        """All numbers in the order of the flat parameter vector."""
        found: list[ParameterInfo] = []
        for part in self.parts:
            for f in part.fields:
                found += [ParameterInfo(n, f.unit, part.name) for n in self.names(f)]
            for effect in self.effects_on(part):
                for number in effect.parameters:
                    names = self.names(Field(effect.id, number.name, number.unit, number.axis))
                    found += [ParameterInfo(n, number.unit, part.name, number.null) for n in names]
        return tuple(found)

    def names(self, f: Field) -> list[str]:
        """Full names of a field, one per channel."""
        return [".".join(part for part in (f.group, f.name, channel) if part) for channel in self.axes.of(f.axis)]

    @cached_property
    def index(self) -> dict[str, int]:
        """Place of each number in the flat parameter vector."""
        return {parameter.name: i for i, parameter in enumerate(self.parameters)}

    def effect(self, identity: str) -> Effect:
        """The effect of that id; raises InputError with the nearest names."""
        for effect in self.effects:
            if effect.id == identity:
                return effect
        raise InputError(f"unknown effect {identity!r}{nearest(identity, [e.id for e in self.effects])}")

    def column(self, kind: str) -> Column:
        """The column family of that kind."""
        return next(c for c in self.columns if c.kind == kind)

    def column_width(self, kind: str) -> int:
        """Lanes of a column family."""
        return self.width(self.signal[self.column(kind).signal].axis)

    def state_place(self, part: Part, name: str) -> int:
        """Where a state of a block begins in its own state vector."""
        before = part.states[: next(i for i, s in enumerate(part.states) if s.name == name)]
        return sum(self.width(s.axis) * s.width for s in before)

    def part_size(self, part: Part) -> tuple[int, int]:
        """Lengths of a block's own state and of the states of the effects on it."""
        own = sum(self.width(s.axis) * s.width for s in part.states)
        return own, sum(self.width(s.axis) * s.width for e in self.effects_on(part) for s in e.states)


def module_name(page) -> str:
    """A page's short name."""
    return page.__name__.rsplit(".", 1)[-1]


def prefix(module: str) -> str:
    """Prefix of a module's names in generated code: the last name for the library's parts, else all of them."""
    parts = module.split(".")
    return parts[-1] if parts[:2] == ["exodrake", "systems"] else "_".join(parts[parts[0] == "exodrake" :])


def part_modules(part: Part) -> list:
    """The block's page and those that hold its other points."""
    return [part.module, *dict.fromkeys(p.module for p in part.points if p.module is not None)]


def points_of(parts: Iterable[Part]) -> dict[str, Part]:
    """The part of each point ("module.point") where effects may act."""
    return {f"{module_name(p.module or part.module)}.{p.name}": part for part in parts for p in part.points}


def check_effects(machine: Machine) -> None:
    """Names of part modules and ids of effects are unique, and each effect acts at known points of one part."""
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
                raise InputError(
                    f"{effect.id} acts at {point!r}, which {machine.name} lacks{nearest(point, list(points))}"
                )
        parts = sorted({points[point].name for point in effect.at})
        if len(parts) > 1:
            raise InputError(f"{effect.id} acts on {' and '.join(parts)}; an effect acts on one part only")


def check_wiring(machine: Machine) -> None:
    """Every wire read is written once or given; no loop of direct feedthrough."""
    known = {w.name for w in machine.signals}
    written: dict[str, str] = dict.fromkeys(machine.inputs, "outside")
    for part in machine.parts:
        for output in part.outputs:
            for name in output.writes:
                if name not in known:
                    raise InputError(f"{machine.name}: {part.name} writes unknown wire {name!r}")
                if name in written:
                    raise InputError(f"{machine.name}: wire {name!r} is written by {written[name]} and by {part.name}")
                written[name] = part.name
    for part in machine.parts:
        for task in (*part.tasks, *part.outputs):
            for name in task.reads:
                if name not in written:
                    raise InputError(f"{machine.name}: {part.name} reads wire {name!r}, which nothing writes")
    feedthrough_order(machine)


def feedthrough_order(machine: Machine) -> list[tuple[Part, int]]:
    """Outputs (block, output's index), each after the wires it reads; raises InputError on an algebraic loop."""
    waiting = [(b, k) for b in machine.parts for k in range(len(b.outputs))]
    ready, order = set(machine.inputs), []
    while waiting:
        free = [(b, k) for b, k in waiting if set(b.outputs[k].reads) <= ready]
        if not free:
            names = sorted({b.name for b, _ in waiting})
            raise InputError(f"{machine.name}: algebraic loop through {', '.join(names)}")
        for b, k in free:
            ready |= set(b.outputs[k].writes)
        order += free
        waiting = [pair for pair in waiting if pair not in free]
    return order


def check_schedule(machine: Machine) -> None:
    """Slots exist and hold one task each, except that the readings of one channel may share a slot."""
    taken: dict[int, tuple[str, Task]] = {}
    for part in machine.parts:
        for task in part.tasks:
            own = f"{part.name}.{task.function}"
            for slot in task.slots:
                if not 0 <= slot < machine.slots:
                    raise InputError(f"{machine.name}: {own} runs in slot {slot}, but a frame has {machine.slots}")
                other = taken.setdefault(slot, (part.name, task))
                if other[1] is not task and not (
                    other[1].per_channel and task.per_channel and other[1].slots == task.slots
                ):
                    raise InputError(f"{machine.name}: slot {slot} holds both {other[0]}.{other[1].function} and {own}")


def offsets(machine: Machine) -> dict[str, slice]:
    """Where each wire lies in the flat vector of wires."""
    found, at = {}, 0
    for wire in machine.signals:
        width = machine.width(wire.axis)
        found[wire.name], at = slice(at, at + width), at + width
    return found


def state_size(machine: Machine) -> int:
    """Length of the flat state."""
    return sum(sum(machine.part_size(part)) for part in machine.parts)


def signal_count(machine: Machine) -> int:
    """Length of the flat vector of wires."""
    return sum(machine.width(w.axis) for w in machine.signals)
