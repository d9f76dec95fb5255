"""Parameters of a machine, and their tolerances."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ParameterInfo:
    """One number of a machine: full name, unit, block that owns it, and its neutral value if it is an effect's."""

    name: str
    unit: str
    part: str
    null: float | None = None


@dataclass(frozen=True)
class Tolerance:
    """Numbers that differ a little from one machine to the next of its kind.

    each: patterns, each naming one number, or several that err together; {w} and {j} stand for every wire and joint.
    how: "scales" (times 1 + x), "adds" (plus x) or "stretches" (times exp x). spread: standard deviation of x.
    limit: of x; beyond it a number is not the nominal one any more.
    """

    parameters: tuple[str, ...]
    transform: str
    prior_std: float
    max_deviation: float
