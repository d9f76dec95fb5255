"""The gap of a diagnosis: its location, and its closure signal by signal."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from exodrake.core.plain import plain


@dataclass(frozen=True)
class Interval:
    """A value with the ends of its 90 % interval.

    Attributes:
        value: estimate [unit].
        low: lower end of the interval [unit].
        high: upper end of the interval [unit].
        unit: SI unit.
    """

    value: float
    low: float
    high: float
    unit: str = "-"


@dataclass(frozen=True)
class Where:
    """Location of a gap.

    Attributes:
        block: block of the robot; `none` without a gap or where retuning suffices.
        wires: tendons that the gap affects.
        joints: joints that the gap affects.
        shares: block -> share of the gap that its effects take up; without named effects, the best one alone.
        regime: condition -> share of the residual's variance that it explains.
    """

    block: str
    wires: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    shares: dict[str, float] = field(default_factory=dict)
    regime: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SignalGap:
    """Gap of a signal on the judged logs.

    Attributes:
        before: RMS error of the nominal robot [unit].
        retuned: RMS error of the retuned robot [unit].
        after: RMS error of the improved robot [unit].
        noise_std: noise standard deviation [unit].
        closure: closure from the nominal to the improved robot.
        unit: unit of the signal.
    """

    before: float
    retuned: float
    after: float
    noise_std: float
    closure: float
    unit: str

    def to_json(self) -> dict[str, Any]:
        """The gap as plain data, the noise standard deviation as `floor`."""
        return plain({"floor" if name == "noise_std" else name: value for name, value in vars(self).items()})


@dataclass(frozen=True)
class Closure:
    """Closure over all signals with 90 % intervals, and signal by signal.

    Attributes:
        overall: from the nominal to the improved robot.
        retune: from the nominal to the retuned robot.
        effect: from the retuned to the improved robot; NaN where retuning leaves nothing.
        signals: column -> gap.
        measured_on: kinds of motion that it was measured on.
        motions: kind of fitted motion -> overall closure on it by the robot that was fitted to the other kinds.
    """

    overall: Interval
    retune: Interval
    effect: Interval
    signals: dict[str, SignalGap]
    measured_on: tuple[str, ...] = ()
    motions: dict[str, Interval] = field(default_factory=dict)

    @property
    def rms(self) -> dict[str, float]:
        """RMS error over all signals of the nominal, the retuned and the improved robot [noise_std]; 1 is noise."""
        names = ("before", "retuned", "after")
        squares = [[(getattr(gap, name) / gap.noise_std) ** 2 for gap in self.signals.values()] for name in names]
        return {name: float(np.sqrt(np.mean(s))) if s else float("nan") for name, s in zip(names, squares, strict=True)}
