"""A part: signals read and written, parameters, states, tasks, and the named points where effects may act.

A module in `physics/` or `effects/` holds plain functions over floats, small tuples and arrays, which the Drake leaves
call, and which `engine.compose` copies into one module for numba. Signals join parts, over the channels of an axis.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib.util import module_from_spec, spec_from_file_location
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

TENDONS, JOINTS, SCALAR = "tendons", "joints", ""
NORMAL, UNIFORM = "standard normal", "uniform in 0 .. 1"
READINGS = ("shown", "late", "delivered")  # points that a reading passes
CURVE, PLACE, HYSTERESIS, RELAXATION = "curve", "place", "hysteresis", "relaxation"


@dataclass(frozen=True)
class Signal:
    """A named signal between parts: a Drake port and, where it has a log column, a column family."""

    name: str
    unit: str
    axis: str
    distribution: str = ""  # of a noise input: `NORMAL` or `UNIFORM`


@dataclass(frozen=True)
class Delay:
    """How late the samples of a measured signal are, as the log shows them."""

    signal: str  # the delay of each sample [s], of each channel or of all
    noise_input: str  # noise that is added to a sample after the delay
    noise_std: tuple[str, ...]  # parameters that scale this noise, of each channel or of all


class Axes(NamedTuple):
    """Names of a machine's tendons and joints."""

    tendons: tuple[str, ...]
    joints: tuple[str, ...]

    def of(self, axis: str) -> tuple[str, ...]:
        """Channel names of `TENDONS` or `JOINTS`; one empty name for `SCALAR`."""
        return {TENDONS: self.tendons, JOINTS: self.joints, SCALAR: ("",)}[axis]


@dataclass(frozen=True)
class FreeLaw:
    """A free law at a point: it adds `factor f(variable)` to the value that passes, and may be missing in the part.

    f is a free curve, or a sum of elements that remember how the variable moved; its shape is fitted to logs. Texts are
    source code in the arguments of the point.
    """

    words: str  # what the curve gives, over what: "friction over speed"
    variable: str  # u, as source of the point's arguments; of a law with memory, of those of the point `advances`
    unit: str  # of u
    factor: str = ""  # what multiplies f(u), as source; "" for 1
    kind: str = CURVE  # curve of u, of the place that the moves of u add up to, or memory: hysteresis or relaxation
    advances: str = ""  # name of the point at which the states of a law with memory advance
    moves: bool = False  # whether the variable of a law with memory is already a change within the tick
    fine: bool = False  # whether knots lie close together near 0, where the law may jump
    result: str = ""  # how the law acts on the value, with `law` for the sum of factor and curve; "" for value + law
    # point that takes the rate of this value, and its result there, with `slope` for f'(u)
    rate: tuple[str, str, str] = ("", "", "")

    @property
    def is_curve(self) -> bool:
        """Whether the law is a curve, of a variable or of a place."""
        return self.kind in (CURVE, PLACE)


def free_memory(
    words: str, variable: str, unit: str, advances: str, factor: str = "", moves: bool = False
) -> tuple[FreeLaw, FreeLaw]:
    """Hysteresis and relaxation of a variable."""
    hysteresis = FreeLaw(f"hysteresis {words}", variable, unit, factor, HYSTERESIS, advances, moves)
    return hysteresis, FreeLaw(f"relaxation {words}", variable, unit, factor, RELAXATION, advances, moves)


@dataclass(frozen=True)
class Unit:
    """SI unit, axis, and group of a field of a part's `Parameters`, called `group.name` or `group.name.channel`."""

    unit: str
    axis: str = SCALAR
    group: str = ""
    name: str = ""


def parameter_class(*groups: tuple[str, Mapping[str, str]] | tuple[str, Mapping[str, str], str]) -> Any:
    """A class of a part's parameters, a named tuple: axis of each group, SI unit of each of its names, `Unit.group`."""
    fields: Any = [
        (name, Annotated[tuple if axis else float, Unit(unit, axis, *group)])
        for axis, units, *group in groups
        for name, unit in units.items()
    ]
    return NamedTuple("Parameters", fields)


@dataclass(frozen=True)
class State:
    """A discrete state of a part: `width` values for each channel of its axis."""

    name: str
    axis: str = SCALAR
    width: int = 1
    unit: str = "-"


@dataclass(frozen=True)
class Task:
    """An update of a part's own state from signals: once a frame in each of its slots, or at every tick without one."""

    function: str
    reads: tuple[str, ...]
    slots: tuple[int, ...] = ()
    per_channel: bool = False  # whether the k-th slot handles the k-th channel, whose index comes before the signals


@dataclass(frozen=True)
class Output:
    """A function from state to signals."""

    function: str
    writes: tuple[str, ...]
    reads: tuple[str, ...] = ()  # signals that it follows from, too (direct feedthrough)
    states: tuple[str, ...] = ()  # that the signals show as they are; no function is called then

    @staticmethod
    def of_states(**signals: str) -> Output:
        """The output of states as they are: the signal of each state by the state's name."""
        return Output("", tuple(signals.values()), states=tuple(signals))


@dataclass(frozen=True)
class Point:
    """A named point where effects act: a function that returns its value, which passes through each effect there.

    Calls have the form `point(e, z, [channel,] value, *context)`; an effect's function gets
    `(value, *context, *parameters, *states)`, where it names all of the context or only what it needs. A module may
    also define a point as a function of its name. `laws`: free laws that may be missing there; None for a curve over
    each argument.
    """

    name: str  # as effects and files name it
    axis: str = SCALAR
    arguments: str = ""  # names of value and context; "" for a point that its module defines as a function
    about: str = ""  # what the value is, from what, and what the context is, with units
    laws: tuple[FreeLaw, ...] | None = None
    module: ModuleType | None = None  # the module that defines it, if not the part's own
    standard: str = ""  # the point of generic effects ("signal.shown", "sliding.braked") that this one is, if any

    def __call__(self, e: Any, z: Any, *given: Any) -> Any:
        """The value, as it is without effects."""
        return given[self.axis != SCALAR]

    @property
    def source(self) -> str:
        """The function that the point is."""
        channel = "j, " if self.axis else ""
        head = f"def {self.name}(e, z, {channel}{self.arguments}):"
        return f'{head}\n    """Point: {self.about}."""\n    return {self.arguments.split(", ")[0]}\n'


@dataclass(frozen=True)
class Part:
    """A part: signals it reads and writes, parameters, states, tasks and points."""

    name: str  # unique in a machine
    module: ModuleType  # functions of tasks and outputs; `start(x, z, n, e, ...)` sets the first state, else 0
    parameters: type
    tasks: tuple[Task, ...]
    outputs: tuple[Output, ...]
    states: tuple[State, ...] = ()
    points: tuple[Point, ...] = ()
    group: str = ""
    fills_start: bool = False  # its `start` fills the shared start vectors that those of other parts read
    # unit in the library -> size and unit of an effect here
    scales: Mapping[str, tuple[float, str]] = field(default_factory=dict, hash=False)
    # library id of a generic effect -> least, usual and largest value of its first parameter here [SI], if others
    ranges: Mapping[str, tuple[float, float, float]] = field(default_factory=dict, hash=False)

    @property
    def fields(self) -> tuple[Unit, ...]:
        """The part's parameters, in the order of its `Parameters` class, whose fields are annotated with `Unit`."""
        group, hints = self.group or self.name, get_type_hints(self.parameters, include_extras=True)
        units: dict[str, Unit] = {name: get_args(hint)[1] for name, hint in hints.items()}
        return tuple(replace(unit, group=unit.group or group, name=name) for name, unit in units.items())


def module_name(module: ModuleType) -> str:
    """A module's name without its package."""
    return module.__name__.rsplit(".", 1)[-1]


def prefix(module: str) -> str:
    """Prefix of a module's names in generated code: the last name for the library's parts, else all of them."""
    parts = module.split(".")
    return parts[-1] if parts[:2] == ["exodrake", "physics"] else "_".join(parts[parts[0] == "exodrake" :])


def part_modules(part: Part) -> list[ModuleType]:
    """The part's module and those that define its other points."""
    return [part.module, *dict.fromkeys(p.module for p in part.points if p.module is not None)]


def point_key(part: Part, point: Point) -> str:
    """`module.point`, by which an effect names a point."""
    return f"{module_name(point.module or part.module)}.{point.name}"


def point_arguments(part: Part, point: Point) -> tuple[str, ...]:
    """Names of a point's value and of its context."""
    if point.arguments:
        return tuple(point.arguments.split(", "))
    names = signature(getattr(point.module or part.module, point.name)).parameters
    return tuple(names)[3 if point.axis else 2 :]


def map_points(parts: Iterable[Part]) -> dict[str, Part]:
    """The part of each point (`point_key`) where effects may act."""
    return {point_key(part, point): part for part in parts for point in part.points}


def module_of_file(name: str, file: str | Path) -> ModuleType:
    """The module of a Python file under a full name, loaded once, as `import` would if the file lay there."""
    if name not in sys.modules:
        spec = spec_from_file_location(name, file)
        assert spec is not None and spec.loader is not None
        sys.modules[name] = module = module_from_spec(spec)
        spec.loader.exec_module(module)
    return sys.modules[name]
