"""Scores of the answers to a blind set against its committed labels: measures, then tables, JSON and Markdown.

Causes are what counts; an effect without a `role` is one. Shares have exact binomial intervals and are compared in
pairs (McNemar 1947, exact test). Interval score of (l, u) for the true value x at level 1 - alpha (Gneiting & Raftery
2007, eq. 43), smaller is better:

    S = u - l + 2 / alpha (l - x) [x < l] + 2 / alpha (x - u) [x > u]
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain, permutations, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binomtest

from exodrake.core.confidence import binomial_interval
from exodrake.core.errors import markdown_table, plural
from exodrake.diagnosis.many import FAILURE
from exodrake.diagnosis.result import CAUSE
from exodrake.diagnosis.search import name_kind
from exodrake.machines.robot_file import load_robot
from exodrake.reference.answers import Answered, Diagnosis, Truth, read_answers, read_labels
from exodrake.reference.faults import ENTRIES

ALPHA = 0.1  # of a 90 % interval
NO_EFFECT = ("NO_GAP", "RETUNE")
LAWS = (("same meaning", True, "<= 0.03"), ("other law", False, "<= 0.2"))  # name, `exact`, wanted half width
NAMEABLE = {"single": ">= 92 %", "pair": ">= 75 %", "same-block": "", "three": ""}  # kind -> exactly named, wanted
CLOSED = 0.8  # closure that an effect's lower bound has to exceed


def accepted_ids(truth: Truth) -> set[str]:
    """Ids that count as right for a true effect: itself and what is provably inseparable from it.

    A slack wire and a negative homing offset give the same log (effects.md, "Not separable"). A wire that is softer
    than nominal, which stands for a compliance, is a parameter and has no id.
    """
    name = truth["id"]
    looser = name == "encoder.homing_offset" and truth["parameters"]["offset"] < 0
    return {"tendon.slack", "encoder.homing_offset"} if looser or name == "tendon.slack" else {name}


def list_causes(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Effects that an answer calls causes, best first."""
    return [effect for effect in diagnosis.get("effects") or () if (effect.get("role") or CAUSE) == CAUSE]


def list_classes(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Ids of each cause, best first, and of its rivals behind it."""
    return [(cause["id"], *(rival["id"] for rival in cause.get("rivals") or ())) for cause in list_causes(diagnosis)]


def named_ids(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Ids of the causes, best first."""
    return tuple(ids[0] for ids in list_classes(diagnosis))


def found_ids(diagnosis: Diagnosis) -> set[str]:
    """Ids of all causes and of their rivals."""
    return set(chain(*list_classes(diagnosis)))


def is_in_class(truths: Sequence[Truth], diagnosis: Diagnosis) -> bool:
    """Tell whether each true effect is a cause of its own, or among the rivals of one."""
    orders = permutations(list_classes(diagnosis), len(truths))
    return any(all(accepted_ids(truth) & set(ids) for truth, ids in zip(truths, order)) for order in orders)


@cache
def kind_and_block(identity: str) -> tuple[str, str]:
    """Kind of an effect by its id, and its block."""
    kinds = {effect.id: name_kind(effect) for effect in load_robot().machine.effects}
    return kinds.get(identity, identity), identity.split(".")[0]


def is_kind_right(truths: Sequence[Truth], diagnosis: Diagnosis) -> bool:
    """Tell whether the causes are of the kinds and in the blocks of the true effects, whatever their laws.

    A cause whose rivals are of another kind or block states none.
    """
    found = [set(map(kind_and_block, ids)) for ids in list_classes(diagnosis)]
    stated = [one.pop() if len(one) == 1 else None for one in found]
    return has_matching(stated, [set(map(kind_and_block, accepted_ids(truth))) for truth in truths])


def is_truth(truths: Sequence[Truth], ids: Sequence[str]) -> bool:
    """Tell whether a set of effects is the true one: an accepted id for each true effect, and nothing else."""
    return has_matching(ids, [accepted_ids(truth) for truth in truths])


def has_matching(stated: Sequence[Any], accepted: Sequence[set]) -> bool:
    """Tell whether each thing stated can stand for one set that accepts it, and none is left over."""
    return len(stated) == len(accepted) and any(
        all(one in wanted for one, wanted in zip(order, accepted)) for order in permutations(stated)
    )


def is_named_exactly(case: Answered) -> bool:
    """The true effects are named and nothing else; a class of provably inseparable effects counts as one name."""
    inseparable = set().union(*map(accepted_ids, case.truths))
    alone = case.verdict == "NAMED" or (case.verdict == "AMBIGUOUS" and found_ids(case.diagnosis) <= inseparable)
    return alone and is_truth(case.truths, named_ids(case.diagnosis))


def in_class(case: Answered) -> bool:
    """Every true effect is a cause that is named, or a rival of one."""
    return case.verdict in ("NAMED", "AMBIGUOUS") and is_in_class(case.truths, case.diagnosis)


def is_first(case: Answered) -> bool:
    """The truth comes first, whatever the verdict: among the causes, else in the best fitted set."""
    sets = (one["id"] for one in case.diagnosis.get("candidates") or () if one["id"] not in ("", "retune"))
    return is_truth(case.truths, named_ids(case.diagnosis) or tuple(next(sets, "").split(" + ")))


def blocks(case: Answered) -> set[str]:
    """Blocks in which the true effects act; none where old labels do not say where an outside fault acts."""
    ids = set().union(*map(accepted_ids, case.truths))
    stated = {block for truth in case.truths for block in truth.get("blocks", ())}
    return stated.union(name.split(".")[0] for name in ids) - {"outside"}


def closure(case: Answered, part: str, bound: str) -> float | None:
    """Bound of the closure of a part (overall, retune, effect), or None."""
    return ((case.diagnosis.get("closure") or {}).get(part) or {}).get(bound)


def select_visible(cases: Sequence[Answered], kinds: Iterable[str]) -> list[Answered]:
    """Cases of some kinds whose effects all leave a visible gap."""
    return [case for case in cases if case.kind in kinds and case.visible]


class ParameterInterval(NamedTuple):
    """A stated 90 % interval beside the true value."""

    key: tuple[str, str, str, str | None]  # Case, effect, parameter, and channel or None
    exact: bool  # Whether the parameter means the same in the law of the reference simulator
    covers: bool  # Whether the interval holds the true value
    half_width: float  # Relative to the parameter
    score: float  # Interval score relative to the parameter


def interval_score(low: float, high: float, true: float) -> float:
    """Interval score in the unit of the parameter."""
    return high - low + 2 / ALPHA * (max(low - true, 0.0) + max(true - high, 0.0))


def list_intervals(case: Answered) -> Iterator[ParameterInterval]:
    """Stated intervals of the effects that are named by their true id.

    They are those of the channels of the truth; of an effect without channels the overall one.
    """
    for truth in case.truths:
        seat = (*truth["wires"], *truth["joints"])
        named = [cause for cause in list_causes(case.diagnosis) if cause["id"] == truth["id"]]
        for (name, true), effect in product(truth["parameters"].items(), named):
            overall = (effect.get("parameters") or {}).get(name) or {}
            stated = (effect.get("channels") or {}).get(name) or {None: overall}
            for channel, bounds in stated.items():
                low, high = bounds.get("low"), bounds.get("high")
                if (channel is None or not seat or channel in seat) and low is not None and high is not None:
                    drawn = ENTRIES[truth["id"]].ranges if truth["id"] in ENTRIES else {}
                    least, most = drawn.get(name, (0.0, 0.0))
                    scale = max(abs(true), -least, most) if least < 0 else abs(true)  # of a range through zero its end
                    relative = (high - low) / 2 / scale, interval_score(low, high, true) / scale
                    key = case.name, truth["id"], name, channel
                    yield ParameterInterval(key, bool(truth["exact"]), low <= true <= high, *relative)


def intervals(cases: Sequence[Answered], exact: bool) -> list[ParameterInterval]:
    """Intervals stated for exactly named effects, of parameters of one kind."""
    named = filter(is_named_exactly, select_visible(cases, NAMEABLE))
    return [interval for case in named for interval in list_intervals(case) if interval.exact == exact]


class Share(NamedTuple):
    """Share of the cases in which something holds, with its exact 95 % interval; NaN for no cases."""

    outcomes: Mapping[Any, bool]  # Case, or part of one -> whether it holds
    wanted: str
    hits: int
    total: int
    value: float
    low: float
    high: float

    def to_json(self) -> dict[str, Any]:
        """All but the single outcomes."""
        return {name: value for name, value in self._asdict().items() if name != "outcomes"}


def count_share(outcomes: Mapping[Any, bool], wanted: str = "") -> Share:
    """Share of the outcomes that hold; `wanted`: the goal in words."""
    hits, total = sum(outcomes.values()), len(outcomes)
    interval = binomial_interval(hits, total)
    return Share(outcomes, wanted, hits, total, hits / total if total else math.nan, *interval)


class Quantity(NamedTuple):
    """A quantity of so many cases; NaN for none."""

    value: float
    cases: int
    wanted: str


class Paired(NamedTuple):
    """Two shares on the same cases: in how many both hold, only the first, only the second, neither."""

    both: int
    first: int
    second: int
    neither: int
    p: float  # two-sided, of equal shares: the cases in which one holds alone are a fair coin (McNemar)


def pair_shares(first: Share, second: Share) -> Paired:
    """Pair two shares on the cases that both count."""
    common = first.outcomes.keys() & second.outcomes
    count = Counter((first.outcomes[key], second.outcomes[key]) for key in common)
    both, one, other, neither = (count[cell] for cell in ((True, True), (True, False), (False, True), (False, False)))
    return Paired(both, one, other, neither, float(binomtest(one, one + other).pvalue) if one + other else 1.0)


def compute_shares(cases: Sequence[Answered]) -> dict[str, Share]:
    """Measures that are shares of cases, by name."""
    nameable, outside = select_visible(cases, NAMEABLE), select_visible(cases, ["unknown"])
    healthy = [case for case in cases if case.kind == "healthy"]
    named = [case for case in nameable if case.verdict == "NAMED"]
    closed = [case for case in named if (case.diagnosis.get("closure") or {}).get("effect") is not None]
    located = [case for case in nameable + outside if "where" in case.diagnosis or case.verdict == FAILURE]
    partly = [case for case in nameable if case.verdict == "PARTLY"]

    def seats(case: Answered, key: str) -> set[str]:
        return {seat for truth in case.truths for seat in truth[key]}

    def where(case: Answered) -> dict[str, Any]:
        return case.diagnosis.get("where") or {}

    tests = {
        "exactly named": is_named_exactly,
        "truth named or in its class": in_class,
        "kind and block right": lambda c: c.verdict in ("NAMED", "AMBIGUOUS") and is_kind_right(c.truths, c.diagnosis),
    }
    rows: list[tuple[str, Iterable[Answered], Callable[[Answered], Any], str]] = [
        (f"{name}, {kind}", select_visible(cases, [kind]), holds, goal if holds is is_named_exactly else "")
        for (name, holds), (kind, goal) in product(tests.items(), NAMEABLE.items())
    ]
    rows += [
        ("PARTLY, and its causes hold the truth", partly, lambda case: is_in_class(case.truths, case.diagnosis), ""),
        ("truth first", nameable, is_first, ">= 95 %"),
        ("UNKNOWN outside the library", outside, lambda case: case.verdict == "UNKNOWN", ">= 92 %"),
        ("not named outside the library", outside, lambda case: case.verdict in ("UNKNOWN", "PARTLY", *NO_EFFECT), ""),
        ("wrongly UNKNOWN", healthy + nameable, lambda case: case.verdict == "UNKNOWN", "<= 3 %"),
        ("false alarm on healthy", healthy, lambda case: case.verdict not in NO_EFFECT, "0-1 cases"),
        ("missed (NO_GAP or RETUNE) though visible", nameable, lambda case: case.verdict in NO_EFFECT, ""),
        ("another effect named, or one too many", named,
         lambda case: not set(named_ids(case.diagnosis)) <= set().union(*map(accepted_ids, case.truths)), ""),
        ("block right", filter(blocks, located), lambda case: where(case).get("block") in blocks(case), ">= 95 %"),
        ("tendons right", [case for case in located if seats(case, "wires")],
         lambda case: set(where(case).get("wires") or ()) == seats(case, "wires"), ">= 95 %"),
        ("joints right", [case for case in located if seats(case, "joints")],
         lambda case: set(where(case).get("joints") or ()) == seats(case, "joints"), ">= 95 %"),
        (f"C(effect given retune), lower bound > {CLOSED:g}", closed,
         lambda case: (closure(case, "effect", "low") or 0.0) > CLOSED, ">= 95 %"),
    ]  # fmt: skip
    shares = {name: count_share({c.name: bool(holds(c)) for c in some}, wanted) for name, some, holds, wanted in rows}
    for law, exact, _ in LAWS:
        covered = {interval.key: interval.covers for interval in intervals(cases, exact)}
        shares[f"90 % interval covers, {law}"] = count_share(covered, "85-95 %")
    return shares


def compute_quantities(cases: Sequence[Answered]) -> dict[str, Quantity]:
    """Measures that are no shares, by name."""
    answers = [case.diagnosis for case in cases]
    named = [case for case in select_visible(cases, NAMEABLE) if case.verdict == "NAMED"]
    ambiguous = (answer for answer in answers if answer["verdict"] == "AMBIGUOUS")
    sizes = [len(ids) for answer in ambiguous for ids in list_classes(answer) if len(ids) > 1]
    rows: list[tuple[str, Callable[[Any], Any], Iterable[float | None], str]] = [
        ("size of an AMBIGUOUS class, mean", np.mean, sizes, "<= 2.2")
    ]
    for label, part in (("C(overall)", "overall"), ("C(retune)", "retune"), ("C(effect given retune)", "effect")):
        rows.append((f"{label} when named, median", np.median, [closure(c, part, "value") for c in named], ""))
    for law, exact, wanted in LAWS:
        found = intervals(cases, exact)
        rows.append((f"relative half width, {law}, median", np.median, [i.half_width for i in found], wanted))
        rows.append((f"relative interval score, {law}, mean", np.mean, [i.score for i in found], ""))
    for name, key, middle, end in (
        ("simulated seconds a case", "simulated_seconds", "<= 60000", ""),
        ("seconds a case", "seconds", "<= 12", "<= 20"),
    ):
        values = [answer.get(key) for answer in answers]
        rows.append((f"{name}, median", np.median, values, middle))
        rows.append((f"{name}, 95 %", lambda known: np.percentile(known, 95), values, end))
    quantities = {}
    for name, statistic, values, wanted in rows:
        known = [value for value in values if value is not None]
        quantities[name] = Quantity(float(statistic(known)) if known else math.nan, len(known), wanted)
    return quantities


@dataclass(frozen=True)
class Measures:
    """Measures of the cases of one mix, by name."""

    cases: int  # How many there are
    shares: dict[str, Share]
    quantities: dict[str, Quantity]
    paired: dict[str, Paired]  # The shares of the diagnosis and of other answers


class Answers(NamedTuple):
    """Number of cases with the same truth and answer.

    Several effects are joined by +; an answer without a name is its verdict.
    """

    truth: str
    answer: str
    right: bool
    cases: int


@dataclass(frozen=True)
class Score:
    """Measures of a set; `to_dict` makes plain data of it, null for the value of no case."""

    mixes: dict[str, Measures]  # Measures of each mix
    confusion: list[Answers]
    missing: tuple[str, ...]  # Names of the cases without a diagnosis
    cases: int  # Number of cases that were answered, or failed
    failed: tuple[str, ...] = ()  # Names of those that failed


def score(folder: str | Path, labels: str | Path, against: str | Path | None = None) -> Score:
    """Score the answers in the folder of a set by its labels file, and compare them with those of another folder.

    InputError for labels that changed, a foreign case, a malformed diagnosis, or none at all.
    """
    truths = read_labels(Path(folder), Path(labels))
    cases = read_answers(Path(folder), truths)
    others = read_answers(Path(against), truths) if against else ()
    mixes, confusion = {}, Counter[tuple[str, str, bool]]()
    for mix in dict.fromkeys(case.mix for case in cases):
        here, there = ([case for case in answers if case.mix == mix] for answers in (cases, others))
        shares, theirs = compute_shares(here), compute_shares(there)
        paired = {name: pair_shares(one, theirs[name]) for name, one in shares.items() if there}
        mixes[mix] = Measures(len(here), shares, compute_quantities(here), paired)
    for case in cases:
        truth = " + ".join(effect["id"] for effect in case.truths) or "healthy"
        named = " + ".join(named_ids(case.diagnosis))
        answer = named if case.verdict in ("NAMED", "AMBIGUOUS") and named else case.verdict
        answer = f"PARTLY: {named}" if case.verdict == "PARTLY" else answer
        wanted = {"healthy": NO_EFFECT, "unknown": ("UNKNOWN",)}.get(case.kind)
        confusion[truth, answer, case.verdict in wanted if wanted else in_class(case)] += 1
    missing = tuple(sorted(set(truths) - {case.name for case in cases}))
    failed = tuple(case.name for case in cases if case.verdict == FAILURE)
    return Score(mixes, [Answers(*row, n) for row, n in sorted(confusion.items())], missing, len(cases), failed)


HEADINGS = ("measure", "wanted", "found", "95 % interval", "of")
PAIRED = ("paired, McNemar", "both", "first alone", "second alone", "neither", "p")
Row = tuple[str, ...]


def tables(score: Score) -> Iterator[tuple[str, Row, list[Row]]]:
    """Title, headings and rows of each table; rows that count no case are left out."""
    for mix, found in score.mixes.items():
        rows = []
        for name, one in found.shares.items():
            cells = f"{100 * one.value:.1f} %", f"{100 * one.low:.1f}-{100 * one.high:.1f} %", f"{one.hits}/{one.total}"
            rows += [(name, one.wanted, *cells)] * bool(one.total)
        rows += [
            (name, q.wanted, f"{q.value:.3g}", "", str(q.cases)) for name, q in found.quantities.items() if q.cases
        ]
        yield f"{mix}, {found.cases} {plural(found.cases, 'case')}", HEADINGS, rows
        compared = [(name, *map(str, cells), f"{p:.2g}") for name, (*cells, p) in found.paired.items() if any(cells)]
        if compared:
            yield f"{mix}, paired", PAIRED, compared
    failed = f", {len(score.failed)} of them failed" if score.failed else ""
    lacking = f", {len(score.missing)} without a diagnosis" if score.missing else ""
    rows = [(truth, answer, "yes" if right else "", str(n)) for truth, answer, right, n in score.confusion]
    cases = f"{score.cases} {plural(score.cases, 'case')}"
    yield f"truth and answer, {cases}{failed}{lacking}", Answers._fields, rows


def markdown(tables: Iterable[tuple[str, Row, list[Row]]]) -> str:
    """Tables of title, headings and rows as Markdown; a heading that begins with `>` heads numbers on the right."""
    return "\n".join(f"{title}\n\n{markdown_table(headings, rows)}\n" for title, headings, rows in tables)
