"""Small errors of the nominal numbers, which every hypothesis may have: one coordinate for each number or set of
numbers that errs together.

A coordinate multiplies its numbers by 1 + x, adds x, or multiplies by exp(x) a number that is known in order of
magnitude only; x has the standard deviation `spread`, and a retune may use up to `limit`. Which numbers scatter, and
how much, is said in the robot file.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError, nearest
from exodrake.core.machine import Machine

RELATIVE, ADDITIVE = "relative", "additive"


@dataclass(frozen=True)
class Coordinate:
    """Places in the flat numbers that move together: `transform` is RELATIVE (1 + x), ADDITIVE (+ x) or log (exp x)."""

    name: str
    places: tuple[int, ...]
    transform: str
    prior_std: float
    max_deviation: float


def coordinates(machine: Machine) -> tuple[Coordinate, ...]:
    """All coordinates of a machine: its robot file's `tolerances`."""
    return tuple(
        make(machine, name, group.transform, group.prior_std, group.max_deviation)
        for group in machine.tolerances
        for pattern in group.parameters
        for name in expand(machine, pattern)
    )


def expand(machine: Machine, pattern: str) -> list[str]:
    """The pattern for each wire or joint that it names."""
    if "{w}" in pattern:
        return [pattern.replace("{w}", wire) for wire in machine.axes.tendons]
    if "{j}" in pattern:
        return [pattern.replace("{j}", joint) for joint in machine.axes.joints]
    return [pattern]


def make(machine: Machine, names: str, transform: str, prior_std: float, max_deviation: float) -> Coordinate:
    """A coordinate of the numbers in `names`."""
    for name in names.split():
        if name not in machine.index:
            raise InputError(f"{machine.name}: tolerances name {name!r}{nearest(name, list(machine.index))}")
    return Coordinate(names, tuple(machine.index[name] for name in names.split()), transform, prior_std, max_deviation)


def turned(values: np.ndarray, all_coordinates: tuple[Coordinate, ...], x: np.ndarray) -> np.ndarray:
    """Flat numbers with each coordinate at x (coordinates,)."""
    out = values.copy()
    for coordinate, amount in zip(all_coordinates, x, strict=True):
        if amount != 0.0:
            for place in coordinate.places:
                out[place] = moved(out[place], coordinate.transform, amount)
    return out


def moved(value: float, transform: str, amount: float) -> float:
    """A number after its coordinate was turned by `amount`."""
    if transform == ADDITIVE:
        return value + amount
    return value * (1.0 + amount if transform == RELATIVE else np.exp(amount))
