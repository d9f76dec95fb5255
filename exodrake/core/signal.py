"""Signals between parts, and the channels that they run over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

TENDONS, JOINTS, SCALAR = "tendons", "joints", ""


@dataclass(frozen=True)
class Signal:
    """A named signal between parts: a Drake port and, where it has a log column, a column family."""

    name: str
    unit: str
    axis: str


class Axes(NamedTuple):
    """Names of a machine's tendons and joints."""

    tendons: tuple[str, ...]
    joints: tuple[str, ...]

    def of(self, axis: str) -> tuple[str, ...]:
        """Channel names of `TENDONS` or `JOINTS`; one empty name for `SCALAR`."""
        return {TENDONS: self.tendons, JOINTS: self.joints, SCALAR: ("",)}[axis]
