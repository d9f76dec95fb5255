"""Scores of the answers to a blind set against its committed labels: measures, then tables, JSON and Markdown.

Causes are what counts; an effect without a `role` is one. Shares have exact binomial intervals and are compared in
pairs (McNemar 1947, exact test). Interval score of (l, u) for the true value x at level 1 - alpha (Gneiting & Raftery
2007, eq. 43), smaller is better:

    S = u - l + 2 / alpha (l - x) [x < l] + 2 / alpha (x - u) [x > u]
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import cache
from itertools import chain, permutations, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binomtest

from exodrake.core.confidence import binomial_interval
from exodrake.core.errors import markdown_table, plural
from exodrake.core.plain import to_dict
from exodrake.diagnosis.many import FAILURE
from exodrake.diagnosis.result import CAUSE
from exodrake.diagnosis.search import name_kind
from exodrake.machines.robot_file import load_robot
from exodrake.reference.answers import Answered, Diagnosis, Truth, read_answers, read_labels
from exodrake.reference.faults import ENTRIES


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


@dataclass(frozen=True)
class Share:
    """Share of the cases in which something holds, from case (or a part of one) -> whether it does; `wanted`: goal."""

    name: str
    outcomes: Mapping[Any, bool]
    wanted: str = ""

    @property
    def hits(self) -> int:
        """Number of cases in which it holds."""
        return sum(map(bool, self.outcomes.values()))

    @property
    def total(self) -> int:
        """Number of cases."""
        return len(self.outcomes)

    @property
    def value(self) -> float:
        """Share; NaN for no cases."""
        return self.hits / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share."""
        return binomial_interval(self.hits, self.total)


@dataclass(frozen=True)
class Paired:
    """Two shares on the same cases: in how many both hold, only the first, only the second, neither."""

    name: str
    both: int
    first: int
    second: int
    neither: int

    @property
    def p(self) -> float:
        """Two-sided p-value of equal shares: the cases in which one holds alone are a fair coin (McNemar)."""
        differing = self.first + self.second
        return float(binomtest(self.first, differing).pvalue) if differing else 1.0


def pair_shares(first: Share, second: Share, name: str = "") -> Paired:
    """Pair two shares on the cases that both count."""
    common = first.outcomes.keys() & second.outcomes
    count = Counter((bool(first.outcomes[key]), bool(second.outcomes[key])) for key in common)
    cells = (True, True), (True, False), (False, True), (False, False)
    return Paired(name or first.name, *(count[cell] for cell in cells))


ALPHA = 0.1  # of a 90 % interval


def interval_score(low: float, high: float, true: float) -> float:
    """Interval score in the unit of the parameter."""
    return high - low + 2 / ALPHA * (max(low - true, 0.0) + max(true - high, 0.0))


class ParameterInterval(NamedTuple):
    """A stated 90 % interval beside the true value."""

    key: tuple[str, str, str, str | None]  # Case, effect, parameter, and channel or None
    exact: bool  # Whether the parameter means the same in the law of the reference simulator
    covers: bool  # Whether the interval holds the true value
    half_width: float  # Relative to the parameter
    score: float  # Interval score relative to the parameter


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


def is_named_exactly(case: Answered) -> bool:
    """The true effects are named and nothing else; a class of provably inseparable effects counts as one name."""
    inseparable = set().union(*map(accepted_ids, case.truths))
    alone = case.verdict == "NAMED" or (case.verdict == "AMBIGUOUS" and found_ids(case.diagnosis) <= inseparable)
    return alone and is_truth(case.truths, named_ids(case.diagnosis))


def in_class(case: Answered) -> bool:
    """Every true effect is a cause that is named, or a rival of one."""
    return case.verdict in ("NAMED", "AMBIGUOUS") and is_in_class(case.truths, case.diagnosis)


def is_right(case: Answered) -> bool:
    """The answer is right for the kind of case: no effect, UNKNOWN, or the truth named or in the class."""
    if case.kind == "healthy":
        return case.verdict in NO_EFFECT
    return case.verdict == "UNKNOWN" if case.kind == "unknown" else in_class(case)


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


def intervals(cases: Sequence[Answered], exact: bool) -> list[ParameterInterval]:
    """Intervals stated for exactly named effects, of parameters of one kind."""
    named = filter(is_named_exactly, select_visible(cases, NAMEABLE))
    return [interval for case in named for interval in list_intervals(case) if interval.exact == exact]


def compute_shares(cases: Sequence[Answered]) -> tuple[Share, ...]:
    """Measures that are shares of cases."""
    nameable, outside = select_visible(cases, NAMEABLE), select_visible(cases, ["unknown"])
    healthy = [case for case in cases if case.kind == "healthy"]
    named = [case for case in nameable if case.verdict == "NAMED"]
    closed = [case for case in named if (case.diagnosis.get("closure") or {}).get("effect") is not None]
    located = [case for case in nameable + outside if "where" in case.diagnosis or case.verdict == FAILURE]
    partly = [case for case in nameable if case.verdict == "PARTLY"]

    def is_first(case: Answered) -> bool:
        """The truth comes first, whatever the verdict: among the causes, else in the best fitted set."""
        sets = (one["id"] for one in case.diagnosis.get("candidates") or () if one["id"] not in ("", "retune"))
        return is_truth(case.truths, named_ids(case.diagnosis) or tuple(next(sets, "").split(" + ")))

    def read_where(case: Answered, key: str) -> Any:
        return (case.diagnosis.get("where") or {}).get(key)

    tests = {
        "exactly named": is_named_exactly,
        "truth named or in its class": in_class,
        "kind and block right": lambda c: c.verdict in ("NAMED", "AMBIGUOUS") and is_kind_right(c.truths, c.diagnosis),
    }
    wanted = {f"exactly named, {kind}": goal for kind, goal in NAMEABLE.items()}
    named_kinds = ((f"{name}, {kind}", kind, holds) for name, holds in tests.items() for kind in NAMEABLE)
    rows = [
        share(name, select_visible(cases, [kind]), holds, wanted.get(name, "")) for name, kind, holds in named_kinds
    ]
    rows += [
        share("PARTLY, and its causes hold the truth", partly, lambda case: is_in_class(case.truths, case.diagnosis)),
        share("truth first", nameable, is_first, ">= 95 %"),
        share("UNKNOWN outside the library", outside, lambda case: case.verdict == "UNKNOWN", ">= 90 %"),
        share("not named outside the library", outside, lambda case: case.verdict in ("UNKNOWN", "PARTLY", *NO_EFFECT)),
        share("wrongly UNKNOWN", healthy + nameable, lambda case: case.verdict == "UNKNOWN", "<= 3 %"),
        share("false alarm on healthy", healthy, lambda case: case.verdict not in NO_EFFECT, "0-1 cases"),
        share("missed (NO_GAP or RETUNE) though visible", nameable, lambda case: case.verdict in NO_EFFECT),
        share("another effect named, or one too many", named,
              lambda case: not set(named_ids(case.diagnosis)) <= set().union(*map(accepted_ids, case.truths))),
        share("block right", filter(blocks, located),
              lambda case: read_where(case, "block") in blocks(case), ">= 95 %"),
    ]  # fmt: skip
    for name, key in (("tendons", "wires"), ("joints", "joints")):
        seats = {c.name: {seat for truth in c.truths for seat in truth[key]} for c in located}
        right_seats = {c.name: set(read_where(c, key) or ()) == seats[c.name] for c in located if seats[c.name]}
        rows.append(Share(f"{name} right", right_seats, ">= 95 %"))
    lower = f"C(effect given retune), lower bound > {CLOSED:g}"
    rows.append(share(lower, closed, lambda case: (closure(case, "effect", "low") or 0.0) > CLOSED, ">= 95 %"))
    for law, exact, _ in LAWS:
        covered = {interval.key: interval.covers for interval in intervals(cases, exact)}
        rows.append(Share(f"90 % interval covers, {law}", covered, "85-95 %"))
    return tuple(rows)


def compute_quantities(cases: Sequence[Answered]) -> tuple[Quantity, ...]:
    """Measures that are no shares."""
    answers = [case.diagnosis for case in cases]
    named = [case for case in select_visible(cases, NAMEABLE) if case.verdict == "NAMED"]
    ambiguous = (answer for answer in answers if answer["verdict"] == "AMBIGUOUS")
    sizes = [len(ids) for answer in ambiguous for ids in list_classes(answer) if len(ids) > 1]
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


def compute_baselines(cases: Sequence[Answered]) -> tuple[Share, ...]:
    """Trivial answers to the visible cases with one effect, those that the diagnosis carries among them."""
    single = select_visible(cases, ["single"])
    rows = []
    for label, key in (("effect", "id"), ("block", "block")):
        values = [case.truths[0][key] for case in single]
        commonest = max(values, key=values.count, default="")
        rows.append(share(f"always the commonest {label}", single, lambda c, k=key, v=commonest: c.truths[0][k] == v))
    for name in sorted({name for case in single for name in case.diagnosis.get("baselines") or ()}):
        ids = {c.name: (c.diagnosis.get("baselines") or {}).get(name) or "" for c in single}
        named = [c for c in single if is_truth(c.truths, ids[c.name].split(" + "))]
        rows.append(share(f"{name} names the truth", single, lambda c, named=named: c in named))
    return tuple(rows)


@dataclass(frozen=True)
class Group:
    """Measures of the cases of one mix."""

    name: str  # Name of the mix
    cases: int  # How many there are
    shares: tuple[Share, ...]
    quantities: tuple[Quantity, ...]
    baselines: tuple[Share, ...]  # Trivial answers to the cases with one effect
    paired: tuple[Paired, ...]  # The diagnosis against the baselines that it carries, then against the other answers


@dataclass(frozen=True)
class Score:
    """Measures of a set."""

    groups: tuple[Group, ...]  # Measures of each mix
    # (truth, answer, whether it is right) -> number of cases; several effects are joined by +, an answer without a name
    # is its verdict
    confusion: dict[tuple[str, str, bool], int]
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
    groups, confusion = [], Counter()
    for mix in dict.fromkeys(case.mix for case in cases):
        here, there = ([case for case in answers if case.mix == mix] for answers in (cases, others))
        shares, baselines = compute_shares(here), compute_baselines(here)
        first = next(item for item in shares if item.name == "truth first")
        compared = [pair_shares(first, item, f"truth first; {item.name}") for item in baselines if "names" in item.name]
        compared += [pair_shares(one, other) for one, other in zip(shares, compute_shares(there))] if there else []
        groups.append(Group(mix, len(here), shares, compute_quantities(here), baselines, tuple(compared)))
    for case in cases:
        truth = " + ".join(effect["id"] for effect in case.truths) or "healthy"
        named = " + ".join(named_ids(case.diagnosis))
        answer = named if case.verdict in ("NAMED", "AMBIGUOUS") and named else case.verdict
        answer = f"PARTLY: {named}" if case.verdict == "PARTLY" else answer
        confusion[truth, answer, is_right(case)] += 1
    missing = tuple(sorted(set(truths) - {case.name for case in cases}))
    failed = tuple(case.name for case in cases if case.verdict == FAILURE)
    return Score(tuple(groups), dict(sorted(confusion.items())), missing, len(cases), failed)


HEADINGS = ("measure", "wanted", "found", "95 % interval", "of")
PAIRED = ("paired, McNemar", "both", "first alone", "second alone", "neither", "p")
CONFUSION = ("truth", "answer", "right", "cases")
Row = tuple[str, ...]


def share_rows(shares: Iterable[Share], prefix: str = "") -> list[Row]:
    """Cells of the shares that count any case."""
    rows = []
    for item in shares:
        low, high = item.interval
        found = f"{100 * item.value:.1f} %", f"{100 * low:.1f}-{100 * high:.1f} %", f"{item.hits}/{item.total}"
        rows += [(prefix + item.name, item.wanted, *found)] if item.total else []
    return rows


def tables(score: Score) -> Iterator[tuple[str, Row, list[Row]]]:
    """Title, headings and rows of each table; rows that count no case are left out."""
    for group in score.groups:
        rows = share_rows(group.shares)
        rows += [(q.name, q.wanted, f"{q.value:.3g}", "", str(q.count)) for q in group.quantities if q.count]
        rows += share_rows(group.baselines, "baseline: ")
        yield f"{group.name}, {count_cases(group.cases)}", HEADINGS, rows
        compared = [(name, *map(str, cells), f"{one.p:.2g}") for one in group.paired for name, *cells in [astuple(one)]
                    if any(cells)]  # fmt: skip
        if compared:
            yield f"{group.name}, paired", PAIRED, compared
    failed = f", {len(score.failed)} of them failed" if score.failed else ""
    lacking = f", {len(score.missing)} without a diagnosis" if score.missing else ""
    rows = [(truth, answer, "yes" if right else "", str(n)) for (truth, answer, right), n in score.confusion.items()]
    yield f"truth and answer, {count_cases(score.cases)}{failed}{lacking}", CONFUSION, rows


def count_cases(cases: int) -> str:
    """Number of cases in words."""
    return f"{cases} {plural(cases, 'case')}"


def markdown(tables: Iterable[tuple[str, Row, list[Row]]]) -> str:
    """Tables of title, headings and rows as Markdown; a heading that begins with `>` heads numbers on the right."""
    return "\n".join(f"{title}\n\n{markdown_table(headings, rows)}\n" for title, headings, rows in tables)


def as_json(score: Score) -> dict[str, Any]:
    """Plain data of the score; a share or a quantity of no case has the value null."""

    def shares_json(shares: Iterable[Share]) -> dict[str, Any]:
        return {
            item.name: {"hits": item.hits, "total": item.total, "value": item.value}
            | dict(zip(("low", "high"), item.interval))
            for item in shares
        }

    mixes = {
        group.name: {
            "cases": group.cases, "shares": shares_json(group.shares),
            "quantities": {q.name: {"value": q.value, "cases": q.count} for q in group.quantities},
            "baselines": shares_json(group.baselines),
            "paired": {item.name: vars(item) | {"p": item.p} for item in group.paired},
        }
        for group in score.groups
    }  # fmt: skip
    confusion = [dict(zip(CONFUSION, (*row, count))) for row, count in score.confusion.items()]
    parts = {"cases": score.cases, "missing": score.missing, "failed": score.failed, "mixes": mixes}
    return to_dict(parts | {"confusion": confusion})
