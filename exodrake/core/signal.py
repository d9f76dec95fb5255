"""Signals between parts, and the channels that they run over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

WIRES, JOINTS, ONE = "wires", "joints", ""


@dataclass(frozen=True)
class Wire:
    """A named signal between parts: a Drake port and, where it has a log column, a column family."""

    name: str
    unit: str
    over: str


class Lanes(NamedTuple):
    """Names of a machine's wires and joints."""

    wires: tuple[str, ...]
    joints: tuple[str, ...]

    def of(self, over: str) -> tuple[str, ...]:
        """Lane names of `WIRES` or `JOINTS`; one empty name for `ONE`."""
        return {WIRES: self.wires, JOINTS: self.joints, ONE: ("",)}[over]
