"""From a case to a diagnosis: noise, search, verdict, where, how far."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from exodrake.core.parallel import one_blas_thread
from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.core.robot import Robot
from exodrake.data.case import Case
from exodrake.data.case_folder import read_case
from exodrake.diagnosis import nuisance
from exodrake.diagnosis.closure import measure
from exodrake.diagnosis.detect.packet_loss import loss_probability
from exodrake.diagnosis.intervals import describe, spread
from exodrake.diagnosis.line import named
from exodrake.diagnosis.localise import localise
from exodrake.diagnosis.problem import Problem, make_problem, required_of
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, UNKNOWN, Candidate, Diagnosis, Interval, NamedEffect
from exodrake.diagnosis.search import PACKET_LOSS, Fitted, Search
from exodrake.diagnosis.verdict import Decision, chi2, left_over, thresholds
from exodrake.diagnosis.views import View, analyse
from exodrake.machines.robot_file import load_robot


def diagnose(
    case: Case | str | Path,
    robot: Robot | None = None,
    progress: StageProgress = no_progress,
    tried: frozenset[str] | None = None,
) -> Diagnosis:
    """Where the gap of a case lies, which effect causes it and how far it shrinks with that effect.

    Args:
        case: a case, or its folder.
        robot: the nominal robot; the built-in one if None.
        progress: called with the stage and what it works on, such as the name of an effect.
        tried: ids of the effects to try (`screen.chosen`); by default all that are not `not_tried`.
    Raises:
        InputError: for a case or a log that cannot be read, naming file, column and row.
    """
    started = time.perf_counter()
    robot = robot or load_robot()
    case = case if isinstance(case, Case) else read_case(case, required_of(robot.machine), robot.machine.frame)
    problem = make_problem(case, robot, tried)
    progress(Stage.CHECK, "")
    with one_blas_thread():
        closed, chosen = analyse(problem, thresholds(), progress)
        chosen = chosen.converged()
        progress(Stage.CLOSURE, "")
        return answer(case, problem.robot, closed, chosen, started, progress)


def robot_of(nominal: Robot, view: View, fitted: Fitted, source: str) -> Robot:
    """The robot of a fitted point: the nominal one with its retuned numbers and effects."""
    point = fitted.point
    values = nuisance.turned(nominal.values, view.ranking.full.coordinates, point.x)
    changed = {
        e.name: f"fitted to {source}"
        for e, a, b in zip(nominal.machine.parameters, values, nominal.values, strict=True)
        if a != b
    }
    values = point.hypothesis.apply(values, point.u)
    return replace(nominal, values=values, sources={**nominal.sources, **changed})


def effects_of(view: View) -> tuple[NamedEffect, ...]:
    """The effects that a view's decision names, with channels and intervals; a tremor last."""
    problem, ranking, fitted = view.problem, view.ranking, view.decision.best
    machine, probability = problem.robot.machine, view.decision.probability
    found = []
    if fitted.point.hypothesis.effects:
        fitter, responses = ranking.full, ranking.own.get(fitted.name)
        estimate = spread(fitter, fitted.point, fitter.responses(fitted.point) if responses is None else responses)
        for identity in fitted.point.hypothesis.effects:
            effect = machine.effect(identity)
            effect = describe(estimate, effect, probability.get(fitted.name, 0.0), machine.axes.of(effect.axis))
            found.append(counted(problem, effect) if identity == PACKET_LOSS else effect)
    if view.tremor:
        found.append(named(view.tremor, machine.axes.joints))
    return tuple(found)


def counted(problem: Problem, effect: NamedEffect) -> NamedEffect:
    """Lost commands are decoded one by one, so that their probability is a count, not a fit."""
    losses = [t.losses for t in (*problem.fit, *problem.holdout) if t.losses]
    return replace(effect, parameters={"probability": Interval(*loss_probability(losses))})


def equivalents_of(decision: Decision) -> tuple[str, ...]:
    """Ids in the class of an ambiguous verdict, those of the best candidate first."""
    if decision.verdict != AMBIGUOUS:
        return ()
    return tuple(dict.fromkeys(i for f in decision.rivals for i in f.point.hypothesis.effects))


def candidates_of(view: View) -> tuple[Candidate, ...]:
    """All hypotheses that a view fitted, best first: score 1 explains the gap to the noise, 0 no better than retuned
    numbers.
    """
    problem, search = view.problem, view.search
    ranked = sorted((*search.singles, *search.pairs), key=lambda f: f.score)
    return tuple(Candidate(f.name, 1.0 - left_over(problem, f, search.retuned), f.chi2, f.holdout_chi2) for f in ranked)


def baselines_of(search: Search) -> dict[str, str]:
    """What trivial methods would have said: smallest fitted residual alone, and raw BIC with every sample counted as
    independent.
    """
    if not search.singles:
        return {"replay": "retune", "bic": "retune"}
    everything = (search.retuned, *search.singles)
    smallest = min(search.singles, key=lambda f: f.chi2)

    def bic(f: Fitted) -> float:
        return float(f.point.residual @ f.point.residual) + len(f.point.u) * np.log(len(f.point.residual))

    return {"replay": smallest.name, "bic": min(everything, key=bic).name}


def answer(
    case: Case, nominal: Robot, closed: View, chosen: View, started: float, progress: StageProgress
) -> Diagnosis:
    """The diagnosis, with everything measured that it states: gaps in closed loop, causes in the chosen view."""
    problem, search, ranking, decision = closed.problem, closed.search, closed.ranking, chosen.decision
    robots = {
        "nominal": nominal,
        "retuned": robot_of(nominal, closed, search.retuned, case.name),
        "improved": robot_of(problem.robot, closed, decision.best, case.name),
    }
    closure = measure(problem, robots["nominal"], robots["retuned"], robots["improved"])
    named = decision.verdict in (NAMED, AMBIGUOUS)
    effects = effects_of(chosen) if named else ()
    experiment = None
    if decision.verdict == AMBIGUOUS:
        from exodrake.diagnosis.experiment import next_experiment

        rows = np.array([ranking.full.values(f.point.hypothesis, f.point.u, f.point.x) for f in decision.rivals])
        experiment = next_experiment(problem, rows, [f.name for f in decision.rivals])
    progress(Stage.LOCALISE, "")
    where = localise(problem, ranking.full, search, chosen, effects)
    return Diagnosis(
        case=case.name,
        verdict=decision.verdict,
        where=where,
        effects=effects,
        equivalents=equivalents_of(decision),
        closure=closure,
        next_experiment=experiment,
        candidates=candidates_of(chosen),
        baselines=baselines_of(search),
        reasons=decision.reasons,
        notes=case.notes,
        seconds=time.perf_counter() - started,
        robots=robots,
        evidence=evidence_of(closed, chosen),
    )


def evidence_of(closed: View, chosen: View) -> dict[str, float]:
    """Reduced chi-squares on all logs, in closed loop; and fed with the log, if that view was chosen."""
    best, prediction_error = chosen.decision.best, {}
    if chosen.problem is not closed.problem:
        prediction_error = {
            "prediction_error_retuned": chi2(chosen.problem, chosen.search.retuned),
            "prediction_error_best": chi2(chosen.problem, best),
        }
        best = closed.ranking.complete(closed.ranking.full.at(best.point.hypothesis, best.point.u, best.point.x))
    return {
        "nominal": chi2(closed.problem, closed.search.nominal),
        "retuned": chi2(closed.problem, closed.search.retuned),
        "best": chi2(closed.problem, best),
        "unknown": float(chosen.decision.verdict == UNKNOWN),
        **prediction_error,
    }
