"""A robot: a machine with its parameters; the same machine with other parameters, effects and variants.

`drawn_robot` draws one within the tolerances of its robot file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any

import numpy as np

from exodrake.core.errors import InputError, nearest, short_repr
from exodrake.model.display import in_words
from exodrake.model.effect import Effect
from exodrake.model.machine import Machine, Tolerance
from exodrake.model.units import UNITS, conversion, quantity, to_si

# units that people have in mind when they give a bare number, likely ones first
MEANT = ("mm", "deg", "ms", "mN", "mA", "g", "mW", "kHz", "%", "cm", "um", "us", "kN", "kgf", "gf", "rev", "min", "mV")


@short_repr
@dataclass(frozen=True)
class StatedParameter:
    """A parameter of a robot."""

    name: str  # full name, with its channel if it has one
    value: float  # [unit]
    unit: str  # SI unit
    low: float = -math.inf  # lower end of the plausible range [unit]; -inf if none is stated
    high: float = math.inf  # upper end [unit]; inf if none is stated
    tolerance: Tolerance | None = None  # how much it differs from one such robot to the next; None if it does not
    source: str = ""  # where the value comes from
    effect: str = ""  # id of the effect that it belongs to; empty for a parameter of the nominal robot

    @property
    def texts(self) -> dict[str, str]:
        """Value, range and tolerance as text with units."""
        unit = "" if self.unit == "-" else f" {self.unit}"
        bounded = math.isfinite(self.low) or math.isfinite(self.high)
        return {
            "value": f"{self.value:.6g}{unit}",
            "range": f"{self.low:g} to {self.high:g}{unit}" if bounded else "",
            "tolerance": self.tolerance.in_words(unit) if self.tolerance else "",
        }


def alike(robot: Robot) -> Iterator[tuple[str, tuple[str, ...], StatedParameter]]:
    """Parameters in rows: name without channel, the channels of this value (() if it has none), and one of them."""
    rows: dict[tuple, tuple[list[str], StatedParameter]] = {}
    for one in robot.parameters().values():
        name, _, channel = one.name.rpartition(".")
        own = any(channel in axis for axis in robot.machine.axes)
        key = (name if own else one.name, one.value, one.low, one.high, one.source)
        rows.setdefault(key, ([], one))[0].extend([channel] * own)
    yield from ((name, tuple(channels), one) for (name, *_), (channels, one) in rows.items())


def effect_in_words(robot: Robot, identity: str) -> str:
    """An effect with its values and channels: `tendon.slack: length 2 mm on AF, MF`."""
    effect = robot.machine.effect(identity)
    values, first, said = robot.effect_values(effect), effect.parameters[0], []
    seats = [channel for channel, value in values[first.name].items() if value != first.null]
    for p in effect.parameters:
        at: dict[float, list[str]] = {}
        for channel in seats if p.axis == effect.axis else values[p.name]:
            at.setdefault(values[p.name][channel], []).append(channel)
        for value, channels in at.items():
            said.append(f"{p.name} {in_words(value, p.unit)}" + (f" ({', '.join(channels)})" if len(at) > 1 else ""))
    on = f" on {', '.join(seats)}" if effect.axis else ""
    return f"{identity}: {', '.join(said)}{on}"


def implausible(robot: Robot) -> list[str]:
    """A sentence for each parameter outside its plausible range, with the unit that may have been meant."""
    found = []
    for name, channels, one in alike(robot):
        if not one.low <= one.value <= one.high and not one.source.startswith("fitted to"):  # by a diagnosis
            words, at = one.texts, f" ({', '.join(channels)})" if channels else ""
            units = []  # with each occurrence of a symbol replaced, where that is a unit: N/m -> N/mm
            for symbol in MEANT:
                for place in re.finditer(rf"(?<![A-Za-z]){re.escape(UNITS[symbol][0])}(?![A-Za-z])", one.unit):
                    units.append(one.unit[: place.start()] + symbol + one.unit[place.end() :])
            meant = [u for u in units if conversion(u) and one.low <= to_si(one.value, u) <= one.high]
            hint = f"; did you mean {one.value:g} {meant[0]}?" if meant else ""
            found.append(f"{name}{at} = {words['value']} lies outside {words['range']}{hint}")
    return found


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A machine and its parameters.

    Attributes:
        machine: parts, signals, schedule.
        values: (n,) array, the flat parameter vector [SI], in the order of `machine.parameters`.
        sources: where each parameter comes from, by full name.
        ranges: plausible (low, high) of each parameter [SI], by full name.
        limits: limits of the references: name of the limit -> channel -> value [SI].
        grasps: reference targets: mode -> channel -> value [SI].
        source: the robot file's name, for messages.

    Examples:
        >>> import exodrake as exo
        >>> rusty = exo.load_robot().splice("tendon.capstan_friction", {"mu_phi": 0.3}, channels=["AF"])
        >>> rusty["tendon.capstan_friction.mu_phi.AF"]
        0.3
    """

    machine: Machine
    values: np.ndarray
    sources: dict[str, str] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    limits: dict[str, dict[str, float]] = field(default_factory=dict)
    grasps: dict[str, dict[str, float]] = field(default_factory=dict)
    source: str = ""

    def __repr__(self) -> str:
        there = ", ".join([*self.effects(), *self.machine.variant_names]) or "no effects"
        return f"Robot({self.machine.name} from {self.source or 'Python'}: {len(self.values)} parameters; {there})"

    def _repr_html_(self) -> str:
        return import_module("exodrake.report.notebook").robot_html(self)  # a room above this one

    def __getitem__(self, name: str) -> Any:
        """A parameter [SI] by its full name, `part.name` or `part.name.channel`; InputError with the nearest names.

        A name without its channel gives all channels: (channels,) array.
        """
        found = self.values[self.indices(name)]
        return float(found[0]) if name in self.machine.index else found

    def parameters(self) -> dict[str, StatedParameter]:
        """Value, unit, plausible range, tolerance and source of each parameter, and of the effects present, by name."""
        machine, free, found = self.machine, (-math.inf, math.inf), dict[str, StatedParameter]()
        tolerances = {name: group for group, names in list_tolerances(machine) for name in names.split()}
        for p in (p for p in machine.parameters if p.null is None):
            ends, source = self.ranges.get(p.name, free), self.sources.get(p.name, "")
            found[p.name] = StatedParameter(p.name, self[p.name], p.unit, *ends, tolerances.get(p.name), source)
        for identity in self.effects():
            effect = machine.effect(identity)
            for p in effect.parameters:
                for i in machine.effect_indices(identity, p.name).values():
                    name, value = machine.parameters[i].name, float(self.values[i])
                    low, high = (p.low, p.high) if value != p.null else free
                    source = self.sources.get(name) or effect.source
                    found[name] = StatedParameter(name, value, p.unit, low, high, None, source, identity)
        return found

    def channels(self, name: str) -> np.ndarray:
        """A parameter of all channels by its name without channel: (channels,) array [SI]."""
        return self.values[self.indices(name)]

    def indices(self, name: str) -> list[int]:
        """Indices in the flat vector of a full name, or of all channels of a name without channel."""
        found = self.machine.indices(name)
        if not found:
            where, full = self.source or self.machine.name, list(self.machine.index)
            groups = [one for one in dict.fromkeys(n.rpartition(".")[0] for n in full) if "." in one]
            raise InputError(f"{where}: unknown parameter {name!r}{nearest(name, groups + full)}")
        return found

    def general_first[*T](self, items: Iterable[tuple[str, *T]]) -> list[tuple[list[int], tuple[str, *T]]]:
        """Items that begin with a parameter's name, each with its indices; those of one channel come last, and hold."""
        found = [(self.indices(item[0]), item) for item in items]
        return sorted(found, key=lambda one: -len(one[0]))

    def to_json(self) -> dict[str, Any]:
        """Machine, variants, and each parameter with value, unit, range, tolerance and source."""
        return {
            "machine": self.machine.name, "source": self.source, "variants": self.machine.variant_names,
            "parameters": self.parameters(), "limits": self.limits, "grasps": self.grasps,
        }  # fmt: skip

    def with_parameters(self, parameters: Mapping[str, Any], source: str = "") -> Robot:
        """The robot with parameters changed.

        Args:
            parameters: values by dotted or nested names, numbers [SI] or text with a unit such as "2.5 N/mm"; a name
                without channel sets all channels that have no value of their own, in whatever order they come.
            source: where the values come from, for `sources` and messages.
        """
        values, sources = self.values.copy(), dict(self.sources)
        for indices, (name, value, stated) in self.general_first(flatten(parameters)):
            where, unit = f"{source or 'parameters'}: {name}", (stated or {}).get("unit", "")
            for info in (self.machine.parameters[i] for i in indices):
                values[self.machine.index[info.name]] = quantity(value, info.unit, where, unit)
                if source:
                    sources[info.name] = source
        return refuse_negative(replace(self, values=values, sources=sources))

    def splice(self, identity: str, parameters: Mapping[str, Any] | None = None, channels: Iterable[str] = ()) -> Robot:
        """The robot with an effect in it.

        Args:
            identity: the effect's id.
            parameters: the effect's parameters, each one value or one per channel, numbers [SI] or text with a unit;
                initial values where left out.
            channels: channels it sits on; all if empty.
        """
        effect, given = self.machine.effect(identity), dict(parameters or {})
        known = sorted(p.name for p in effect.parameters)
        for name in given:
            if name not in known:
                raise InputError(f"{identity} has no parameter {name!r}{nearest(name, known)}")
        values, wanted = self.values.copy(), check_channels(self.machine, effect, channels)
        for parameter in effect.parameters:
            value = given.get(parameter.name, parameter.initial)
            if isinstance(value, Mapping):
                check_channels(self.machine, effect, (channel for channel in value if channel))
            for channel, i in self.machine.effect_indices(identity, parameter.name).items():
                if channel in wanted or not parameter.axis:
                    one = value.get(channel, parameter.null) if isinstance(value, Mapping) else value
                    values[i] = quantity(one, parameter.unit, self.machine.parameters[i].name)
        return replace(self, values=values)

    def without_effects(self, some: Collection[str] | None = None) -> Robot:
        """The robot with effects at their null values: those with some ids, or every one."""
        gone = [e for e in self.machine.effects if some is None or e.id in some]
        values = self.values.copy()
        for effect, parameter in ((e, p) for e in gone for p in e.parameters):
            values[list(self.machine.effect_indices(effect.id, parameter.name).values())] = parameter.null
        return replace(self, values=values)

    def effects(self) -> dict[str, dict[str, dict[str, float]]]:
        """Effects present: id -> parameter -> channel -> value [SI] ("" for a parameter without channels)."""
        present = (e for e in self.machine.effects if self.machine.has_effect(self.values, e))
        return {effect.id: self.effect_values(effect) for effect in present}

    def effect_values(self, effect: Effect) -> dict[str, dict[str, float]]:
        """Parameters of an effect, present or not: parameter -> channel -> value [SI]."""
        return {
            p.name: {c: float(self.values[i]) for c, i in self.machine.effect_indices(effect.id, p.name).items()}
            for p in effect.parameters
        }

    def reference_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest reference, (channels,) arrays [SI]; without stated limits 0 and infinity."""
        channels = self.machine.channels(self.machine.references[0].signal)
        low, high = self.machine.reference_limits or ("", "")
        lowest, highest = self.limits.get(low, {}), self.limits.get(high, {})
        if high and (lacking := [channel for channel in channels if channel not in highest]):
            raise InputError(f"{self.source or self.machine.name}: no limit {high}.{lacking[0]}")
        return np.array([lowest.get(c, 0.0) for c in channels]), np.array([highest.get(c, math.inf) for c in channels])

    def with_part(self, name: str) -> Robot:
        """The robot with one more variant of a part; InputError with the machine's variants for an unknown one."""
        machine, known = self.machine, list(self.machine.variants_available)
        if name not in known:
            there = f"{machine.name} has {', '.join(known) or 'none'}"
            raise InputError(f"unknown part {name!r}{nearest(name, known)}; {there}")
        base = machine.nominal or machine
        chosen = tuple(n for n in known if n == name or n in machine.variant_names)
        if chosen not in base.machines:
            variants = dict(machine.variants_available[n] for n in chosen)
            base.machines[chosen] = replace(base, variants=variants, nominal=base)
        return replace(self, machine=base.machines[chosen])


def refuse_negative(robot: Robot) -> Robot:
    """The robot itself. InputError for a quantity below 0 whose plausible range lies above it, such as a length."""
    for name, (low, _) in robot.ranges.items():
        parameter = robot.machine.parameters[robot.machine.index[name]]
        if low > 0 > robot[name] and parameter.unit != "rad":
            raise InputError(f"{robot.source}: {name} = {robot[name]:g} {parameter.unit}, below 0")
    return robot


def flatten(parameters: Mapping[str, Any], prefix: str = "", stated: Any = None) -> list[tuple[str, Any, Any]]:
    """Nested mappings as dotted names, values, and the mapping that states a value under its key `value`, or None."""
    found = []
    for key, value in parameters.items():
        name, beside = f"{prefix}.{key}" if prefix else str(key), stated
        if isinstance(value, Mapping) and "value" in value:
            value, beside = value["value"], value
        found += flatten(value, name, beside) if isinstance(value, Mapping) else [(name, value, beside)]
    return found


def check_channels(machine: Machine, effect: Effect, channels: Iterable[str]) -> tuple[str, ...]:
    """Channels an effect shall sit on; InputError naming an unknown one."""
    known, wanted = machine.axes.of(effect.axis), tuple(channels)
    for channel in wanted:
        if channel not in known:
            channels = ", ".join(filter(None, known)) or "no channels"
            raise InputError(f"{effect.id} does not sit on {channel!r}; it knows {channels}")
    return wanted or known


def list_tolerances(machine: Machine) -> list[tuple[Tolerance, str]]:
    """Each tolerance with the names, between blanks, of parameters that err together; {w} and {j} filled in."""
    marks, found = {"{w}": machine.axes.tendons, "{j}": machine.axes.joints, "": ("",)}, []
    for group, pattern in ((one, pattern) for one in machine.tolerances for pattern in one.parameters):
        mark = next(mark for mark in marks if mark in pattern)
        found += [(group, pattern.replace(mark, channel)) for channel in marks[mark]]
    return found


def drawn_robot(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot with each parameter that has a tolerance drawn anew, normal and clipped to its largest deviation."""
    values, groups = robot.values.copy(), list_tolerances(robot.machine)
    for (group, names), drawn in zip(groups, rng.standard_normal(len(groups)), strict=True):
        x = float(np.clip(drawn * group.prior_std, -group.max_deviation, group.max_deviation))
        for i in (position(robot.machine, name) for name in names.split()):
            v = robot.values[i]
            values[i] = {"log": v * math.exp(x), "additive": v + x, "relative": v * (1.0 + x)}[group.transform]
    return replace(robot, values=values)


def drawn_deviation(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Deviations (parameters,) [SI] of a robot drawn by `drawn_robot` from the given one; 0 without a tolerance."""
    drawn = drawn_robot(robot, rng).values
    return np.subtract(drawn, robot.values, out=np.zeros(len(drawn)), where=drawn != robot.values)


def position(machine: Machine, name: str) -> int:
    """Position of a parameter in the flat vector. Raises InputError for an unknown name."""
    if name not in machine.index:
        raise InputError(f"{machine.name}: tolerance of {name!r}{nearest(name, list(machine.index))}")
    return machine.index[name]
