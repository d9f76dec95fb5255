"""Rules by which an answer counts as the truth, and the classes of effects that no log can tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import Any

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


def named_ids(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Ids of the effects named, best first."""
    return tuple(effect["id"] for effect in diagnosis.get("effects") or ())


def first_ids(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Ids of the set that comes first, whatever the verdict: what is named, else the best candidate."""
    candidates = diagnosis.get("candidates") or ()
    return named_ids(diagnosis) or (tuple(candidates[0]["id"].split(" + ")) if candidates else ())


def found_ids(diagnosis: Diagnosis) -> set[str]:
    """All ids named, the class of an AMBIGUOUS verdict included."""
    return {*named_ids(diagnosis), *(i for name in diagnosis.get("equivalents") or () for i in name.split(" + "))}


def is_truth(truths: Sequence[Truth], ids: Sequence[str]) -> bool:
    """Tell whether a set of effects is the true one: an accepted id for each true effect, and nothing else."""
    return len(ids) == len(truths) and any(
        all(name in accepted_ids(truth) for truth, name in zip(truths, order)) for order in permutations(ids)
    )
