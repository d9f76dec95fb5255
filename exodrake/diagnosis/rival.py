"""A rival: an explanation still in play beside others, as the answer stores it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Rival:
    """An explanation still in play beside others.

    Attributes:
        effects: ids of its effects; none for the retuned robot.
        parameters: full name -> value [SI] of all parameters by which its robot differs from the nominal one.
    """

    effects: tuple[str, ...]
    parameters: dict[str, float]

    @property
    def name(self) -> str:
        """Ids joined by +; `retune` without an effect."""
        return " + ".join(self.effects) or "retune"
