"""Candidates: the effects that a diagnosis tries."""

from __future__ import annotations

from collections.abc import Sequence

from exodrake.core.errors import InputError
from exodrake.core.machine import Machine


def chosen(machine: Machine, only: Sequence[str] = (), without: Sequence[str] = ()) -> frozenset[str]:
    """Ids of the effects that a diagnosis shall try.

    Args:
        machine: machine whose effects they are.
        only: ids to try, also of effects that are `not_tried` by default; empty: the default ones.
        without: ids to leave out.

    Raises:
        InputError: for an unknown id, or where nothing is left.
    """
    named = {identity: machine.effect(identity) for identity in (*only, *without)}
    default = [effect.id for effect in machine.effects if not effect.not_tried]
    tried = frozenset(only or default) - set(without)
    if not tried:
        raise InputError(f"no effect is left to try without {', '.join(named)}")
    return tried
