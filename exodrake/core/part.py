"""What a part is: wires read and written, numbers, states, tasks, and the named points where an effect may sit.

A *page* (a module in `systems/` or `effects/`) holds plain functions over floats, small tuples and arrays.
`diagrams.compose` copies the pages of a machine into one module that numba compiles; the same functions serve the Drake
leaves and the compiled twin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import NamedTuple, get_args, get_type_hints

WIRES, JOINTS, ONE = "wires", "joints", ""


@dataclass(frozen=True)
class Unit:
    """Metadata of a field of a part's `Numbers`: SI unit, what it runs over, and the group that prefixes its name."""

    unit: str
    over: str = ONE
    group: str = ""


@dataclass(frozen=True)
class Field:
    """One number of a part as the outside sees it: `group.name` or `group.name.lane`."""

    group: str
    name: str
    unit: str
    over: str


def fields_of(numbers: type, group: str) -> tuple[Field, ...]:
    """Fields of a page's `Numbers` class (a NamedTuple whose fields are annotated with `Unit`), in order."""
    found = []
    for name, hint in get_type_hints(numbers, include_extras=True).items():
        unit: Unit = get_args(hint)[1]
        found.append(Field(unit.group or group, name, unit.unit, unit.over))
    return tuple(found)


@dataclass(frozen=True)
class State:
    """A discrete state of a part: `width` numbers for each lane of `over`."""

    name: str
    over: str = ONE
    width: int = 1
    unit: str = "-"


@dataclass(frozen=True)
class Task:
    """An update of a part's own state from wires. `slots` empty: the plant's tick; else once a frame in each slot.

    `lanes`: the k-th slot handles the k-th lane only and the function takes its index before the wires.
    """

    function: str
    reads: tuple[str, ...]
    slots: tuple[int, ...] = ()
    lanes: bool = False


@dataclass(frozen=True)
class Output:
    """A function from state (and, where `reads` is not empty, from wires: direct feedthrough) to wires."""

    function: str
    writes: tuple[str, ...]
    reads: tuple[str, ...] = ()


@dataclass(frozen=True)
class Point:
    """A named place where effects apply: the page's function of that name, whose value passes through each effect.

    Calls have the form `name(e, z, [lane,] value, *context)`; an effect's function gets
    `(value, *context, *numbers, *states)`.
    """

    name: str
    over: str = ONE
    page: ModuleType | None = None  # the page that holds it, where that is not the block's own


@dataclass(frozen=True)
class Block:
    """A part. `name` is unique in a machine; `page` holds `Numbers`, `start` and the functions of tasks and outputs."""

    name: str
    page: ModuleType
    numbers: type
    tasks: tuple[Task, ...]
    outputs: tuple[Output, ...]
    states: tuple[State, ...] = ()
    points: tuple[Point, ...] = ()
    group: str = ""

    @property
    def fields(self) -> tuple[Field, ...]:
        """The part's numbers, in the order of its `Numbers` class."""
        return fields_of(self.numbers, self.group or self.name)


@dataclass(frozen=True)
class Wire:
    """A named signal between parts: a Drake port and, where it has a log column, a column family."""

    name: str
    unit: str
    over: str


@dataclass(frozen=True)
class Number:
    """A parameter of an effect: where it is absent, what is plausible, how a fit should move it.

    Attributes:
        name: parameter name as in reports.
        unit: SI unit.
        neutral: value at which the effect is absent, bit for bit (that of the effect's first number decides).
        low, high: plausible range, used to draw and to bound fits.
        over: `WIRES`, `JOINTS` or `ONE`.
        usual: value taken when the effect is spliced without saying.
        free: whether a fit may move it.
        scale: how a fit sees it: "linear", "log" or "reciprocal" (for a stiffness whose neutral value is infinite).
        period: values that differ by it mean the same and are told from `low` on; 0 for none.
    """

    name: str
    unit: str
    neutral: float
    low: float
    high: float
    over: str = ONE
    usual: float | None = None
    free: bool = True
    scale: str = "linear"
    period: float = 0.0

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"{self.name}: empty range {self.low} .. {self.high}")

    @property
    def typical(self) -> float:
        """A plausible value to start from [unit of the number]."""
        if self.usual is not None:
            return self.usual
        if self.scale != "linear" and self.low > 0:
            return (self.low * self.high) ** 0.5
        return 0.5 * (self.low + self.high)

    def told(self, value: float) -> float:
        """The value as reports state it: of those that mean the same, the one within a period from `low`."""
        return self.low + (value - self.low) % self.period if self.period else value


@dataclass(frozen=True)
class Effect:
    """A piece of physics that the nominal model leaves out, and the point where it sits.

    Attributes:
        id: `block.name`, the vocabulary of reports.
        summary: one sentence: what it is.
        signature: one sentence: how it shows in logs.
        source: where equation and range come from.
        at: mapping from point ("part.point") to the page's function that acts there.
        numbers: parameters; the effect is absent where the first has its neutral value.
        states: own states, zero at start, advanced at a point whose value is the dummy `dt` (see `advances`).
        advances: points (of those in `at`) where the function returns the effect's new states instead of a value.
    """

    id: str
    summary: str
    signature: str
    source: str
    at: dict[str, Callable]
    numbers: tuple[Number, ...]
    states: tuple[State, ...] = ()
    advances: tuple[str, ...] = ()

    @property
    def block(self) -> str:
        """The block that a report names: the id's prefix."""
        return self.id.split(".")[0]

    @property
    def over(self) -> str:
        """What the effect runs over: `WIRES`, `JOINTS` or `ONE`."""
        return self.numbers[0].over

    @property
    def slug(self) -> str:
        """The id as an identifier."""
        return self.id.replace(".", "_")


class Lanes(NamedTuple):
    """Names of a machine's wires and joints."""

    wires: tuple[str, ...]
    joints: tuple[str, ...]

    def of(self, over: str) -> tuple[str, ...]:
        """Lane names of `WIRES` or `JOINTS`; one empty name for `ONE`."""
        return {WIRES: self.wires, JOINTS: self.joints, ONE: ("",)}[over]
