"""Hypotheses as a fit sees them: a vector u for the parameters of one or more effects, and its way to a robot's flat
numbers.

An effect's first number has one entry per channel, its other numbers one entry for all channels. u = 0 is where the
first number is neutral: u = value - neutral, log(value / neutral) for a factor, or 1 / value for a stiffness; a further
number has u = log(value) or value, as its `scale` says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.machine import Machine

REACH = 2.0  # a fit may go this far beyond the plausible range [factor]: assumed


@dataclass(frozen=True)
class Coordinate:
    """One entry of u: the effect's number at some channels."""

    effect: str
    number: EffectParameter
    channels: tuple[str, ...]
    places: tuple[int, ...]
    first: bool

    def value(self, u: float) -> float:
        """The number's value [its unit]."""
        if self.number.transform == "reciprocal":
            return math.inf if u <= 0.0 else 1.0 / u
        if self.number.transform == "log":
            return math.exp(u) * self.origin
        return u + self.number.null if self.first else u

    def at(self, value: float) -> float:
        """u of a value."""
        if self.number.transform == "reciprocal":
            return 0.0 if math.isinf(value) else 1.0 / value
        if self.number.transform == "log":
            return math.log(value / self.origin)
        return value - self.number.null if self.first else value

    @property
    def origin(self) -> float:
        """Value of a logarithmic number at u = 0: neutral for a factor."""
        return self.number.null if self.first else 1.0

    @property
    def bounds(self) -> tuple[float, float]:
        """Range of u in a fit: what is plausible, and a period to spare on both sides where a number comes round."""
        low, high = self.plausible
        return low - self.number.period, high + self.number.period

    @property
    def plausible(self) -> tuple[float, float]:
        """Plausible range of u, stretched by REACH, neutral included for a first number."""
        ends = sorted((self.at(self.number.low), self.at(self.number.high)))
        if not self.first and self.number.transform == "log":
            return ends[0] - math.log(REACH), ends[1] + math.log(REACH)
        if not self.first:
            return ends[0], ends[1]
        if self.number.transform == "log":
            return min(0.0, ends[0] - math.log(REACH)), ends[1] + math.log(REACH) if ends[1] > 0.0 else 0.0
        return min(0.0, ends[0] * REACH), max(0.0, ends[1] * REACH)

    @property
    def scale(self) -> float:
        """A plausible amount of u, never 0: what a fit takes for one unit."""
        low, high = self.plausible
        return 0.5 * max(abs(low), abs(high)) / REACH if self.first else 0.25 * (high - low)

    @property
    def start(self) -> float:
        """u to start from."""
        return self.at(self.number.initial)


@dataclass(frozen=True)
class Hypothesis:
    """Effects that may be present, with a coordinate for each free parameter; `held`: numbers that are set but not
    fitted.
    """

    effects: tuple[str, ...]
    coordinates: tuple[Coordinate, ...]
    held: tuple[tuple[int, float], ...] = field(default=())

    @property
    def name(self) -> str:
        """Ids joined by +."""
        return " + ".join(self.effects)

    def apply(self, values: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Flat numbers (n,) with the effects at u (coordinates,) in them."""
        out = values.copy()
        for place, value in self.held:
            out[place] = value
        for coordinate, amount in zip(self.coordinates, u, strict=True):
            for place in coordinate.places:
                out[place] = coordinate.value(amount)
        return out

    @property
    def start(self) -> np.ndarray:
        """Typical u (coordinates,)."""
        return np.array([k.start for k in self.coordinates])

    @property
    def bounds(self) -> np.ndarray:
        """(coordinates, 2)."""
        return np.array([k.bounds for k in self.coordinates]).reshape(-1, 2)

    @property
    def scales(self) -> np.ndarray:
        """(coordinates,)."""
        return np.array([k.scale for k in self.coordinates])

    def joined(self, other: Hypothesis) -> Hypothesis:
        """Both sets of effects."""
        return Hypothesis(self.effects + other.effects, self.coordinates + other.coordinates, self.held + other.held)


NOTHING = Hypothesis((), ())


def hypothesis(machine: Machine, effect: Effect, channels: Sequence[str] = ()) -> Hypothesis:
    """One effect with a first number per channel (those of `channels`, or all) and common further numbers."""
    wanted = tuple(channels) or machine.axes.of(effect.axis)
    coordinates, held = [], []
    for k, number in enumerate(effect.parameters):
        axis = machine.axes.of(number.axis)
        here = [channel for channel in axis if channel in wanted] if number.axis else [""]
        at = {channel: machine.index[".".join(p for p in (effect.id, number.name, channel) if p)] for channel in here}
        if not number.fitted:
            held += [(place, number.initial) for place in at.values()]
        elif k == 0 or free_first(effect) is number:
            coordinates += [
                Coordinate(effect.id, number, (channel,), (place,), k == 0) for channel, place in at.items()
            ]
        else:
            coordinates.append(Coordinate(effect.id, number, tuple(here), tuple(at.values()), False))
    return Hypothesis((effect.id,), tuple(coordinates), tuple(held))


def free_first(effect: Effect) -> EffectParameter | None:
    """The first number that a fit may move."""
    return next((n for n in effect.parameters if n.fitted), None)
