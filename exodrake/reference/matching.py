"""Rules by which an answer counts as the truth, and the classes of effects that no log can tell apart.

Causes are what counts. Answers of older versions state no `role`: all their effects are causes, and `equivalents` is
the class of the whole set.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import permutations
from typing import Any

from exodrake.diagnosis.result import CAUSE
from exodrake.diagnosis.search import kind_of
from exodrake.machines.robot_file import load_robot

Truth = dict[str, Any]  # one true effect, as the labels give it
Diagnosis = dict[str, Any]  # an answer, as its JSON gives it


def accepted_ids(truth: Truth) -> set[str]:
    """Ids that count as right for a true effect: itself and what is provably inseparable from it.

    A slack wire and a negative homing offset give the same log (effects.md, "Not separable"). A wire that is softer
    than nominal, which stands for a compliance, is a parameter and has no id.
    """
    name = truth["id"]
    if name == "tendon.slack":
        return {name, "encoder.homing_offset"}
    if name == "encoder.homing_offset" and truth["parameters"]["offset"] < 0:
        return {name, "tendon.slack"}
    return {name}


def accepted_blocks(truth: Truth) -> set[str]:
    """Blocks that count as right for a true effect; none where old labels do not say where an outside fault acts."""
    return {*truth.get("blocks", ()), *(name.split(".")[0] for name in accepted_ids(truth))} - {"outside"}


def causes_of(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Effects that an answer calls causes, best first."""
    return [e for e in diagnosis.get("effects") or () if (e.get("role") or CAUSE) == CAUSE]


def rivals_of(cause: dict[str, Any]) -> tuple[str, ...]:
    """Ids of the rivals of a cause."""
    return tuple(rival["id"] for rival in cause.get("rivals") or ())


def named_ids(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Ids of the causes, best first."""
    return tuple(cause["id"] for cause in causes_of(diagnosis))


def first_ids(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Ids of the set that comes first, whatever the verdict: the causes, else the best fitted set with an effect."""
    sets = (one["id"] for one in diagnosis.get("candidates") or () if one["id"] not in ("", "retune"))
    return named_ids(diagnosis) or tuple(next(sets, "").split(" + "))


def found_ids(diagnosis: Diagnosis) -> set[str]:
    """Ids of all causes and of their rivals."""
    equivalents = (i for name in diagnosis.get("equivalents") or () for i in name.split(" + "))
    return {*named_ids(diagnosis), *equivalents, *(i for cause in causes_of(diagnosis) for i in rivals_of(cause))}


def is_in_class(truths: Sequence[Truth], diagnosis: Diagnosis) -> bool:
    """Tell whether each true effect is a cause of its own, or among the rivals of one."""
    causes = causes_of(diagnosis)
    if diagnosis.get("equivalents") and not any(map(rivals_of, causes)):  # an older version
        return all(accepted_ids(truth) & found_ids(diagnosis) for truth in truths)
    classes = [{cause["id"], *rivals_of(cause)} for cause in causes]
    return any(
        all(accepted_ids(truth) & one for truth, one in zip(truths, order))
        for order in permutations(classes, len(truths))
    )


@cache
def kinds() -> dict[str, str]:
    """Kind of each effect of the library by its id."""
    return {effect.id: kind_of(effect) for effect in load_robot().machine.effects}


def kind_and_block(identity: str) -> tuple[str, str]:
    """Kind of an effect by its id, and its block."""
    return kinds().get(identity, identity), identity.split(".")[0]


def is_kind_right(truths: Sequence[Truth], diagnosis: Diagnosis) -> bool:
    """Tell whether the causes are of the kinds and in the blocks of the true effects, whatever their laws.

    A cause whose rivals are of another kind or block states none.
    """
    stated = []
    for cause in causes_of(diagnosis):
        found = {kind_and_block(i) for i in (cause["id"], *rivals_of(cause))}
        stated.append(found.pop() if len(found) == 1 else None)
    right = [{kind_and_block(i) for i in accepted_ids(truth)} for truth in truths]
    return len(stated) == len(right) and any(
        all(one in accepted for one, accepted in zip(order, right)) for order in permutations(stated)
    )


def is_truth(truths: Sequence[Truth], ids: Sequence[str]) -> bool:
    """Tell whether a set of effects is the true one: an accepted id for each true effect, and nothing else."""
    return len(ids) == len(truths) and any(
        all(name in accepted_ids(truth) for truth, name in zip(truths, order)) for order in permutations(ids)
    )
