"""Second effects: what is tried beside a first one, and which of it is worth it."""

from __future__ import annotations

from collections.abc import Sequence

from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.search import PACKET_LOSS, Fitted, Ranking
from exodrake.diagnosis.verdict import Thresholds, as_good, chi2, explains, left_over, simpler


def with_second_effects(
    problem: Problem, ranking: Ranking, singles: list[Fitted], retuned: Fitted, limits: Thresholds
) -> tuple[list[Fitted], list[Fitted]]:
    """The singles, and the pairs that are worth it; the first effect is chosen anew beside the second."""
    several = problem.robot.machine.max_effects > 2  # where causes come in threes the first one may do little
    hopeful = several or left_over(problem, singles[0], retuned) <= limits.unpromising
    tried = ranking.pairs(singles[0]) if hopeful else []
    pairs = accepted(problem, singles[0], tried, retuned, limits)
    if not pairs:
        return singles, pairs
    other = ranking.second_alone(pairs[0])
    better = other.score < singles[0].score
    singles = sorted((*singles, other), key=lambda f: f.score) if better else singles
    if (better or left_over(problem, pairs[0], retuned) > limits.form) and chi2(problem, other) > limits.near:
        tried = once([*tried, *ranking.pairs(other)])
    pairs = accepted(problem, singles[0], tried, retuned, limits)
    return singles, once([*pairs, *alternatives(problem, ranking, singles, pairs, limits)])


def with_packet_loss(
    problem: Problem,
    ranking: Ranking,
    singles: list[Fitted],
    pairs: list[Fitted],
    retuned: Fitted,
    limits: Thresholds,
) -> tuple[list[Fitted], list[Fitted]]:
    """Singles and pairs once commands were seen to be lost: beside what explains the gap, or others beside them."""
    best = min((*singles, *pairs), key=lambda f: f.score)
    if PACKET_LOSS in best.point.hypothesis.effects:
        return singles, pairs
    if explains(problem, best, retuned, limits):
        beside = ranking.packet_loss_beside(best)
        return singles, [*pairs, beside] if best.score - beside.score > limits.second else pairs
    first = ranking.packet_loss(singles)
    singles = sorted({f.name: f for f in (*singles, first)}.values(), key=lambda f: f.score)
    return singles, [*pairs, *accepted(problem, first, ranking.pairs(first), retuned, limits)]


def alternatives(
    problem: Problem, ranking: Ranking, singles: list[Fitted], pairs: list[Fitted], limits: Thresholds
) -> list[Fitted]:
    """The best pair with its first effect replaced by each that is as good alone, and by the best simpler one."""
    if not pairs:
        return []
    best = min(pairs, key=lambda f: f.score)
    first, tried = best.point.hypothesis.effects[0], {f.name for f in pairs}
    alone = next((f for f in singles if f.name == first), None)
    if alone is None:
        return []
    rivals = [f for f in singles if f is not alone and as_good(problem, f, alone, limits)]
    rivals += [f for f in singles if f not in rivals and simpler(f, alone)][:1]
    second = best.point.hypothesis.effects[-1]
    wanted = [f for f in rivals if f.name != second and f"{f.name} + {second}" not in tried]
    return [ranking.second_beside(best, f) for f in wanted]


def once(pairs: list[Fitted]) -> list[Fitted]:
    """The best fit of each set of effects, whatever their order; best first."""
    found: dict[frozenset[str], Fitted] = {}
    for pair in sorted(pairs, key=lambda f: f.score):
        found.setdefault(frozenset(pair.point.hypothesis.effects), pair)
    return list(found.values())


def accepted(
    problem: Problem, single: Fitted, pairs: list[Fitted], retuned: Fitted, limits: Thresholds
) -> list[Fitted]:
    """Pairs whose second effect is worth it.

    While much is left, it removes half of that. Where the first alone explains the gap, what it leaves may be its law,
    which effects of every block take up alike: a second one then does far better than those of all other blocks, or
    leaves next to nothing. Near the noise it may also relieve the nominal numbers: then the cost tells.
    """
    near = chi2(problem, single) <= limits.near
    by_cost = near or PACKET_LOSS in single.point.hypothesis.effects

    def left(pair: Fitted) -> float:
        return left_over(problem, pair, single)

    def gain(pair: Fitted) -> float:
        return single.score - pair.score

    if not near and left_over(problem, single, retuned) > limits.explained:
        halving = [f for f in pairs if left(f) < limits.pair]
        if halving or not by_cost:
            return halving
    if not pairs:
        return []
    best, others = set_apart(single, pairs)
    distinct = left(best) < min([limits.distinct_of_law, *(min(left(f), 1.0) / limits.distinct for f in others)])
    if gain(best) > limits.second and (distinct or (by_cost and clearly_best(single, pairs, limits))):
        return [f for f in pairs if f not in others and gain(f) > limits.second]
    return [] if near else [f for f in pairs if left(f) < limits.of_law]


def clearly_best(before: Fitted, found: Sequence[Fitted], limits: Thresholds) -> bool:
    """Whether the best candidate lowers the cost of `before` by far more than any with an effect of another block."""
    best, others = set_apart(before, found)
    gained = max((before.score - f.score for f in others), default=0.0)
    return before.score - best.score > max(limits.second, limits.far * gained)


def set_apart(before: Fitted, found: Sequence[Fitted]) -> tuple[Fitted, list[Fitted]]:
    """The best candidate, and those that add an effect of another block to `before` than it does."""
    best = min(found, key=lambda f: f.score)
    return best, [f for f in found if added(before, f) != added(before, best)]


def added(before: Fitted, fitted: Fitted) -> str:
    """Block of the last effect that `before` has not."""
    new = [e for e in fitted.point.hypothesis.effects if e not in before.point.hypothesis.effects]
    return new[-1].split(".")[0]
