"""Verdict: causes with their rivals, refinements and what remains, from the fitted sets of a search.

    left(S)        share of the gap beyond retuning that a set leaves (`Search.measure_left`)

An effect of the best set S takes up left(S without it) - left(S), where a set leaves no more than a part of it does.
It is a cause where that is a tenth of the gap, of one joint at least where joints are separate, or most of what is
left without it and more than errors of the other effects' laws may leave, in all or where these are silent. Other
effects of S are refinements.
S has no effect that misleads on other motion: each kind is left out of the fit in turn and predicted by the others.
Causes divide into shares what they take up together. A rival of a cause stands in its place in a set that leaves no
more than S and the error of a law, or is as likely. Beside a verdict stand the parameters that retuning moved, and the
explanations that the logs do not tell apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from exodrake.core.confidence import NORMAL_90
from exodrake.diagnosis.closure import predict_left_out
from exodrake.diagnosis.fit import HALF, Explanation, Predicted, fit_beside, linear_model
from exodrake.diagnosis.isolation import Isolation, excess_by_column, fit_on, noise_by_column
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.parameter import apply
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import (
    AMBIGUOUS,
    CAUSE,
    NAMED,
    NO_GAP,
    PARTLY,
    REFINEMENT,
    RETUNE,
    TOO_LITTLE,
    UNKNOWN,
    Interval,
    Moved,
    Rival,
)
from exodrake.diagnosis.search import LARGE, LAW, NATS, Fitted, is_imitator, screen
from exodrake.model.display import percent

VISIBLE = 1.0  # standard deviations of the tolerance from which a change is listed
ALIKE = 0.9  # share of what retuning explains from which a single effect is listed
REASONS = {
    NO_GAP: "what is left is negligible",
    RETUNE: "nominal parameters within their tolerances explain the gap",
    NAMED: "{} explain the gap, and nothing else does",
    AMBIGUOUS: "{} explain the gap, and some have rivals",
    PARTLY: "{} explain part of the gap",
    UNKNOWN: "no effect explains half of the gap",
}
DIFFERS = "most of the gap differs from run to run of one motion, and no effect that was tried does"
CLEAR = 2.0  # times (RMS) what a set leaves in a channel that a small cause takes up there; errors of laws reach 1
EXPLAINED, MOST = 0.9, 0.5  # shares of the gap from which causes are named, and from which they explain part of it


@dataclass(frozen=True)
class Part:
    """An effect of the best set."""

    effect: str  # its id
    role: str  # `cause` or `refinement`
    share: Interval  # of the gap that retuning leaves
    rivals: dict[str, Interval]  # effects in its place -> share of the gap that they would take up


@dataclass(frozen=True, eq=False)
class Decision:
    """A verdict."""

    verdict: str  # its word
    best: Fitted  # the set behind it
    parts: tuple[Part, ...]  # its effects, causes first, the largest first
    remainder: Interval  # share of the gap that it leaves
    reasons: tuple[str, ...]  # sentences
    fits: tuple[Fitted, Fitted]  # the retuned robot and the set, fitted on to more of the logs (`fit_on`)

    @property
    def causes(self) -> tuple[Part, ...]:
        """Effects that the verdict calls causes."""
        return tuple(p for p in self.parts if p.role == CAUSE)


def jackknife_share(values: np.ndarray) -> Interval:
    """A share over all logs with its jackknife interval; values (1 + logs,): by all, and with each log left out."""
    value, n = float(values[0]), len(values) - 1
    half = NORMAL_90 * float(np.sqrt((n - 1) / n * np.sum((values[1:] - values[1:].mean()) ** 2))) if n > 1 else 0.0
    return Interval(*np.clip([value, value - half, value + half], 0.0, 1.0).tolist())


def decide(found: Isolation) -> Decision:
    """The verdict of an isolation; certain detections are causes of what they take of the gap."""
    search, none = found.search, found.search.none
    certain = tuple(d.reason for d in found.whole.detected if d.certain)
    for word, explanation in ((NO_GAP, found.nominal), (RETUNE, none.explanation)):
        if found.excess(explanation.robot) < 0.0:
            left = found.beside_detections * search.left_by_log(none)
            one = Decision(word, none, (), jackknife_share(left), (REASONS[word],), fit_on(found, none))
            if certain:
                return replace(one, verdict=NAMED, reasons=(*certain, *one.reasons))
            if word == RETUNE and found.differs_between_runs:
                return replace(one, verdict=UNKNOWN, reasons=(DIFFERS,))
            return one if word == NO_GAP else decide_retuned(found, one)
    best, roles = drop_misleading(found)
    fits = fit_on(found, best)
    left = found.beside_detections * search.left_by_log(fits[1])
    parts = divide_gap(found, best, roles, left)
    causes, explained = [p for p in parts if p.role == CAUSE], 1.0 - float(left[0])
    if explained >= MOST and found.excess(fits[1].explanation.robot) < 0.0:
        explained = 1.0
    reason = ""
    if not (causes or certain) or explained < MOST:
        word, most = UNKNOWN, min(filter(search.usable, search.sets.values()), key=search.measure_left)
        if (share := 1.0 - search.measure_left(most)) >= MOST:
            reason = f"{most.explanation.name} would explain {percent(share)} of the gap, {TOO_LITTLE}"
    elif explained < EXPLAINED:
        word = PARTLY
    else:
        word = AMBIGUOUS if any(p.rivals for p in causes) else NAMED
    what = "the causes with their refinements" if len(causes) < len(parts) else "the causes"
    reasons = (*certain, reason or REASONS[word].format(what))
    return Decision(word, best, parts, jackknife_share(left), reasons, fits)


def decide_retuned(found: Isolation, decision: Decision) -> Decision:
    """The verdict where retuning leaves a negligible gap: `decision`, unless tolerances had to move too far for it.

    They cost what their priors say. An effect in their place counts if it spares `SURE` of that; the most likely does.
    Its share is that of the nominal robot's gap, since retuning leaves none.
    """
    search = found.search
    singles = {next(iter(f.effects)): f for f in search.list_sparing(search.none, 1)}
    likely = {i: search.evidence(f) for i, f in singles.items()}
    one = max(likely, key=likely.__getitem__, default="")
    if not one or likely[one] - search.evidence(search.none) < NATS:
        return decision
    before = search.whole.chi2_by_log(search.whole.residual(found.nominal.robot[None])[0])
    left = {i: search.left_by_log(singles[i], before) for i in likely if likely[one] - likely[i] < NATS}
    rivals = {i: jackknife_share(1.0 - rest) for i, rest in left.items()}
    part = Part(one, CAUSE, rivals.pop(one), rivals)
    word = AMBIGUOUS if rivals else NAMED
    best, reason = singles[one], REASONS[word].format("the causes")
    return Decision(word, best, (part,), jackknife_share(left[one]), (reason,), fit_on(found, best))


def drop_misleading(found: Isolation) -> tuple[Fitted, dict[str, str]]:
    """The best set without effects that do not help on other motion, and the roles of its effects.

    It gives way to a set with one effect less, or a rival in the place of one, that leaves less than `HALF` as much
    (RMS) on kinds of motion that are left out of the fit. Refinements go that leave more over the whole logs than the
    set without them. So do drifts, which are laws of time alone: they take up what is slow in one log and say nothing
    of another.
    """
    search, best = found.search, found.best
    drifts = {e.id for e in search.effects if e.family == "drift"}
    while True:
        roles = find_roles(found, best)
        smaller = {i: f for i in roles if search.usable(f := search.sets[best.effects - {i}])}
        gains = {i: float(gain[0]) for i, gain in measure_gains(found, best).items()}
        others = [f for i, gain in gains.items() for f in list_rivals(found, best, i, gain).values()]
        errors = [(predict_left_out(found.problem, f), f) for f in (*smaller.values(), *others)]
        least, other = min(errors, key=itemgetter(0), default=(np.inf, best))
        tried = [i for i in smaller if roles[i] == REFINEMENT and (gains[i] < 0.0 or i in drifts)]
        if least < HALF * predict_left_out(found.problem, best):
            best = other
        elif tried:
            best = smaller[min(tried, key=gains.__getitem__)]
        else:
            return best, promote_refinements(found, best, roles)
        search.reduce(best.effects)


def list_rivals(found: Isolation, best: Fitted, effect: str, gain: float) -> dict[str, Fitted]:
    """Effects in the place of one, which takes up a `gain` of the gap, as `Search.list_rivals`.

    None that leaves more than `1 / HALF` times as much (RMS) on kinds of motion that are left out of the fit.
    """
    rivals = found.search.list_rivals(best, effect, gain / found.beside_detections)
    most = predict_left_out(found.problem, best) / HALF if rivals else 0.0
    return {i: f for i, f in rivals.items() if predict_left_out(found.problem, f) <= most}


def promote_refinements(found: Isolation, best: Fitted, roles: Mapping[str, str]) -> dict[str, str]:
    """Roles where refinements that stand in for each other take up together what makes a cause.

    None of them does alone, as the others of them stay. The one that takes up most beside the causes is a cause, too,
    those that imitate causes last.
    """
    search, roles = found.search, dict(roles)
    known = {e.id: e for e in search.effects}

    def left(*parts: frozenset[str]) -> list[np.ndarray]:
        search.fit_parts(best.effects, [part for part in parts if part not in search.sets])
        return [found.beside_detections * search.left_by_joint(search.best_within(part)) for part in parts]

    while len(rest := [i for i, role in roles.items() if role == REFINEMENT]) > 1:
        causes = frozenset(roles) - frozenset(rest)
        if not np.any(np.subtract(*left(causes, best.effects)) >= LARGE):
            break
        beside = dict(zip(rest, left(*(causes | {i} for i in rest)), strict=True))
        roles[min(rest, key=lambda i: (is_imitator(known[i]), float(beside[i].sum())))] = CAUSE
    return roles


def list_smaller(found: Isolation, best: Fitted) -> dict[str, Fitted]:
    """Effects of a set, each with the set without it."""
    return {i: found.search.best_within(best.effects - {i}) for i in best.explanation.effects}


def measure_gains(found: Isolation, best: Fitted) -> dict[str, np.ndarray]:
    """Share (1 + logs,) of the gap, detections in it, that each effect of a set takes up beside the others."""
    left, part = found.search.left_by_log, found.beside_detections
    rest = left(best)
    return {i: part * (left(fitted) - rest) for i, fitted in list_smaller(found, best).items()}


def find_roles(found: Isolation, best: Fitted) -> dict[str, str]:
    """Role of each effect of a set.

    A small effect is a cause where what is left without it is visible and no error of another one's law. Such errors
    are as large as `LAW` of what the others take up; lost commands that were decoded have no such law. Or the effect
    takes up in a channel what nothing else may (`find_clear`). Where joints are separate, it is a cause in one of them.
    """
    search, problem, smaller = found.search, found.whole, list_smaller(found, best)
    if not smaller:
        return {}
    sets, by_joint = (search.none, best, *smaller.values()), search.whole.any_by_joint
    before, after, *without = (excess_by_column(problem, f.explanation.robot, found.likelihood)[0] for f in sets)
    shown, clear = dict(zip(smaller, without)), find_clear(found, best, smaller)
    rest = found.beside_detections * search.left_by_joint(best)
    gained = {i: found.beside_detections * search.left_by_joint(fitted) - rest for i, fitted in smaller.items()}
    roles, counts = {}, by_joint(before >= 0.0)
    for effect, gain in gained.items():
        others = sum(np.minimum(g, 1.0) for i, g in gained.items() if i not in (effect, *problem.counted))
        small = (gain >= LAW**2 * others) & (bool(after.max() < 0.0) | (gain >= MOST * (rest + gain)))
        small &= by_joint(shown[effect] > np.maximum(after + problem.negligible**2, 0.0))
        small |= by_joint(clear[effect])
        roles[effect] = CAUSE if np.any(counts & ((gain >= LARGE) | small)) else REFINEMENT
    return roles


def divide_gap(found: Isolation, best: Fitted, roles: Mapping[str, str], left: np.ndarray) -> tuple[Part, ...]:
    """Effects of a set, causes first, the largest first. left: share (1 + logs,) of the gap that it leaves.

    What causes take up together is divided by what each takes up alone and what is left without it, in the mean: of
    two that stand in for each other neither is lost.
    """
    search, part, gains = found.search, found.beside_detections, measure_gains(found, best)
    none = part * search.left_by_log(search.none)
    alone = {i: frozenset([i]) for i, role in roles.items() if role == CAUSE}
    search.fit_parts(best.effects, [key for key in alone.values() if key not in search.sets])
    taken = {i: none - part * search.left_by_log(search.sets[key]) for i, key in alone.items()}
    weight = {i: np.maximum(own, 0.0) + np.maximum(gains[i], 1e-9) for i, own in taken.items()}
    together = none - left - sum(np.maximum(g, 0.0) for i, g in gains.items() if roles[i] == REFINEMENT)
    parts = []
    for effect, gain in gains.items():
        share = together * weight[effect] / sum(weight.values()) if effect in weight else gain
        rivals = list_rivals(found, best, effect, float(gain[0]))
        alike = {i: jackknife_share(share + left - part * search.left_by_log(f)) for i, f in rivals.items()}
        parts.append(Part(effect, roles[effect], jackknife_share(share), alike))
    return tuple(sorted(parts, key=lambda p: (p.role != CAUSE, -p.share.value)))


def find_clear(found: Isolation, best: Fitted, smaller: Mapping[str, Fitted]) -> dict[str, np.ndarray]:
    """Whether each effect of a set takes up in a channel (columns,) what nothing else may: effect -> mask.

    That is as much as the noise, and `CLEAR` times (RMS) what the set leaves there. A sample counts the less, the more
    errors of the other effects' laws may leave in it: `LAW` of what each does there. Lost commands that were decoded
    have no such law. The set without the effect is fitted on with these weights, by one step: what it could not fit
    where the others' laws err has moved it where they are silent. In a channel where an effect does nothing by itself,
    as a sensor's in others, it is the retuned parameters beside it that do.
    """
    problem, machine, likelihood = found.whole, found.whole.robot.machine, found.likelihood
    silent = np.tile(best.explanation.robot, (len(smaller), 1))
    for row, i in zip(silent, smaller, strict=True):
        at = [k for p in machine.effect(i).parameters for k in machine.effect_indices(i, p.name).values()]
        row[at] = problem.robot.values[at]

    def weigh(done: np.ndarray) -> list[np.ndarray]:
        """Weights of samples beside each effect; done: what each does (effects, samples)."""
        errors = (LAW * done) ** 2 * [[i not in problem.counted] for i in smaller]
        return list(1.0 / (1.0 + errors.sum(axis=0) - errors))

    weights = weigh(likelihood.residual(silent) - likelihood.residual(best.explanation.robot[None]))
    again = [step_on(likelihood, f.explanation, w) for f, w in zip(smaller.values(), weights, strict=True)]
    robots = [best.explanation.robot, *silent, *(f.explanation.robot for f in smaller.values()), *again]
    here, *rows = problem.residual(np.array(robots), problem.fit)
    done, as_fitted, further = np.split(np.array(rows), 3)
    noise, clear = noise_by_column(likelihood), dict[str, np.ndarray]()
    for i, own, weight, *rows in zip(smaller, done - here, weigh(done - here), as_fitted, further, strict=True):
        left, less = weight * here**2, min((weight * row**2 for row in rows), key=np.sum)
        gain, rest, weight = (x.reshape(-1, len(noise)).mean(axis=0) for x in (less - left, left, weight))
        acts = own.reshape(-1, len(noise)).any(axis=0)
        clear[i] = acts & (gain >= np.maximum(CLEAR**2 * (rest - weight * noise), 1.0))
    return clear


def step_on(likelihood: Likelihood, e: Explanation, weight: np.ndarray) -> np.ndarray:
    """The robot (parameters,) of an explanation one Gauss-Newton step on, with other weights of its samples."""
    likelihood = likelihood.scaled_to(np.sqrt(weight) * e.residual)
    step = linear_model(likelihood, e, weight).posterior().step
    return apply(e.values, e.parameters, np.clip(e.x + step, *e.bounds))


def list_moved(problem: Problem, retuned: Fitted) -> tuple[Moved, ...]:
    """Nominal parameters that retuning moved visibly, largest change first."""
    e, infos = retuned.explanation, problem.robot.machine.parameters
    changes = []
    for parameter, x in zip(e.parameters, e.x, strict=True):
        deviations, i = float(x / parameter.prior_std), parameter.index[0]
        if abs(deviations) > VISIBLE:
            changes.append(Moved(parameter.name, float(e.values[i]), float(e.robot[i]), infos[i].unit, deviations))
    return tuple(sorted(changes, key=lambda m: -abs(m.deviations)))


def screen_alike(found: Isolation) -> dict[str, tuple[float, Predicted]]:
    """Single effects that explain what retuning explains, the nominal parameters as they were, largest share first."""
    nominal, retuned, none = found.nominal, found.retuned.explanation, np.zeros(0)
    if not found.search.lin.probes:
        return {}
    fixed = replace(nominal, parameters=(), x=none, jacobian=nominal.jacobian[:0])
    likelihood = found.likelihood.scaled_to(nominal.residual)
    kept = found.search.lin.kept
    gain = likelihood.cost(nominal.residual * kept, none, none) - likelihood.cost(retuned.residual * kept, none, none)
    predicted = screen(likelihood, fixed, found.search.lin, kept) if gain > 0.0 else []
    shares = {p.probe.effect: (min(p.gain / gain, 1.0), p) for p in predicted}
    return {effect: one for effect, one in shares.items() if one[0] > ALIKE}


def find_rivals(found: Isolation, decision: Decision, others: Iterable[Predicted]) -> tuple[Rival, ...]:
    """The explanations still in play after a decision, the best set first; none where one is left.

    others: single effects that explain as much as retuning does.
    """
    best, explanations = decision.best, [decision.best.explanation]
    if decision.verdict == AMBIGUOUS:
        for cause in decision.causes:
            places = found.search.find_replacements(best, cause.effect)
            explanations += [places[i].explanation for i in cause.rivals if i in places]
    if decision.verdict == RETUNE:
        nominal = found.nominal
        likelihood = found.likelihood.scaled_to(nominal.residual).for_stage("refine")
        explanations += fit_beside(likelihood, nominal, [replace(p, x=nominal.x) for p in others])
    if len(explanations) < 2:
        return ()
    nominal, names = replace(found.whole, detected=()).silent(), [p.name for p in found.whole.robot.machine.parameters]
    changes = [(e, e.robot, np.flatnonzero(e.robot != nominal)) for e in explanations]
    return tuple(Rival(e.effects, {names[i]: float(values[i]) for i in at}) for e, values, at in changes)
