"""From a case to a diagnosis: floor, search, verdict, where, how far."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from exodrake.case import Case, read_case
from exodrake.diagnosis import nuisance
from exodrake.diagnosis.closure import measure
from exodrake.diagnosis.decide import Decision, Thresholds, decide, explains, is_quiet, left_over, misfit, thresholds
from exodrake.diagnosis.deeper import deeper
from exodrake.diagnosis.drops import lossy, probability
from exodrake.diagnosis.intervals import describe, spread
from exodrake.diagnosis.line import TREMOR, named
from exodrake.diagnosis.place import place
from exodrake.diagnosis.problem import Problem, make_problem, required_of
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, UNKNOWN, Candidate, Diagnosis, Interval, NamedEffect
from exodrake.diagnosis.search import LOSING, Fitted, Ranking, Search
from exodrake.diagrams.robot import Robot, load_robot

Progress = Callable[[str], None]


def diagnose(case: Case | str | Path, robot: Robot | None = None, progress: Progress = lambda _: None) -> Diagnosis:
    """Where the gap of a case lies, which effect causes it and how far it shrinks with that effect.

    Args:
        case: a case, or its folder. robot: the nominal robot; the built-in one if None. progress: called with what is
        being done.
    Raises:
        InputError: for a case or a log that cannot be read, naming file, column and row.
    """
    begun = time.perf_counter()
    robot = robot or load_robot()
    case = case if isinstance(case, Case) else read_case(case, required_of(robot.machine), robot.machine.frame)
    problem = make_problem(case, robot)
    limits = thresholds()
    progress("measuring the gap")
    ranking = Ranking(problem, progress)
    search = run_search(problem, ranking, limits)
    decision = decide(problem, search, limits)
    progress("measuring how far")
    return answer(case, problem, ranking, search, decision, begun, progress)


def run_search(problem: Problem, ranking: Ranking, limits: Thresholds) -> Search:
    """Nominal, retuned, then effects and pairs as far as the gap asks for them."""
    nominal = ranking.nominal()
    if is_quiet(problem, nominal, limits):
        return Search(nominal, nominal)
    retuned = ranking.retuned()
    if retuned.misfit <= limits.quiet and not is_quiet(problem, retuned, limits):
        whole = ranking.tuned_to_all()
        retuned = whole if is_quiet(problem, whole, limits) else retuned
    shaking = None if is_quiet(problem, retuned, limits) else ranking.shaking(retuned)
    if shaking:
        return Search(nominal, retuned, shaking=shaking)
    singles, screened = ranking.singles(quiet=is_quiet(problem, retuned, limits))
    if misfit(problem, singles[0]) > limits.near and (shaking := ranking.shaking(singles[0])):
        return Search(nominal, retuned, tuple(singles), (), tuple(screened), shaking=shaking)
    if is_quiet(problem, singles[0], limits):
        return Search(nominal, retuned, tuple(singles), (), tuple(screened))
    pairs = worth(problem, singles[0], ranking.pairs(singles[0]), limits)
    if pairs and (other := ranking.second_alone(pairs[0])).score < singles[0].score:
        singles = sorted((*singles, other), key=lambda f: f.score)
        if misfit(problem, other) > limits.near:
            pairs += worth(problem, other, ranking.pairs(other), limits)
            pairs.sort(key=lambda f: f.score)
    if problem.robot.machine.depth > 2:
        pairs += deeper(problem, ranking, pairs, limits)
    best = min((*singles, *pairs), key=lambda f: f.score)
    losing = not explains(problem, best, retuned, limits) and lossy([t.drops for t in problem.fit if t.drops])
    if losing and LOSING not in best.point.hypothesis.effects:
        first = ranking.losing(singles)
        singles = sorted({f.name: f for f in (*singles, first)}.values(), key=lambda f: f.score)
        pairs += worth(problem, first, ranking.pairs(first), limits)
    return Search(nominal, retuned, tuple(singles), tuple(pairs), tuple(screened), losing)


def worth(problem: Problem, single: Fitted, pairs: list[Fitted], limits: Thresholds) -> list[Fitted]:
    """Pairs whose second effect removes enough of what the first leaves: all of it where the first explains the case
    but for its law.
    """
    if misfit(problem, single) > limits.near:
        return [f for f in pairs if left_over(problem, f, single) < limits.pair]
    return [f for f in pairs if left_over(problem, f, single) < limits.second and is_quiet(problem, f, limits)]


def robot_of(problem: Problem, ranking: Ranking, fitted: Fitted, source: str) -> Robot:
    """The robot of a fitted point: the problem's own, with its retuned numbers and effects."""
    point = fitted.point
    values = nuisance.turned(problem.robot.values, ranking.full.knobs, point.x)
    changed = {
        e.name: f"fitted to {source}"
        for e, a, b in zip(problem.robot.machine.entries, values, problem.robot.values, strict=True)
        if a != b
    }
    values = point.hypothesis.apply(values, point.u)
    return Robot(
        problem.robot.machine, values, {**problem.robot.sources, **changed}, problem.robot.ranges,
        problem.robot.limits, problem.robot.grasps, problem.robot.source,
    )  # fmt: skip


def effects_of(
    problem: Problem, ranking: Ranking, search: Search, fitted: Fitted, chance: dict[str, float]
) -> tuple[NamedEffect, ...]:
    """The effects of a candidate with lanes and intervals."""
    machine = problem.robot.machine
    if not fitted.point.hypothesis.effects:
        return ()
    if fitted.name == TREMOR and search.shaking:
        return (named(fitted.point, search.shaking[0], machine.lanes.joints),)
    fitter = ranking.full
    responses = ranking.own.get(fitted.name)
    estimate = spread(fitter, fitted.point, fitter.responses(fitted.point) if responses is None else responses)
    found = []
    for identity in fitted.point.hypothesis.effects:
        over = machine.effect(identity).over
        effect = describe(estimate, identity, over, chance.get(fitted.name, 0.0), machine.lanes.of(over))
        if identity == LOSING:
            effect = counted(problem, effect)
        if identity == TREMOR and search.shaking:
            effect = named(fitted.point, search.shaking[0], machine.lanes.joints)
        found.append(effect)
    return tuple(found)


def counted(problem: Problem, effect: NamedEffect) -> NamedEffect:
    """Lost commands are decoded one by one, so that their probability is a count, not a fit."""
    drops = [t.drops for t in (*problem.fit, *problem.holdout) if t.drops]
    return replace(effect, parameters={"probability": Interval(*probability(drops))})


def candidates_of(problem: Problem, search: Search) -> tuple[Candidate, ...]:
    """All fitted hypotheses, best first: score 1 explains the gap to the floor, 0 no better than retuned numbers."""
    ranked = sorted((*search.singles, *search.pairs), key=lambda f: f.score)
    return tuple(
        Candidate(f.name, 1.0 - left_over(problem, f, search.retuned), f.misfit, f.held_misfit) for f in ranked
    )


def baselines_of(search: Search) -> dict[str, str]:
    """What trivial methods would have said: smallest fitted residual alone, and raw BIC with every sample counted as
    independent.
    """
    if not search.singles:
        return {"replay": "retune", "bic": "retune"}
    everything = (search.retuned, *search.singles)
    smallest = min(search.singles, key=lambda f: f.misfit)

    def bic(f: Fitted) -> float:
        return float(f.point.residual @ f.point.residual) + len(f.point.u) * np.log(len(f.point.residual))

    return {"replay": smallest.name, "bic": min(everything, key=bic).name}


def answer(
    case: Case, problem: Problem, ranking: Ranking, search: Search, decision: Decision, begun: float, progress: Progress
) -> Diagnosis:
    """The diagnosis, with everything measured that it states."""
    best = decision.best
    robots = {
        "nominal": problem.robot,
        "retuned": robot_of(problem, ranking, search.retuned, case.name),
        "improved": robot_of(problem, ranking, best, case.name),
    }
    closure = measure(problem, robots["nominal"], robots["retuned"], robots["improved"])
    effects = (
        effects_of(problem, ranking, search, best, decision.probability)
        if decision.verdict in (NAMED, AMBIGUOUS)
        else ()
    )
    experiment = None
    if decision.verdict == AMBIGUOUS:
        from exodrake.diagnosis.experiment import next_experiment

        rows = np.array([ranking.full.values(f.point.hypothesis, f.point.u, f.point.x) for f in decision.rivals])
        experiment = next_experiment(problem, rows, [f.name for f in decision.rivals])
    progress("where it lies")
    where = place(problem, ranking.full, search, decision, effects)
    return Diagnosis(
        case=case.name,
        verdict=decision.verdict,
        where=where,
        effects=effects,
        equivalents=tuple(i for f in decision.rivals for i in f.point.hypothesis.effects)
        if decision.verdict == AMBIGUOUS
        else (),
        closure=closure,
        next_experiment=experiment,
        candidates=candidates_of(problem, search),
        baselines=baselines_of(search),
        reasons=decision.reasons,
        notes=case.notes,
        seconds=time.perf_counter() - begun,
        robots=robots,
        evidence={
            "nominal": misfit(problem, search.nominal),
            "retuned": misfit(problem, search.retuned),
            "best": misfit(problem, best),
            "unknown": float(decision.verdict == UNKNOWN),
        },
    )
