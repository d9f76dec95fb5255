"""An effect of the effect library on another machine: the same law at a point of the same form, under that machine's
name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from exodrake.core.effect import Effect, EffectParameter


def for_machine(
    effect: Effect, identity: str, points: Mapping[str, str] | None = None, **parameters: EffectParameter
) -> Effect:
    """The effect under another id. points: its point -> the machine's own; numbers: those with another range."""
    moved = dict(points or {})
    return replace(
        effect,
        id=identity,
        at={moved.get(point, point): function for point, function in effect.at.items()},
        parameters=tuple(parameters.get(n.name, n) for n in effect.parameters),
        advances=tuple(moved.get(point, point) for point in effect.advances),
    )
