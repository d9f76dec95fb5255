"""Parameters of a machine, and their tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from exodrake.core.signal import Axes


@dataclass(frozen=True)
class ParameterInfo:
    """A parameter: full name, SI unit, part that owns it, and null value if it is an effect's."""

    name: str
    unit: str
    part: str
    null: float | None = None


@dataclass(frozen=True)
class Tolerance:
    """Parameters that differ a little from one machine to the next of its kind.

    Attributes:
        parameters: patterns, each naming one parameter, or several that err together; {w} and {j} stand for every
            tendon and joint.
        transform: "relative" (times 1 + x), "additive" (plus x) or "log" (times exp x).
        prior_std: standard deviation of x.
        max_deviation: largest |x|; beyond it a parameter is not the nominal one any more.
    """

    parameters: tuple[str, ...]
    transform: str
    prior_std: float
    max_deviation: float

    def in_words(self, unit: str = "") -> str:
        """Standard deviation and largest deviation as text; unit: of the parameter, after a blank."""
        std, most = self.prior_std, self.max_deviation
        if self.transform == "relative":
            return f"±{100 * std:g} %, at most {100 * most:g} %"
        return f"±{std:g}{unit}, at most {most:g}" if self.transform == "additive" else f"factor e^±{std:g}"


def full_name(*words: str) -> str:
    """Words joined by dots, empty ones left out."""
    return ".".join(word for word in words if word)


def channels_of(name: str, names: Sequence[str]) -> list[int]:
    """Places of a parameter among full names: its own, else those of its channels; none of an unknown one."""
    if name in names:
        return [names.index(name)]
    return [i for i, full in enumerate(names) if full.rpartition(".")[0] == name]


def expanded(pattern: str, axes: Axes) -> list[str]:
    """The pattern for each tendon {w} or joint {j} that it names."""
    for mark, channels in (("{w}", axes.tendons), ("{j}", axes.joints)):
        if mark in pattern:
            return [pattern.replace(mark, channel) for channel in channels]
    return [pattern]
