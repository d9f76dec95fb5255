"""The parameters of a robot as its file states them: value, unit, plausible range, tolerance, source."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from exodrake.core.display import in_words
from exodrake.core.parameter import Tolerance, expanded
from exodrake.core.text import short_repr
from exodrake.core.units import UNITS, conversion, to_si

if TYPE_CHECKING:
    from exodrake.core.robot import Robot

# units that people have in mind when they give a bare number, likely ones first
MEANT = ("mm", "deg", "ms", "mN", "mA", "g", "mW", "kHz", "%", "cm", "um", "us", "kN", "kgf", "gf", "rev", "min", "mV")


@short_repr
@dataclass(frozen=True)
class StatedParameter:
    """A parameter of a robot.

    Attributes:
        name: full name, with its channel if it has one.
        value: [unit].
        unit: SI unit.
        low: lower end of the plausible range [unit]; -inf if none is stated.
        high: upper end [unit]; inf if none is stated.
        tolerance: how much it differs from one such robot to the next; None if it does not.
        source: where the value comes from.
        effect: id of the effect that it belongs to; empty for a parameter of the nominal robot.
    """

    name: str
    value: float
    unit: str
    low: float = -math.inf
    high: float = math.inf
    tolerance: Tolerance | None = None
    source: str = ""
    effect: str = ""

    @property
    def plausible(self) -> bool:
        """Whether the value lies in its range."""
        return self.low <= self.value <= self.high

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


def stated_parameters(robot: Robot) -> dict[str, StatedParameter]:
    """Parameters of the nominal robot, then those of the effects in it, by full name."""
    machine = robot.machine
    tolerances = {
        name: tolerance
        for tolerance in machine.tolerances
        for pattern in tolerance.parameters
        for names in expanded(pattern, machine.axes)
        for name in names.split()
    }
    found = {
        p.name: StatedParameter(
            p.name, robot[p.name], p.unit, *robot.ranges.get(p.name, (-math.inf, math.inf)),
            tolerances.get(p.name), robot.sources.get(p.name, ""),
        )
        for p in machine.parameters if p.null is None
    }  # fmt: skip
    for identity in robot.effects():
        effect = machine.effect(identity)
        for p in effect.parameters:
            for i in robot.machine.effect_indices(identity, p.name).values():
                name, value = machine.parameters[i].name, float(robot.values[i])
                low, high = (p.low, p.high) if value != p.null else (-math.inf, math.inf)
                found[name] = StatedParameter(name, value, p.unit, low, high, None, effect.source, identity)
    return found


def alike(robot: Robot) -> Iterator[tuple[str, tuple[str, ...], StatedParameter]]:
    """Parameters in rows: name without channel, the channels of this value (() if it has none), and one of them."""
    known = (*robot.machine.axes.tendons, *robot.machine.axes.joints)
    rows: dict[tuple, tuple[list[str], StatedParameter]] = {}
    for one in stated_parameters(robot).values():
        name, _, channel = one.name.rpartition(".")
        own = channel in known
        key = (name if own else one.name, one.value, one.low, one.high, one.source)
        rows.setdefault(key, ([], one))[0].extend([channel] * own)
    for (name, *_), (channels, one) in rows.items():
        yield name, tuple(channels), one


def effect_in_words(robot: Robot, identity: str) -> str:
    """An effect with its values and channels: `tendon.slack: length 2 mm on AF, MF`."""
    effect = robot.machine.effect(identity)
    values = robot.effect_values(effect)
    first = effect.parameters[0]
    seats = [channel for channel, value in values[first.name].items() if value != first.null]
    said = []
    for p in effect.parameters:
        at: dict[float, list[str]] = {}
        for channel in seats if p.axis == effect.axis else values[p.name]:
            at.setdefault(values[p.name][channel], []).append(channel)
        said += [
            f"{p.name} {in_words(value, p.unit)}" + (f" ({', '.join(channels)})" if len(at) > 1 else "")
            for value, channels in at.items()
        ]
    on = f" on {', '.join(seats)}" if effect.axis else ""
    return f"{identity}: {', '.join(said)}{on}"


def implausible(robot: Robot) -> list[str]:
    """A sentence for each parameter outside its plausible range, with the unit that may have been meant."""
    found = []
    for name, channels, one in alike(robot):
        if not one.plausible:
            words, at = one.texts, f" ({', '.join(channels)})" if channels else ""
            meant = meant_unit(one)
            hint = f"; did you mean {one.value:g} {meant}?" if meant else ""
            found.append(f"{name}{at} = {words['value']} lies outside {words['range']}{hint}")
    return found


def meant_unit(parameter: StatedParameter) -> str:
    """A unit in which the parameter's number would lie in its range; empty if there is none."""
    units = (unit for symbol in MEANT for unit in replaced(parameter.unit, UNITS[symbol][0], symbol))
    return next((u for u in units if parameter.low <= to_si(parameter.value, u) <= parameter.high), "")


def replaced(unit: str, si: str, symbol: str) -> list[str]:
    """The unit with each occurrence of a symbol replaced, where that is a unit: ("N/m", "m", "mm") -> ["N/mm"]."""
    places = [found.span() for found in re.finditer(rf"(?<![A-Za-z]){re.escape(si)}(?![A-Za-z])", unit)]
    units = [unit[:start] + symbol + unit[end:] for start, end in places]
    return [one for one in units if conversion(one)]
