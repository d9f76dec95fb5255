"""Measures of the answers to a blind set: shares of cases, quantities, and trivial answers to compare with."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from exodrake.reference.answers import FAILURE, Answered
from exodrake.reference.matching import (
    accepted_blocks,
    accepted_ids,
    causes_of,
    first_ids,
    found_ids,
    is_in_class,
    is_kind_right,
    is_truth,
    named_ids,
    rivals_of,
)
from exodrake.reference.parameter_intervals import ParameterInterval, intervals_of
from exodrake.reference.shares import Share

NO_EFFECT = ("NO_GAP", "RETUNE")
LAWS = (("same meaning", True, "<= 0.03"), ("other law", False, "<= 0.2"))  # name, `exact`, wanted half width
NAMEABLE = {"single": ">= 90 %", "pair": ">= 80 %", "same-block": "", "three": ""}  # kind -> exactly named, wanted
CLOSED = 0.8  # closure that an effect's lower bound has to exceed


@dataclass(frozen=True)
class Quantity:
    """A quantity of so many cases; NaN for none."""

    name: str
    value: float
    count: int
    wanted: str = ""


def share(name: str, cases: Iterable[Answered], holds: Callable[[Answered], Any], wanted: str = "") -> Share:
    """Share of cases in which something holds."""
    return Share(name, {case.name: bool(holds(case)) for case in cases}, wanted)


def quantity(name: str, statistic: Callable[[Any], Any], values: Iterable[float | None], wanted: str = "") -> Quantity:
    """Statistic of the values that are known."""
    known = [value for value in values if value is not None]
    return Quantity(name, float(statistic(known)) if known else math.nan, len(known), wanted)


def exactly_named(case: Answered) -> bool:
    """The true effects are named and nothing else; a class of provably inseparable effects counts as one name."""
    inseparable = set().union(*map(accepted_ids, case.truths))
    alone = case.verdict == "NAMED" or (case.verdict == "AMBIGUOUS" and found_ids(case.diagnosis) <= inseparable)
    return alone and is_truth(case.truths, named_ids(case.diagnosis))


def in_class(case: Answered) -> bool:
    """Every true effect is a cause that is named, or a rival of one."""
    return case.verdict in ("NAMED", "AMBIGUOUS") and is_in_class(case.truths, case.diagnosis)


def kind_right(case: Answered) -> bool:
    """The causes are of the true kinds and in the true blocks, whatever their laws."""
    return case.verdict in ("NAMED", "AMBIGUOUS") and is_kind_right(case.truths, case.diagnosis)


def first(case: Answered) -> bool:
    """The true effects are the set that comes first, whatever the verdict."""
    return is_truth(case.truths, first_ids(case.diagnosis))


def names_too_much(case: Answered) -> bool:
    """An effect is named that is not among the true ones."""
    return not set(named_ids(case.diagnosis)) <= set().union(*map(accepted_ids, case.truths))


def right(case: Answered) -> bool:
    """The answer is right for the kind of case: no effect, UNKNOWN, or the truth named or in the class."""
    if case.kind == "healthy":
        return case.verdict in NO_EFFECT
    return case.verdict == "UNKNOWN" if case.kind == "unknown" else in_class(case)


def where(case: Answered, key: str) -> Any:
    """Entry of the localisation, or None."""
    return (case.diagnosis.get("where") or {}).get(key)


def blocks(case: Answered) -> set[str]:
    """Blocks in which the true effects act."""
    return set().union(*map(accepted_blocks, case.truths))


def channels(case: Answered, key: str) -> set[str]:
    """Wires or joints on which the true effects act."""
    return {channel for truth in case.truths for channel in truth[key]}


def closure(case: Answered, part: str, bound: str) -> float | None:
    """Bound of the closure of a part (overall, retune, effect), or None."""
    return ((case.diagnosis.get("closure") or {}).get(part) or {}).get(bound)


def visible(cases: Sequence[Answered], kinds: Iterable[str]) -> list[Answered]:
    """Cases of some kinds whose effects all leave a visible gap."""
    return [case for case in cases if case.kind in kinds and case.visible]


def intervals(cases: Sequence[Answered], exact: bool) -> list[ParameterInterval]:
    """Intervals stated for exactly named effects, of parameters of one kind."""
    named = filter(exactly_named, visible(cases, NAMEABLE))
    return [interval for case in named for interval in intervals_of(case) if interval.exact == exact]


def shares_of(cases: Sequence[Answered]) -> tuple[Share, ...]:
    """Measures that are shares of cases."""
    nameable, outside = visible(cases, NAMEABLE), visible(cases, ["unknown"])
    healthy = [case for case in cases if case.kind == "healthy"]
    named = [case for case in nameable if case.verdict == "NAMED"]
    closed = [case for case in named if (case.diagnosis.get("closure") or {}).get("effect") is not None]
    rows = [share(f"exactly named, {kind}", visible(cases, [kind]), exactly_named, NAMEABLE[kind]) for kind in NAMEABLE]
    rows += [share(f"truth named or in its class, {kind}", visible(cases, [kind]), in_class) for kind in NAMEABLE]
    rows += [share(f"kind and block right, {kind}", visible(cases, [kind]), kind_right) for kind in NAMEABLE]
    partly = [case for case in nameable if case.verdict == "PARTLY"]
    return (
        *rows,
        share("PARTLY, and its causes hold the truth", partly, lambda case: is_in_class(case.truths, case.diagnosis)),
        share("truth first", nameable, first, ">= 95 %"),
        share("UNKNOWN outside the library", outside, lambda case: case.verdict == "UNKNOWN", ">= 90 %"),
        share("not named outside the library", outside, lambda case: case.verdict in ("UNKNOWN", "PARTLY", *NO_EFFECT)),
        share("wrongly UNKNOWN", healthy + nameable, lambda case: case.verdict == "UNKNOWN", "<= 3 %"),
        share("false alarm on healthy", healthy, lambda case: case.verdict not in NO_EFFECT, "0-1 cases"),
        share("missed (NO_GAP or RETUNE) though visible", nameable, lambda case: case.verdict in NO_EFFECT),
        share("another effect named, or one too many", named, names_too_much),
        *localisation_of([case for case in nameable + outside if "where" in case.diagnosis or case.verdict == FAILURE]),
        share(
            f"C(effect given retune), lower bound > {CLOSED:g}",
            closed,
            lambda case: (closure(case, "effect", "low") or 0.0) > CLOSED,
            ">= 95 %",
        ),
        *(
            Share(f"90 % interval covers, {law}", {i.key: i.covers for i in intervals(cases, exact)}, "85-95 %")
            for law, exact, _ in LAWS
        ),
    )


def localisation_of(cases: Sequence[Answered]) -> list[Share]:
    """Shares of right blocks, tendons and joints, each of the cases whose label has any."""
    rows = [share("block right", filter(blocks, cases), lambda case: where(case, "block") in blocks(case), ">= 95 %")]
    for name, key in (("tendons right", "wires"), ("joints right", "joints")):
        rows.append(
            share(
                name,
                (case for case in cases if channels(case, key)),
                lambda case, key=key: set(where(case, key) or ()) == channels(case, key),
                ">= 95 %",
            )
        )
    return rows


def quantities_of(cases: Sequence[Answered]) -> tuple[Quantity, ...]:
    """Measures that are no shares."""
    answers = [case.diagnosis for case in cases]
    named = [case for case in visible(cases, NAMEABLE) if case.verdict == "NAMED"]
    sizes = [size for answer in answers if answer["verdict"] == "AMBIGUOUS" for size in class_sizes(answer)]
    rows = [quantity("size of an AMBIGUOUS class, mean", np.mean, sizes, "<= 2.2")]
    for label, part in (("C(overall)", "overall"), ("C(retune)", "retune"), ("C(effect given retune)", "effect")):
        rows.append(quantity(f"{label} when named, median", np.median, (closure(c, part, "value") for c in named)))
    for law, exact, wanted in LAWS:
        found = intervals(cases, exact)
        rows.append(quantity(f"relative half width, {law}, median", np.median, [i.half_width for i in found], wanted))
        rows.append(quantity(f"relative interval score, {law}, mean", np.mean, [i.score for i in found]))
    for name, key, middle, end in (
        ("simulated seconds a case", "simulated_seconds", "<= 60000", ""),
        ("seconds a case", "seconds", "<= 12", "<= 20"),
    ):
        values = [answer.get(key) for answer in answers]
        rows.append(quantity(f"{name}, median", np.median, values, middle))
        rows.append(quantity(f"{name}, 95 %", lambda known: np.percentile(known, 95), values, end))
    return tuple(rows)


def class_sizes(answer: dict[str, Any]) -> list[int]:
    """Sizes of the classes of the causes that have rivals; of an older answer that of its one class."""
    own = [1 + len(rivals_of(cause)) for cause in causes_of(answer) if rivals_of(cause)]
    return own or [len(set(answer.get("equivalents") or ()))]


def baselines_of(cases: Sequence[Answered]) -> tuple[Share, ...]:
    """Trivial answers to the visible cases with one effect, those that the diagnosis carries among them."""
    single = visible(cases, ["single"])
    names = sorted({name for case in single for name in case.diagnosis.get("baselines") or ()})
    carried = [
        share(f"{name} names the truth", single, lambda case, name=name: is_truth(case.truths, baseline(case, name)))
        for name in names
    ]
    rows = []
    for label, key in (("effect", "id"), ("block", "block")):
        values = [case.truths[0][key] for case in single]
        commonest = max(values, key=values.count, default="")
        rows.append(share(f"always the commonest {label}", single, lambda c, k=key, v=commonest: c.truths[0][k] == v))
    return (*rows, *carried)


def baseline(case: Answered, name: str) -> tuple[str, ...]:
    """Ids that a baseline names."""
    return tuple(((case.diagnosis.get("baselines") or {}).get(name) or "").split(" + "))
