"""Fitted parameters: coordinates that move entries of a robot's flat parameter vector.

    relative    value = base (1 + x)          additive     value = base + x
    log         value = base exp(x)           reciprocal   value = 1 / (base + x), infinite where that is 0

A nominal parameter has a normal prior, its tolerance; a parameter of an effect has a range. x = 0 is the nominal robot:
without the effect, or with as much of it as its robot file has.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from exodrake.model.effect import Effect
from exodrake.model.robot import Robot, list_tolerances, position

# of a scale, for difference quotients: a robot without noise and quantisation is smooth, and where parameters
# make up for each other, as lengths that grow together, a longer step shows curvature as a slope
STEP = 0.002
NONE = 1e-9  # of the largest reciprocal in range: a smaller one is rounding, its value infinite
RANGE_FACTOR = 2.0  # a fit may leave an effect's plausible range by this factor: assumed


@dataclass(frozen=True)
class Parameter:
    """One coordinate x of a fit."""

    name: str  # full names of the parameters that it moves, separated by blanks
    index: tuple[int, ...]  # their positions in the flat parameter vector
    transform: str  # `relative`, `additive`, `log` or `reciprocal`
    base: float  # value at x = 0 [unit of the parameter]; nominal parameters start from the values of the robot instead
    prior_std: float  # standard deviation of x; infinite for a parameter of an effect
    bounds: tuple[float, float]  # range of x
    effect: str = ""  # id of the effect that it belongs to; empty for a nominal parameter
    channels: tuple[str, ...] = ()  # tendons or joints that it acts on
    amplitude: bool = False  # whether x = 0 leaves its channels as the nominal robot has them
    absent: float = 0.0  # of an amplitude, x at which its channels are without the effect
    start: float = 0.0  # x at which a fit begins
    along: tuple[float, ...] = ()  # change of each position by x = 1 [its unit] where it moves several; else empty

    @property
    def scale(self) -> float:
        """A plausible size of x, above 0: the unit of difference quotients."""
        if not self.effect:
            return self.prior_std
        low, high = self.bounds
        return max(abs(low), abs(high)) / (2.0 * RANGE_FACTOR) if self.amplitude else 0.25 * (high - low)

    def value(self, x: float, base: float | None = None) -> float:
        """Value of the parameter at x [its unit]; base: value at x = 0, its own if None."""
        base = self.base if base is None else base
        if self.transform == "reciprocal":
            return math.inf if base + x <= NONE * self.bounds[1] else 1.0 / (base + x)
        if self.transform == "log":
            return base * math.exp(x)
        return base + x if self.transform == "additive" else base * (1.0 + x)

    def beside(self, present: float) -> Parameter:
        """The amplitude of an effect as a change of what the nominal robot has of it [unit of the parameter]."""
        x = self.coordinate(present)
        low, high = self.bounds[0] - x, self.bounds[1] - x
        start = self.start if self.start <= high or abs(low) < high else -self.start
        base = self.base + x if self.transform == "reciprocal" else present
        return replace(self, base=base, absent=-x, start=start, bounds=(min(low, start, 0.0), max(high, start, 0.0)))

    def coordinate(self, value: float) -> float:
        """Coordinate x of a value [unit of the parameter]."""
        if self.transform == "reciprocal":
            return (0.0 if math.isinf(value) else 1.0 / value) - self.base
        if self.transform == "log":
            return math.log(value / self.base)
        return value - self.base if self.transform == "additive" else value / self.base - 1.0


def apply(values: np.ndarray, parameters: Sequence[Parameter], x: np.ndarray) -> np.ndarray:
    """Flat parameter vector (n,) with each coordinate of x (parameters,) set in it."""
    out = values.copy()
    for parameter, coordinate in zip(parameters, x, strict=True):
        if parameter.along:
            out[list(parameter.index)] += coordinate * np.array(parameter.along)
            continue
        for i in parameter.index:
            out[i] = parameter.value(float(coordinate), None if parameter.effect else values[i])
    return out


def nominal_parameters(robot: Robot) -> tuple[Parameter, ...]:
    """One parameter for each tolerance of the robot file, but for what is relative to 0. InputError: unknown name."""
    machine, found = robot.machine, []
    for group, name in list_tolerances(machine):
        index = tuple(position(machine, part) for part in name.split())
        limit, base = group.max_deviation, float(robot.values[index[0]])
        if base or group.transform == "additive":
            found.append(Parameter(name, index, group.transform, base, group.prior_std, (-limit, limit)))
    return tuple(found)


def effect_parameters(robot: Robot, effect: Effect) -> tuple[Parameter, ...]:
    """The fitted parameters of an effect: an amplitude for each channel, and common further parameters.

    robot: the nominal one. Of an effect that it has, an amplitude is a change, and further ones begin where they are.
    """
    lead = next((p for p in effect.parameters if p.fitted), effect.parameters[0])
    found, present = [], robot.machine.has_effect(robot.values, effect)
    for k, info in enumerate(effect.parameters):
        if not info.fitted:
            continue
        index = robot.machine.effect_indices(effect.id, info.name)
        groups = [(channel,) for channel in index] if k == 0 or info is lead else [tuple(index)]
        transform, amplitude = {"linear": "additive"}.get(info.transform, info.transform), k == 0
        base = info.null if amplitude and transform != "reciprocal" else 1.0 if transform == "log" else 0.0
        name = f"{effect.id}.{info.name}"
        plain = Parameter(name, (), transform, base, math.inf, (0.0, 0.0), effect.id, amplitude=amplitude)
        low, high = sorted((plain.coordinate(info.low), plain.coordinate(info.high)))
        if transform == "log":
            low, high = low - math.log(RANGE_FACTOR), high + math.log(RANGE_FACTOR) * (high > 0.0 or not amplitude)
        elif amplitude:
            low, high = low * RANGE_FACTOR, high * RANGE_FACTOR
        if amplitude:  # 0 where the effect is absent
            low, high = min(0.0, low), max(0.0, high)
        bounds, start = (low - info.period, high + info.period), plain.coordinate(info.initial)
        for group in groups:
            one = replace(plain, index=tuple(index[c] for c in group), channels=group, bounds=bounds, start=start)
            here = float(robot.values[one.index[0]])
            if amplitude:
                one = one.beside(here)
            elif present:
                one = replace(one, start=min(max(one.coordinate(here), bounds[0]), bounds[1]))
            found.append(one)
    return tuple(found)
