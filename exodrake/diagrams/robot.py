"""A robot: a machine with its numbers, read from and written to a file.

A file either holds all numbers (`robots/exo_index.yaml`) or names a `base` and what differs from it:

    base: exo_index
    numbers: {finger: {kappa: {MCP: 0.09}}, tendon: {k: 2500}}          # or dotted keys: finger.kappa.MCP: 0.09
    effects: {tendon.capstan_friction: {mu_phi: {AF: 0.3, MF: 0.3, AE: 0.3}}}
    parts: [controller_as_printed]                                       # variants of parts, by page
    scatter:                                                             # what differs from one such robot to the next
      - {each: ["tendon.k.{w}"], how: scales, spread: 0.03, limit: 0.10}

`machine` is a built-in one or `package.page`, a page with a function of its last name that returns the Machine.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.block import Effect
from exodrake.diagrams.machine import Machine, Scatter, nearest
from exodrake.diagrams.robot_check import check_content
from exodrake.errors import InputError
from exodrake.files import is_file, parse_yaml, read_bytes, write_text

BUILT_IN = ("exo_index", "emps", "tendon_sheath", "so101", "dvrk_wrist")
MACHINES = {name: f"exodrake.diagrams.{name}" for name in BUILT_IN}


@dataclass(frozen=True, eq=False)
class Robot:
    """A machine and its numbers.

    Attributes:
        machine: parts, wires, schedule.
        values: (n,) flat vector of numbers in SI, in the order of `machine.entries`.
        sources: per full name, where the number comes from.
        ranges: per full name, plausible low and high.
        limits: tension limits per wire [N]: `F_max`, `F_min`.
        grasps: tension targets per mode and wire [N].
    """

    machine: Machine
    values: np.ndarray
    sources: dict[str, str] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    limits: dict[str, dict[str, float]] = field(default_factory=dict)
    grasps: dict[str, dict[str, float]] = field(default_factory=dict)
    source: str = ""

    def __getitem__(self, name: str) -> float:
        """One number by its full name, `finger.kappa.MCP`; InputError with the nearest names."""
        return float(self.values[self.places(name)[0]])

    def lanes(self, name: str) -> np.ndarray:
        """A number of all lanes, e.g. `finger.kappa` -> (3,)."""
        return self.values[self.places(name)]

    def places(self, name: str) -> list[int]:
        """Places in the flat vector of a full name, or of all lanes of a name without its lane."""
        index = self.machine.index
        if name in index:
            return [index[name]]
        found = [i for full, i in index.items() if full.rsplit(".", 1)[0] == name]
        if not found:
            raise InputError(f"{self.source or self.machine.name}: unknown number {name!r}{nearest(name, list(index))}")
        return found

    def with_numbers(self, numbers: Mapping[str, Any], source: str = "") -> Robot:
        """The robot with numbers changed: dotted or nested names to values [SI]; a name without lane sets all lanes."""
        values, sources = self.values.copy(), dict(self.sources)
        for name, value in flatten(numbers):
            for i in self.places(name):
                values[i] = checked(name, value, source)
                if source:
                    sources[self.machine.entries[i].name] = source
        return refuse_negative(replace(self, values=values, sources=sources))

    def splice(self, identity: str, numbers: Mapping[str, Any] | None = None, lanes: Iterable[str] = ()) -> Robot:
        """The robot with an effect in it.

        Args:
            identity: the effect's id. numbers: parameters, each one value or one per lane; typical ones where left out.
            lanes: wires or joints it sits on; all if empty.
        """
        effect = self.machine.effect(identity)
        given = dict(numbers or {})
        known = {n.name for n in effect.numbers}
        for name in given:
            if name not in known:
                raise InputError(f"{identity} has no parameter {name!r}{nearest(name, sorted(known))}")
        values = self.values.copy()
        wanted = check_lanes(self.machine, effect, lanes)
        for number in effect.numbers:
            value = given.get(number.name, number.typical)
            for lane in wanted:
                one = value.get(lane, number.neutral) if isinstance(value, Mapping) else value
                full = ".".join(part for part in (identity, number.name, lane if number.over else "") if part)
                values[self.machine.index[full]] = checked(full, one, "effect")
        return replace(self, values=values)

    def effects(self) -> dict[str, dict[str, dict[str, float]]]:
        """Effects present: id -> parameter -> lane -> value ("" for a parameter without lanes)."""
        present: dict[str, dict[str, dict[str, float]]] = {}
        for effect in self.machine.shelf:
            first = effect.numbers[0]
            at = {lane: self.values[i] for lane, i in self.lane_places(effect.id, first.name, first.over)}
            if any(v != first.neutral for v in at.values()):
                present[effect.id] = {
                    n.name: {lane: float(self.values[i]) for lane, i in self.lane_places(effect.id, n.name, n.over)}
                    for n in effect.numbers
                }
        return present

    def lane_places(self, group: str, name: str, over: str) -> list[tuple[str, int]]:
        """Lane names and places of a number."""
        lanes = self.machine.lanes.of(over)
        return [(lane, self.machine.index[".".join(p for p in (group, name, lane) if p)]) for lane in lanes]

    def with_part(self, page: str) -> Robot:
        """The robot with a variant part, e.g. `controller_as_printed`; InputError for an unknown one."""
        return replace(self, machine=vary(self.machine, page))


def refuse_negative(robot: Robot) -> Robot:
    """The robot itself. InputError for a quantity below 0 whose plausible range lies above it, such as a length."""
    for name, (low, _) in robot.ranges.items():
        entry = robot.machine.entries[robot.machine.index[name]]
        if low > 0 > robot[name] and entry.unit != "rad":
            raise InputError(f"{robot.source}: {name} = {robot[name]:g} {entry.unit}, below 0")
    return robot


VARIANTS = {
    "controller_as_printed": ("controller.damping", "exodrake.systems.controller_as_printed", "damping"),
    "routers_as_printed": ("routers.applied_arm", "exodrake.systems.routers_as_printed", "applied_arm"),
}


@cache
def vary_cached(name: str, scatter: tuple[Scatter, ...], pages: tuple[str, ...]) -> Machine:
    """A machine with variant parts; the same object each time, so that it is composed once."""
    machine = machine_of(MACHINES[name], scatter)
    variants = {VARIANTS[p][0]: getattr(import_module(VARIANTS[p][1]), VARIANTS[p][2]) for p in pages}
    return replace(machine, variants=variants)


@cache
def machine_of(module: str, scatter: tuple[Scatter, ...]) -> Machine:
    """The machine of a page, with what scatters in it; the same object each time."""
    return replace(getattr(import_module(module), module.rsplit(".", 1)[-1])(), scatter=scatter)


def vary(machine: Machine, page: str) -> Machine:
    """The machine with one more variant part."""
    if page not in VARIANTS:
        raise InputError(f"unknown part {page!r}{nearest(page, list(VARIANTS))}; there are {', '.join(VARIANTS)}")
    present = {p for p, (point, _, _) in VARIANTS.items() if point in machine.variants}
    return vary_cached(machine.name, machine.scatter, tuple(sorted(present | {page})))


def flatten(numbers: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Nested mappings as dotted names; a mapping with a `value` key counts as that value."""
    found = []
    for key, value in numbers.items():
        name = f"{prefix}.{key}" if prefix else str(key)
        if isinstance(value, Mapping) and "value" in value:
            value = value["value"]
        found += flatten(value, name) if isinstance(value, Mapping) else [(name, value)]
    return found


def checked(name: str, value: Any, source: str) -> float:
    """A finite number, or infinity where a stiffness is absent; InputError naming it otherwise.

    Text that is a number counts: YAML 1.1 reads 1e-3 as text.
    """
    if isinstance(value, str):
        with contextlib.suppress(ValueError):
            value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
        raise InputError(f"{source or 'numbers'}: {name} is {value!r}, wanted a number")
    try:
        number = float(value)
    except OverflowError:
        raise InputError(f"{source or 'numbers'}: {name} is too large a number") from None
    if math.isnan(number):
        raise InputError(f"{source or 'numbers'}: {name} is not a number (NaN)")
    return number


def check_lanes(machine: Machine, effect: Effect, lanes: Iterable[str]) -> tuple[str, ...]:
    """Lanes an effect shall sit on; InputError naming an unknown one."""
    known, wanted = machine.lanes.of(effect.over), tuple(lanes)
    for lane in wanted:
        if lane not in known:
            lanes = ", ".join(filter(None, known)) or "no lanes"
            raise InputError(f"{effect.id} does not sit on {lane!r}; it knows {lanes}")
    return wanted or known


def load_robot(path: str | Path = "exo_index", above: tuple[str, ...] = ()) -> Robot:
    """The robot of a file, or a built-in one by name. Raises InputError naming file and key.

    above: files whose base this one is, for the message about a ring.
    """
    shipped = files("exodrake.robots") / f"{path}.yaml"
    if "/" not in str(path) and is_file(str(shipped)):
        source, data = f"{path}.yaml", shipped.read_bytes()
    else:
        file = Path(path)
        if not is_file(file):
            raise InputError(f"no robot file {str(path)!r}")
        source, data = file.name, read_bytes(file)
    return build(parse_yaml(data, source), source, above or (str(path),))


def build(content: Any, source: str, above: tuple[str, ...] = ()) -> Robot:
    """A robot from a file's content; above: bases that led to it. InputError naming file and key."""
    check_content(content, source)
    base = content.get("base")
    if base in above:
        raise InputError(f"{source}: base {base!r} comes back to itself")
    robot = load_robot(base, (*above, base)) if base else blank(content, source)
    with named(source):
        return changed_by(content, replace(robot, source=source))


def changed_by(content: Mapping[str, Any], robot: Robot) -> Robot:
    """The robot with what a file's content says of parts, numbers, effects, limits and grasps."""
    for page in content.get("parts") or ():
        robot = robot.with_part(page)
    numbers = content.get("numbers") or {}
    robot = robot.with_numbers(numbers, robot.source)
    robot = refuse_negative(replace(robot, **stated(numbers, robot)))
    for identity, given in (content.get("effects") or {}).items():
        lanes = {lane for v in given.values() if isinstance(v, Mapping) for lane in v}
        robot = robot.splice(identity, given, [lane for lane in lanes if lane])
    limits = check_limits({**robot.limits, **table(content.get("limits") or {})}, robot.source)
    return replace(robot, limits=limits, grasps={**robot.grasps, **(content.get("grasps") or {})})


@contextlib.contextmanager
def named(source: str) -> Iterator[None]:
    """Puts the file's name before a refusal that lacks it."""
    try:
        yield
    except InputError as problem:
        raise problem if source in str(problem) else InputError(f"{source}: {problem}") from None


def blank(content: Mapping[str, Any], source: str) -> Robot:
    """A machine whose effects are neutral and whose own numbers are still to come; InputError if some never do."""
    name = str(content.get("machine"))
    module = MACHINES.get(name, name)
    try:
        machine = machine_of(module, scatter_of(content.get("scatter") or ()))
    except (ImportError, AttributeError, ValueError):
        raise InputError(f"{source}: machine {name!r} is none of {', '.join(MACHINES)}, nor a page to import") from None
    named = {n for n, _ in flatten(content.get("numbers") or {})}
    for entry in machine.entries:
        if entry.neutral is None and entry.name not in named and entry.name.rsplit(".", 1)[0] not in named:
            raise InputError(f"{source}: number {entry.name} is missing")
    return Robot(machine, np.array([e.neutral if e.neutral is not None else math.nan for e in machine.entries]))


def scatter_of(entries: Iterable[Mapping[str, Any]]) -> tuple[Scatter, ...]:
    """The `scatter` list of a robot file, whose form is checked."""
    return tuple(Scatter(tuple(e["each"]), e["how"], float(e["spread"]), float(e["limit"])) for e in entries)


def stated(numbers: Mapping[str, Any], robot: Robot) -> dict[str, dict]:
    """Sources and ranges that a file states beside its values; checks that a value lies in its range."""
    sources, ranges = dict(robot.sources), dict(robot.ranges)
    for group, fields in numbers.items():
        for name, item in fields.items() if isinstance(fields, Mapping) else ():
            if not (isinstance(item, Mapping) and "value" in item):
                continue
            for i in robot.places(f"{group}.{name}"):
                entry = robot.machine.entries[i]
                if item.get("unit", entry.unit) != entry.unit:
                    raise InputError(f"{robot.source}: {entry.name} has unit {item['unit']!r}, wanted {entry.unit!r}")
                sources[entry.name] = str(item.get("source", ""))
                if "range" in item:
                    ranges[entry.name] = (float(item["range"][0]), float(item["range"][1]))
    return {"sources": sources, "ranges": ranges}


def table(limits: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Limits as plain values per wire."""
    return {name: {w: float(v) for w, v in item.get("value", item).items()} for name, item in limits.items()}


def check_limits(limits: dict[str, dict[str, float]], source: str) -> dict[str, dict[str, float]]:
    """Refuses negative tension limits and a floor above its ceiling."""
    for name, item in limits.items():
        for wire, value in item.items():
            if checked(f"{name}.{wire}", value, source) < 0:
                raise InputError(f"{source}: tension limit {name}.{wire} is {value} N, below 0")
    for wire, low in limits.get("F_min", {}).items():
        if low > limits.get("F_max", {}).get(wire, math.inf):
            raise InputError(f"{source}: F_min.{wire} = {low} N exceeds F_max.{wire}")
    return limits


def write_robot(robot: Robot, path: str | Path, notes: str = "") -> None:
    """Writes what differs from the built-in robot, effects included, as a robot file that `load_robot` takes.

    InputError if it cannot be written; the file is whole or not there.
    """
    import yaml

    base = load_robot(robot.machine.name)
    numbers = {
        e.name: {"value": float(v), "unit": e.unit, "source": robot.sources.get(e.name, "")}
        for e, v, b in zip(robot.machine.entries, robot.values, base.values, strict=True)
        if e.neutral is None and v != b
    }
    effects = {
        identity: {name: values.get("", values) for name, values in present.items()}
        for identity, present in robot.effects().items()
    }
    parts = [p for p, (point, _, _) in VARIANTS.items() if point in robot.machine.variants]
    content = {"base": robot.machine.name, "numbers": numbers, "effects": effects, "parts": parts, "notes": notes}
    text = yaml.safe_dump({k: v for k, v in content.items() if v}, sort_keys=False)
    write_text(path, text)
