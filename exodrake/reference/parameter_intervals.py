"""Quality of the 90 % intervals of effect parameters: coverage, width and interval score.

Interval score of (l, u) for the true value x at level 1 - alpha (Gneiting & Raftery 2007, eq. 43), smaller is better:

    S = u - l + 2 / alpha (l - x) [x < l] + 2 / alpha (x - u) [x > u]
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from exodrake.reference.answers import Answered
from exodrake.reference.catalogue import ENTRIES
from exodrake.reference.matching import Diagnosis, Truth, causes_of

ALPHA = 0.1  # of a 90 % interval


def interval_score(low: float, high: float, true: float, alpha: float = ALPHA) -> float:
    """Interval score in the unit of the parameter."""
    return high - low + 2 / alpha * (max(low - true, 0.0) + max(true - high, 0.0))


@dataclass(frozen=True)
class ParameterInterval:
    """A stated 90 % interval beside the true value.

    Attributes:
        key: Case, effect, parameter, and channel or None.
        exact: Whether the parameter means the same in the law of the reference simulator.
        low: Lower end.
        high: Upper end.
        true: True value.
        scale: Magnitude of the parameter.
    """

    key: tuple[str, str, str, str | None]
    exact: bool
    low: float
    high: float
    true: float
    scale: float

    @property
    def covers(self) -> bool:
        """Whether the interval holds the true value."""
        return self.low <= self.true <= self.high

    @property
    def half_width(self) -> float:
        """Half width relative to the parameter."""
        return (self.high - self.low) / 2 / self.scale

    @property
    def score(self) -> float:
        """Interval score relative to the parameter."""
        return interval_score(self.low, self.high, self.true) / self.scale


def intervals_of(case: Answered) -> Iterator[ParameterInterval]:
    """Stated intervals of the effects that are named by their true id."""
    for truth in case.truths:
        for name, true in truth["parameters"].items():
            for channel, bounds in stated(name, truth, case.diagnosis):
                low, high = bounds.get("low"), bounds.get("high")
                if low is not None and high is not None:
                    key, scale = (case.name, truth["id"], name, channel), scale_of(truth["id"], name, true)
                    yield ParameterInterval(key, bool(truth["exact"]), low, high, true, scale)


def stated(name: str, truth: Truth, diagnosis: Diagnosis) -> Iterator[tuple[str | None, dict[str, Any]]]:
    """Channel and interval of a parameter, for the channels of the truth; without channels the overall interval."""
    for effect in causes_of(diagnosis):
        if effect["id"] != truth["id"]:
            continue
        channels = (effect.get("channels") or {}).get(name)
        seat = (*truth["wires"], *truth["joints"])
        if channels:
            yield from ((channel, bounds) for channel, bounds in channels.items() if not seat or channel in seat)
        elif overall := (effect.get("parameters") or {}).get(name):
            yield None, overall


def scale_of(effect_id: str, name: str, true: float) -> float:
    """Magnitude of a parameter: the true value, or the bound of the drawn range where this goes through zero."""
    ranges = ENTRIES[effect_id].ranges if effect_id in ENTRIES else {}
    low, high = ranges.get(name, (0.0, 0.0))
    return max(abs(true), -low, high) if low < 0 else abs(true)
