"""A robot: a machine with its numbers; the same machine with other numbers, effects and parts."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from exodrake.core.effect import Effect
from exodrake.core.errors import InputError, nearest
from exodrake.core.machine import Machine
from exodrake.core.parameter import Tolerance

BUILT_IN = ("exo_index", "emps", "tendon_sheath", "so101", "dvrk_wrist")
MACHINES = {name: f"exodrake.machines.{name}.machine" for name in BUILT_IN}


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

    def channels(self, name: str) -> np.ndarray:
        """A parameter of all channels by its name without channel: (channels,) array [SI]."""
        return self.values[self.places(name)]

    def places(self, name: str) -> list[int]:
        """Places in the flat vector of a full name, or of all channels of a name without its channel."""
        index = self.machine.index
        if name in index:
            return [index[name]]
        found = [i for full, i in index.items() if full.rsplit(".", 1)[0] == name]
        if not found:
            raise InputError(f"{self.source or self.machine.name}: unknown number {name!r}{nearest(name, list(index))}")
        return found

    def with_parameters(self, parameters: Mapping[str, Any], source: str = "") -> Robot:
        """The robot with numbers changed: dotted or nested names to values [SI]; a name without channel sets all
        channels.
        """
        values, sources = self.values.copy(), dict(self.sources)
        for name, value in flatten(parameters):
            for i in self.places(name):
                values[i] = checked(name, value, source)
                if source:
                    sources[self.machine.parameters[i].name] = source
        return refuse_negative(replace(self, values=values, sources=sources))

    def splice(self, identity: str, parameters: Mapping[str, Any] | None = None, channels: Iterable[str] = ()) -> Robot:
        """The robot with an effect in it.

        Args:
            identity: the effect's id. numbers: parameters, each one value or one per channel; typical ones where left
            out. channels: wires or joints it sits on; all if empty.
        """
        effect = self.machine.effect(identity)
        given = dict(parameters or {})
        known = {n.name for n in effect.parameters}
        for name in given:
            if name not in known:
                raise InputError(f"{identity} has no parameter {name!r}{nearest(name, sorted(known))}")
        values = self.values.copy()
        wanted = check_channels(self.machine, effect, channels)
        for number in effect.parameters:
            value = given.get(number.name, number.initial)
            for channel in wanted:
                one = value.get(channel, number.null) if isinstance(value, Mapping) else value
                full = ".".join(part for part in (identity, number.name, channel if number.axis else "") if part)
                values[self.machine.index[full]] = checked(full, one, "effect")
        return replace(self, values=values)

    def effects(self) -> dict[str, dict[str, dict[str, float]]]:
        """Effects present: id -> parameter -> channel -> value ("" for a parameter without channels)."""
        present: dict[str, dict[str, dict[str, float]]] = {}
        for effect in self.machine.effects:
            first = effect.parameters[0]
            at = {channel: self.values[i] for channel, i in self.channel_indices(effect.id, first.name, first.axis)}
            if any(v != first.null for v in at.values()):
                present[effect.id] = {
                    n.name: {
                        channel: float(self.values[i]) for channel, i in self.channel_indices(effect.id, n.name, n.axis)
                    }
                    for n in effect.parameters
                }
        return present

    def channel_indices(self, group: str, name: str, axis: str) -> list[tuple[str, int]]:
        """Lane names and places of a number."""
        channels = self.machine.axes.of(axis)
        return [(channel, self.machine.index[".".join(p for p in (group, name, channel) if p)]) for channel in channels]

    def with_part(self, page: str) -> Robot:
        """The robot with a variant part, e.g. `controller_as_printed`; InputError for an unknown one."""
        return replace(self, machine=vary(self.machine, page))


def refuse_negative(robot: Robot) -> Robot:
    """The robot itself. InputError for a quantity below 0 whose plausible range lies above it, such as a length."""
    for name, (low, _) in robot.ranges.items():
        parameter = robot.machine.parameters[robot.machine.index[name]]
        if low > 0 > robot[name] and parameter.unit != "rad":
            raise InputError(f"{robot.source}: {name} = {robot[name]:g} {parameter.unit}, below 0")
    return robot


VARIANTS = {
    "controller_as_printed": ("controller.damping", "exodrake.systems.controller_as_printed", "damping"),
    "routers_as_printed": ("routers.applied_arm", "exodrake.systems.routers_as_printed", "applied_arm"),
}


@cache
def vary_cached(name: str, tolerances: tuple[Tolerance, ...], pages: tuple[str, ...]) -> Machine:
    """A machine with variant parts; the same object each time, so that it is composed once."""
    machine = machine_of(MACHINES[name], tolerances)
    variants = {VARIANTS[p][0]: getattr(import_module(VARIANTS[p][1]), VARIANTS[p][2]) for p in pages}
    return replace(machine, variants=variants)


@cache
def machine_of(module: str, tolerances: tuple[Tolerance, ...]) -> Machine:
    """The machine of a page, with what scatters in it; the same object each time."""
    name = module.removesuffix(".machine").rsplit(".", 1)[-1]
    return replace(getattr(import_module(module), name)(), tolerances=tolerances)


def vary(machine: Machine, page: str) -> Machine:
    """The machine with one more variant part."""
    if page not in VARIANTS:
        raise InputError(f"unknown part {page!r}{nearest(page, list(VARIANTS))}; there are {', '.join(VARIANTS)}")
    present = {p for p, (point, _, _) in VARIANTS.items() if point in machine.variants}
    return vary_cached(machine.name, machine.tolerances, tuple(sorted(present | {page})))


def flatten(parameters: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Nested mappings as dotted names; a mapping with a `value` key counts as that value."""
    found = []
    for key, value in parameters.items():
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


def check_channels(machine: Machine, effect: Effect, channels: Iterable[str]) -> tuple[str, ...]:
    """Lanes an effect shall sit on; InputError naming an unknown one."""
    known, wanted = machine.axes.of(effect.axis), tuple(channels)
    for channel in wanted:
        if channel not in known:
            channels = ", ".join(filter(None, known)) or "no channels"
            raise InputError(f"{effect.id} does not sit on {channel!r}; it knows {channels}")
    return wanted or known
