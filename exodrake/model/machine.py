"""A machine: parts joined by signals, a schedule of tasks in slots, an effect library and what its logs hold.

Making one checks signals, schedule and effects. It declares its parameters with their tolerances; segments, regime and
command link for replay, localisation and monitoring; and its closed loop, if it has one, for the analysis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate
from typing import TYPE_CHECKING

from exodrake.core.errors import InputError, nearest
from exodrake.model.effect import Effect
from exodrake.model.part import Axes, Delay, Part, Signal, State, Task, map_points, module_name, part_modules

if TYPE_CHECKING:
    import numpy as np

    from exodrake.model.mechanism import Mechanism, Shape, Skeleton
    from exodrake.model.robot import Robot

SETTLING = 0.5  # s in which a joint stands as its loop holds it, a period of a position loop of 2 Hz: assumed


@dataclass(frozen=True)
class ParameterInfo:
    """A parameter: full name, SI unit, part that owns it, and null value if it is an effect's."""

    name: str
    unit: str
    part: str
    null: float | None = None


@dataclass(frozen=True)
class Tolerance:
    """Parameters that differ a little from one machine to the next of its kind."""

    # patterns, each naming one parameter, or several that err together; {w} and {j} stand for every tendon and joint
    parameters: tuple[str, ...]
    transform: str  # "relative" (times 1 + x), "additive" (plus x) or "log" (times exp x)
    prior_std: float  # standard deviation of x
    max_deviation: float  # largest |x|; beyond it a parameter is not the nominal one any more

    def in_words(self, unit: str = "") -> str:
        """Standard deviation and largest deviation as text; unit: of the parameter, after a blank."""
        std, most = self.prior_std, self.max_deviation
        if self.transform == "relative":
            return f"±{100 * std:g} %, at most {100 * most:g} %"
        return f"±{std:g}{unit}, at most {most:g}" if self.transform == "additive" else f"factor e^±{std:g}"


def full_name(*words: str) -> str:
    """Words joined by dots, empty ones left out."""
    return ".".join(word for word in words if word)


def find_places(name: str, names: Sequence[str]) -> list[int]:
    """Places of a parameter among full names: its own, else those of its channels; none of an unknown one."""
    if name in names:
        return [names.index(name)]
    return [i for i, full in enumerate(names) if full.rpartition(".")[0] == name]


@dataclass(frozen=True)
class Imposed:
    """A signal that carries the measured output of a fixed segment."""

    signal: str  # name of the signal
    rate: bool = False  # whether it carries the rate of change of the output instead of its value
    gain: float = 1.0  # factor on value or rate
    low: float | None = None  # lower bound of the value before the gain
    part: str = ""  # the only part whose plant update reads the signal so; empty: every part


@dataclass(frozen=True)
class Segment:
    """What lies between measured signals. A segment is fixed by imposing its measured output on the other segments."""

    name: str  # name in reports
    output: str  # column kind in which the segment ends
    inputs: tuple[str, ...] = ()  # column kinds from which the output follows
    imposed: tuple[Imposed, ...] = ()  # what carries the measured output of a fixed one; the column's signal if empty
    # values [SI] that parameters (names without channel) take while the segment is fixed
    parameters: Mapping[str, float] = field(default_factory=dict)
    # part and function `f(x, z, n, e, output)` that moves its state to the measured output after each tick
    hold: tuple[str, str] | None = None
    # time of the reading after the start of its frame [s], through which the output runs at its rate; None: it is held
    sampled: float | None = None
    exact: bool = False  # whether it is software of known law: never a suspect, and fed with unsmoothed readings
    contents: str = ""  # parts that it holds, for reports


@dataclass(frozen=True)
class Regime:
    """Measured signals by which the frames of a gap are sorted: motion, load and slackness of a channel."""

    position: str  # column kind whose rate of change is the motion
    load: str  # column kind of the load
    joint: str  # column kind of the joint position, or ""
    still: float  # speed below which a channel counts as at rest [unit of the position / s]
    slack: float  # load below which a channel counts as slack [unit of the load]


@dataclass(frozen=True)
class CommandLink:
    """A link on which speed commands may be lost, and the drive whose output shows a loss."""

    command: str  # column kind of the command
    output: str  # column kind of the position that the drive moves
    received: str  # signal that the drive reads: the last command that arrived
    part: str  # the drive; its other inputs are measured, as the segments impose them
    moved: str  # signal of the position


@dataclass(frozen=True)
class Gain:
    """A gain of the controller: parameter (name without channel), and the reach of maps and searches [its unit]."""

    parameter: str
    low: float
    high: float


@dataclass(frozen=True)
class Controller:
    """A structure of the controller that can be tuned: which gains are searched, which parameters have other values."""

    name: str  # as in reports
    gains: tuple[Gain, ...]  # searched on logarithmic scales, between bounds above 0
    fixed: Mapping[str, float] = field(default_factory=dict)  # values [SI] of further ones, by name without channel
    compliance: tuple[str, ...] = ()  # parameters that take the columns of d(actuated)/d(output) at rest


@dataclass(frozen=True)
class Loop:
    """The closed loop of a machine: one controller, run once a frame, with a command and a reading for each channel."""

    reference: str  # signal into the controller
    command: str  # signal out of the controller
    output: str  # signal of the controlled quantity
    measured: str  # signal of its reading
    part: str  # name of the controller among the parts
    held: str  # its state that holds the command until the next
    gains: tuple[Gain, Gain]  # the two of the stability map
    gentle: Mapping[str, float]  # gains that bring a loop to rest whose own do not
    step: float  # of a reference, large against noise and small against the limits [unit of the reference]
    # operating points: name -> channel -> reference [SI]; the first is the machine's own
    points: Mapping[str, Mapping[str, float]]
    controllers: tuple[Controller, ...] = ()  # structures that `tune` compares
    actuated: str = ""  # signal that the command's integral moves, for the static compliance; "" where there is none
    latency: str = ""  # parameter (without channel) of a latency of the command in frames; "" where there is none
    resolution: str = ""  # parameter by which the reading is rounded; "" where it is not
    # effects of which limit cycles are predicted, beside the rounding: id -> values [SI] not at default
    nonlinear: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    # adds the controller to a machine whose drives' own loops cannot be changed; None where it has one
    outer: Callable[[Robot], Robot] | None = None
    note: str = ""  # what its reader must know, in a sentence


@dataclass(frozen=True)
class Column:
    """A family of log columns `kind_channel`."""

    kind: str  # what the column names begin with
    signal: str  # the signal that the columns show, in its unit
    required: bool = True  # whether a log without it is refused
    label: str = ""  # name in figures and reports; made from the kind by default
    unit: str = ""  # unit in figures and reports; by default that of `display.SHOWN`
    delay: Delay | None = None  # what makes the samples late; None: they are on time
    rate_of: str = ""  # of an input: kind whose rate of change it is, so that a protocol can state it


@dataclass(frozen=True)
class Observer:
    """Output injection that keeps a simulation near a log, so that the error of one part does not go round the loop."""

    measured_input: str  # column kind whose signal takes its measured values
    output: str  # column kind that is held near its measured values
    state: tuple[str, str]  # (part, state) that is corrected once a frame
    divisor: str  # parameter that converts a difference of the output into one of the state
    gain: float  # share of the difference that is corrected in a frame


@dataclass(frozen=True, repr=False)
class Machine:
    """Parts, the signals between them, and all that general code needs to know about one machine.

    Attributes:
        name: the name of its folder.
        axes: names of the tendons and joints.
        signals: every signal between parts or from outside.
        parts: the parts, in the order of their states.
        inputs: signals that come from outside, one row a frame.
        columns: what a log shows.
        effects: the effect library, in the order in which effects act at one point.
        frame: frame period [s].
        slots: slots in a frame; a task runs in the middle of its slot, the plant once a slot.
        variants: functions of parts in use in place of others ("module.function" -> function).
        variants_available: variants by name: what each replaces, and its function.
        noise: parameters that are 0 in a run without noise.
        resolution: parameters that are 0 in a run without quantisation.
        compared: column kinds that a diagnosis compares.
        noise_std: noise of each compared kind [SI] from a function that gives a parameter by name.
        segments: what lies between measured signals, in the order of reports.
        command_link: where commands may be lost, if anywhere.
        tolerances: parameters that differ between machines of this kind, from the robot file.
        max_effects: effects that a diagnosis may name together.
        observer: how a simulation can be kept near a log; None if it cannot.
        reference_limits: names in the robot file's `limits` of the lowest and highest reference; () without limits.
        experiments: further experiments by name, cheapest first, each a protocol with options; empty for variations of
            the motion at hand.
        regime: signals by which a gap is sorted; None for the first and last measured signal of a joint.
        colours: colours of channels in figures; others take theirs from a palette.
        skeleton: what a recording draws, from the robot; None for a machine that is not drawn.
        mechanism: what another simulator needs of a robot; None for a machine that is not exported.
        loop: the closed loop that `analyse` and `tune` look at; None where there is none.
        separate: whether a parameter of a joint acts on that joint alone, but for effects that couple joints.
        defaults: values [SI] by full name of parameters that a robot file need not state.
        recorded: full name of a parameter -> its largest value [its unit] from the sizes of recorded signals by unit.
        sizes: by how much the ranges of effects, by their unit, are larger for a robot; None for those that are stated.
        resting: column kind of an effort -> that of the speed without which dry friction may hold any effort.
        settling: s from the start of a log after which samples count, where motion goes on that the log does not tell.
        nominal: the machine without variants that this one was made from; None if this one has no variants.
        machines: those made from this one, by names of their variants, so that each is compiled once.

    Examples:
        >>> import exodrake as exo
        >>> exo.load_robot("emps").machine
        Machine(emps: carriage, scale, drive; 8 signals, 20 effects)
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
    variants_available: Mapping[str, tuple[str, Callable]] = field(default_factory=dict)
    noise: tuple[str, ...] = ()
    resolution: tuple[str, ...] = ()
    compared: tuple[str, ...] = ()
    noise_std: Callable[[Callable[[str], float]], dict[str, float]] | None = None
    segments: tuple[Segment, ...] = ()
    command_link: CommandLink | None = None
    tolerances: tuple[Tolerance, ...] = ()
    max_effects: int = 2
    observer: Observer | None = None
    reference_limits: tuple[str, ...] = ()
    experiments: Mapping[str, str] = field(default_factory=dict)
    regime: Regime | None = None
    colours: Mapping[str, str] = field(default_factory=dict)
    skeleton: Callable[[Robot], Skeleton | Shape] | None = None
    mechanism: Callable[[Robot], Mechanism] | None = None
    loop: Loop | None = None
    defaults: Mapping[str, float] = field(default_factory=dict)
    separate: bool = False
    recorded: Mapping[str, Callable[[Mapping[str, float]], float]] = field(default_factory=dict)
    sizes: Callable[[Robot], Mapping[str, float]] | None = None
    resting: Mapping[str, str] = field(default_factory=dict)
    settling: float = 0.0
    nominal: Machine | None = None
    machines: dict[tuple[str, ...], Machine] = field(default_factory=dict, init=False, compare=False)

    def __post_init__(self) -> None:
        """Checks signals, schedule and effects. InputError names the machine and what is wrong."""
        written: dict[str, str] = dict.fromkeys(self.inputs, "outside")  # each signal that is read has one writer
        for part, name in ((p, name) for p in self.parts for output in p.outputs for name in output.writes):
            if name not in self.signal:
                raise InputError(f"{self.name}: {part.name} writes unknown signal {name!r}")
            if name in written:
                raise InputError(f"{self.name}: signal {name!r} is written by {written[name]} and by {part.name}")
            written[name] = part.name
        for part, task in ((p, task) for p in self.parts for task in (*p.tasks, *p.outputs)):
            if unknown := [name for name in task.reads if name not in written]:
                raise InputError(f"{self.name}: {part.name} reads signal {unknown[0]!r}, which nothing writes")
        feedthrough_order(self)
        taken: dict[int, tuple[str, Task]] = {}  # each slot holds one task, or tasks of the same channels
        for part, task, slot in ((p, t, slot) for p in self.parts for t in p.tasks for slot in t.slots):
            own = f"{part.name}.{task.function}"
            if not 0 <= slot < self.slots:
                raise InputError(f"{self.name}: {own} runs in slot {slot}, but a frame has {self.slots}")
            name, other = taken.setdefault(slot, (part.name, task))
            shared = other.per_channel and task.per_channel and other.slots == task.slots
            if other is not task and not shared:
                raise InputError(f"{self.name}: slot {slot} holds both {name}.{other.function} and {own}")
        homes: dict[str, object] = {}  # names are unique, and each effect acts at known points of one part
        for module in (m for part in self.parts for m in part_modules(part)):
            if homes.setdefault(module_name(module), module) is not module:
                raise InputError(f"{self.name}: two modules of parts are called {module_name(module)!r}")
        points, ids = map_points(self.parts), [effect.id for effect in self.effects]
        for effect in self.effects:
            if ids.count(effect.id) > 1:
                raise InputError(f"{self.name}: two effects have the id {effect.id!r}")
            for point in effect.at:
                if point not in points:
                    hint = nearest(point, list(points))
                    raise InputError(f"{effect.id} acts at {point!r}, which {self.name} lacks{hint}")
            if len(parts := sorted({points[point].name for point in effect.at})) > 1:
                raise InputError(f"{effect.id} acts on {' and '.join(parts)}; an effect acts on one part only")

    def __repr__(self) -> str:
        parts = ", ".join(part.name for part in self.parts)
        return f"Machine({self.name}: {parts}; {len(self.signals)} signals, {len(self.effects)} effects)"

    def to_json(self) -> dict[str, object]:
        """Names of its parts, channels and effects, and its signals with their units."""
        return {
            "name": self.name, "frame": self.frame, "tendons": self.axes.tendons, "joints": self.axes.joints,
            "parts": [part.name for part in self.parts], "signals": {s.name: s.unit for s in self.signals},
            "effects": [effect.id for effect in self.effects], "variants": self.variant_names,
        }  # fmt: skip

    @property
    def slot(self) -> float:
        """Length of a slot [s]."""
        return self.frame / self.slots

    @cached_property
    def signal(self) -> dict[str, Signal]:
        """Signals by name."""
        return {s.name: s for s in self.signals}

    @property
    def references(self) -> tuple[Column, ...]:
        """Columns whose signals come from outside: the references and measured inputs, one row a frame."""
        return tuple(c for signal in self.inputs for c in self.columns if c.signal == signal)

    def channels(self, signal: str) -> tuple[str, ...]:
        """Channel names of a signal; one empty name for a scalar."""
        return self.axes.of(self.signal[signal].axis)

    def log_names(self, columns: Iterable[Column]) -> list[str]:
        """Names in a log of all channels of some column families."""
        return [f"{column.kind}_{channel}" for column in columns for channel in self.channels(column.signal)]

    def heard_in(self, noise: str) -> list[str]:
        """Names in a log of compared columns that have the noise of a parameter, `part.name` or `part.name.channel`."""
        part, _, *channel = noise.split(".")
        written = {name for p in self.parts if p.name == part for output in p.outputs for name in output.writes}
        names = self.log_names(c for c in self.columns if c.signal in written and c.kind in self.compared)
        return [name for name in names if not channel or name.endswith(f"_{channel[0]}")]

    @property
    def motion(self) -> dict[str, list[int]]:
        """Joint -> places of its recorded position and acceleration in a reference, where they predict efforts."""
        names = self.log_names(self.references)
        recorded = {j: [f"position_{j}", f"acceleration_{j}"] for j in self.axes.joints}
        return {j: [names.index(c) for c in both] for j, both in recorded.items() if set(both) <= set(names)}

    def width(self, axis: str) -> int:
        """Number of channels of an axis."""
        return len(self.axes.of(axis))

    def effects_on(self, part: Part) -> tuple[Effect, ...]:
        """Effects of the library that sit on this part."""
        modules = {module_name(module) for module in part_modules(part)}
        return tuple(effect for effect in self.effects if next(iter(effect.at)).split(".")[0] in modules)

    @cached_property
    def parameters(self) -> tuple[ParameterInfo, ...]:
        """All parameters in the order of the flat parameter vector."""
        found: list[ParameterInfo] = []
        for part in self.parts:
            rows = [(f.group, f.name, f.unit, f.axis, None) for f in part.fields]
            rows += [(e.id, p.name, p.unit, p.axis, p.null) for e in self.effects_on(part) for p in e.parameters]
            for group, name, unit, axis, null in rows:
                names = (full_name(group, name, channel) for channel in self.axes.of(axis))
                found += [ParameterInfo(full, unit, part.name, null) for full in names]
        return tuple(found)

    @cached_property
    def index(self) -> dict[str, int]:
        """Index of each parameter in the flat parameter vector, by full name."""
        return {parameter.name: i for i, parameter in enumerate(self.parameters)}

    def indices(self, name: str) -> list[int]:
        """Indices in the flat vector of a full name, or of all channels of a name without channel; none if unknown."""
        return find_places(name, list(self.index))

    def effect_indices(self, identity: str, parameter: str) -> dict[str, int]:
        """Index in the flat vector of each channel of an effect's parameter; "" for one without channels."""
        axis = next(p.axis for p in self.effect(identity).parameters if p.name == parameter)
        return {channel: self.index[full_name(identity, parameter, channel)] for channel in self.axes.of(axis)}

    def has_effect(self, values: np.ndarray, effect: Effect) -> bool:
        """Whether an effect is present in a flat vector (parameters,) [SI], on some channel at least."""
        first = effect.parameters[0]
        return any(values[i] != first.null for i in self.effect_indices(effect.id, first.name).values())

    def effect(self, identity: str) -> Effect:
        """The effect of that id; raises InputError with the nearest ids."""
        known = {effect.id: effect for effect in self.effects}
        if identity not in known:
            hint = nearest(identity, list(known)) or f"; `exodrake effects --robot {self.name}` lists them"
            raise InputError(f"unknown effect {identity!r}{hint}")
        return known[identity]

    def column(self, kind: str) -> Column:
        """The column family of that kind."""
        return next(c for c in self.columns if c.kind == kind)

    def column_width(self, kind: str) -> int:
        """Number of channels of a column family."""
        return len(self.channels(self.column(kind).signal))

    def state_index(self, part: Part, name: str) -> int:
        """Index in a part's own state vector at which a state begins."""
        return stack({s.name: self.width(s.axis) * s.width for s in part.states})[name].start

    @cached_property
    def part_sizes(self) -> dict[str, tuple[int, int]]:
        """Lengths of a part's own state and of the states of the effects on it, by its name."""

        def size(states: Iterable[State]) -> int:
            return sum(self.width(s.axis) * s.width for s in states)

        return {p.name: (size(p.states), size(s for e in self.effects_on(p) for s in e.states)) for p in self.parts}

    @cached_property
    def offsets(self) -> dict[str, slice]:
        """Slice of each signal in the flat vector of signals."""
        return stack({signal.name: self.width(signal.axis) for signal in self.signals})

    @property
    def variant_names(self) -> tuple[str, ...]:
        """Names of the variants in use."""
        return tuple(name for name, (point, _) in self.variants_available.items() if point in self.variants)


def stack[K](widths: Mapping[K, int]) -> dict[K, slice]:
    """Slices of things side by side, from their widths."""
    ends = accumulate(widths.values())
    return {name: slice(end - width, end) for (name, width), end in zip(widths.items(), ends)}


def state_size(machine: Machine) -> int:
    """Length of the flat state."""
    return sum(map(sum, machine.part_sizes.values()))


def signal_count(machine: Machine) -> int:
    """Length of the flat vector of signals."""
    return sum(machine.width(s.axis) for s in machine.signals)


def feedthrough_order(machine: Machine) -> list[tuple[Part, int]]:
    """Outputs as (part, index of the output), each after the signals it reads. InputError for an algebraic loop."""
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
