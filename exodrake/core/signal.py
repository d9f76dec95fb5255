"""Signals between parts, and the channels that they run over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

TENDONS, JOINTS, SCALAR = "tendons", "joints", ""
NORMAL, UNIFORM = "standard normal", "uniform in 0 .. 1"


@dataclass(frozen=True)
class Signal:
    """A named signal between parts: a Drake port and, where it has a log column, a column family.

    `distribution` of a noise input: `NORMAL` or `UNIFORM`.
    """

    name: str
    unit: str
    axis: str
    distribution: str = ""


@dataclass(frozen=True)
class Delay:
    """How late the samples of a measured signal are, as the log shows them.

    Attributes:
        signal: the delay of each sample [s].
        noise_input: noise that is added to a sample after the delay.
        noise_std: parameter that scales this noise.
    """

    signal: str
    noise_input: str
    noise_std: str


class Axes(NamedTuple):
    """Names of a machine's tendons and joints."""

    tendons: tuple[str, ...]
    joints: tuple[str, ...]

    def of(self, axis: str) -> tuple[str, ...]:
        """Channel names of `TENDONS` or `JOINTS`; one empty name for `SCALAR`."""
        return {TENDONS: self.tendons, JOINTS: self.joints, SCALAR: ("",)}[axis]
