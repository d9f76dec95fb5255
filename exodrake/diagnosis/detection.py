"""What a detector found: an effect that shows in a log before any fit."""

from __future__ import annotations

from dataclasses import dataclass

from exodrake.diagnosis.result import NamedEffect


@dataclass(frozen=True)
class Detection:
    """An effect that a detector found.

    Attributes:
        effect: effect as the answer states it.
        values: parameter name -> value [SI] that all further robots have; none for an effect that remains a candidate
            of the fits.
        reason: how it was found, in one sentence.
    """

    effect: NamedEffect
    values: dict[str, float]
    reason: str

    @property
    def certain(self) -> bool:
        """Whether the effect is there, whatever a fit finds."""
        return bool(self.values)
