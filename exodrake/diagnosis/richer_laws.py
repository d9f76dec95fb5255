"""What an effect with a richer law takes up where a simpler one is there: how often it only fits the error of that law.

A richer law explains whatever a simpler one does, and a part of the error of that one's law besides. How large a part
depends on how reality differs from the simple law. So robots are simulated with the simple law and with other laws of
it that the library holds (`Effect.law_of`); of those the richer law takes up no larger share than the upper quantile.
Where the library holds none, a richer law never speaks against a simpler one whose law may be true (`levels`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from exodrake.core.effect import Effect
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.diagnosis.comparison import richer_law, taken_up
from exodrake.diagnosis.isolation import Isolation


def laws_of(machine: Machine, law: str) -> list[Effect]:
    """An effect and its other laws. Raises InputError for an unknown effect, or one without other laws."""
    found = [effect for effect in machine.effects if law in (effect.id, effect.law_of)]
    if law not in (effect.id for effect in found):
        raise InputError(f"{machine.name} has no effect {law}")
    if len(found) == 1:
        raise InputError(f"{machine.name} has no other law of {law}: what richer laws take up of it cannot be measured")
    return found


def taken_by_richer(found: Isolation, law: str) -> dict[str, float]:
    """Id of each single effect with a richer law -> share of what `law` leaves that it takes up.

    0 where it takes up no more than noise and the difference between two simulators let it; none if it was not fitted.
    """
    singles = found.tested[0] if found.tested else ()
    simple = next((t for t in singles if t.explanation.effects == (law,)), None)
    if simple is None:
        return {}
    rivals = [t.explanation for t in singles if richer_law(found.likelihood, t.explanation, simple.explanation)]
    return {
        e.name: 0.0 if e.name in simple.levels.no_better else taken_up(found.likelihood, simple.explanation, e)[1]
        for e in rivals
    }


def by_rival(records: Sequence[Mapping[str, float]]) -> dict[str, list[float]]:
    """Shares of all robots by the id of the richer effect."""
    names = dict.fromkeys(name for record in records for name in record)
    return {name: [record[name] for record in records if name in record] for name in names}
