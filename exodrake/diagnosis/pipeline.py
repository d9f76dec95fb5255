"""Pipeline of a diagnosis: retune, detect, isolate, decide, localise, measure the closure."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from exodrake.core.argument import argument
from exodrake.core.errors import printable, shortened
from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.core.robot import Robot
from exodrake.core.signal import JOINTS, TENDONS
from exodrake.core.threads import one_blas_thread
from exodrake.data.case import Case, read_case
from exodrake.diagnosis.calibration import calibration_notes
from exodrake.diagnosis.checks import suspicions
from exodrake.diagnosis.closure import measure
from exodrake.diagnosis.comparison import removed
from exodrake.diagnosis.detect import detect
from exodrake.diagnosis.discovery.discover import discover
from exodrake.diagnosis.discovery.missing_law import MissingLaw
from exodrake.diagnosis.fits import CONVERGED
from exodrake.diagnosis.improved import judged, robot_of, traces_of, without_traces
from exodrake.diagnosis.intervals import describe
from exodrake.diagnosis.isolate import Isolator
from exodrake.diagnosis.isolation import Isolation, Tested
from exodrake.diagnosis.level_table import level_table
from exodrake.diagnosis.localise import localise
from exodrake.diagnosis.motions import with_motions
from exodrake.diagnosis.moved import retuned
from exodrake.diagnosis.part_used import SHARE, affordable, notes_on_length, overlooks
from exodrake.diagnosis.problem import Problem, make_problem, required_of
from exodrake.diagnosis.provenance import provenance_of
from exodrake.diagnosis.prune import pruned
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, UNKNOWN, Candidate, Diagnosis, NamedEffect
from exodrake.diagnosis.retune import retune
from exodrake.diagnosis.rivals import rivals_of
from exodrake.diagnosis.since import since_of
from exodrake.diagnosis.verdict import Decision, decide, probabilities
from exodrake.machines.robot_file import robot_or_default


def diagnose(
    case: Case | str | Path,
    robot: Robot | None = None,
    progress: StageProgress = no_progress,
    tried: frozenset[str] | None = None,
    discovers: Callable[[str], bool] = lambda verdict: False,
    answered: Callable[[Diagnosis], None] = lambda found: None,
) -> Diagnosis:
    """Diagnosis of a case: location of the gap, effects that cause it, and its reduction by them.

    Args:
        case: a case, or its folder.
        robot: the nominal robot; the built-in one if None.
        progress: called with the stage and what it works on, such as the name of an effect.
        tried: ids of the effects to try (`candidates.chosen`); by default all that are not `not_tried`.
        discovers: whether to look for a missing law after a verdict (`discovery`). A failure of this search becomes a
            note.
        answered: called with the answer before a missing law is sought, to keep it whatever comes.

    Raises:
        InputError: for a case or a log that cannot be read, naming file, column and row.
    """
    started = time.perf_counter()
    robot = robot_or_default(robot)
    case = argument("case", case, Case, str, Path)
    case = case if isinstance(case, Case) else read_case(case, required_of(robot.machine), robot.machine.frame)
    progress(Stage.CHECK, "")
    with one_blas_thread():
        problem, found = isolated(make_problem(case, robot, tried), progress)
        decision = decide(problem, found)
        made = answer(problem, found, decision, started, progress)
        if not discovers(made.verdict):
            return made
        answered(made)
        try:
            law = discover(problem, found, progress, where=made.where.block if made.verdict == UNKNOWN else "")
            made = with_law(problem, made, law)
        except Exception as error:  # whatever the search or generated code raises, the verdict stands
            reason = printable(f"{type(error).__name__}: {error}".splitlines()[0])
            made = replace(made, notes=(*made.notes, f"the search for a missing law failed ({shortened(reason)})"))
        return replace(made, run_time=time.perf_counter() - started)


def with_law(problem: Problem, made: Diagnosis, law: MissingLaw) -> Diagnosis:
    """The diagnosis with a missing law, and of an unknown cause with the block and channels of the law as its own."""
    where = made.where
    if law.found and made.verdict == UNKNOWN and law.block != where.block:
        wires, joints = (
            tuple(c for c in law.channels if c in problem.robot.machine.axes.of(a)) for a in (TENDONS, JOINTS)
        )
        where = replace(where, block=law.block, wires=wires, joints=joints)
    return replace(made, where=where, missing_law=law)


def isolated(
    problem: Problem,
    progress: StageProgress = no_progress,
    share: float = SHARE,
    seen: np.ndarray | None = None,
) -> tuple[Problem, Isolation]:
    """The problem with what detectors found, and the isolation.

    Args:
        problem: the case.
        progress: called with the stage and what it works on.
        share: part of each fitted log that is used; all of it if the rest shows a gap where this part shows none, as
            far as that is affordable.
        seen: (parameters,) robot [SI] in whose residuals detectors look; the retuned one by default, and then the best
            one if they find more in what that leaves.
    """
    progress(Stage.RETUNE, "")
    share = min(share, affordable(problem))
    start, simulated = retune(problem.shortened(share))
    whole = detect(problem, start.robot if seen is None else seen)
    short, certain = whole.shortened(share), certainly_found(whole)
    if certain:
        start, again = retune(short, start)
        simulated["retune"] += again["retune"]
    most = problem.robot.machine.max_effects - certain
    found = pruned(Isolator(short, start, simulated, progress).isolate(max(most, 0)))
    if share < affordable(problem) and found.left and overlooks(whole, found.left[0]):
        return added(found, *isolated(problem, progress, 1.0, seen))
    best = found.best.explanation
    may_hide = seen is None and not certain and found.likelihood.mean_log(best.residual) > CONVERGED
    if may_hide and certainly_found(detect(problem, best.robot)):
        return added(found, *isolated(problem, progress, share, best.robot))
    return whole, found


def certainly_found(problem: Problem) -> int:
    """Number of effects that detectors found, whatever a fit finds."""
    return sum(d.certain for d in problem.detected)


def added(before: Isolation, problem: Problem, found: Isolation) -> tuple[Problem, Isolation]:
    """A problem and its isolation, the simulated time of an isolation before it added."""
    for stage, time_before in before.likelihood.simulated.items():
        found.likelihood.simulated[stage] += time_before
    return problem, found


def effects_of(problem: Problem, found: Isolation, decision: Decision) -> tuple[NamedEffect, ...]:
    """The effects that a decision names, with channels and intervals; detected ones last."""
    machine, best = problem.robot.machine, decision.best
    certain = tuple(d.effect for d in problem.detected if d.certain)
    if decision.verdict not in (NAMED, AMBIGUOUS):
        return ()
    if decision.fitted is None:
        return certain
    whole, probability = decision.fitted, probabilities(found).get(best.explanation.name, 1.0)
    counted = {d.effect.id: replace(d.effect, probability=probability) for d in problem.detected}
    named = [machine.effect(effect) for effect in best.explanation.effects]
    stated = {e.id: describe(whole.of(e.id), e, probability, machine.axes.of(e.axis)) for e in named}
    return (*(stated | {i: e for i, e in counted.items() if i in stated}).values(), *certain)


def candidates_of(found: Isolation) -> tuple[Candidate, ...]:
    """All explanations that were fitted, largest sets first, best first."""

    def candidate(t: Tested) -> Candidate:
        score = removed(found.retuned.chi2, t.chi2)
        closed, prediction = (*t.chi2.tolist(), float("nan"))[:2]
        levels, left = t.levels, t in found.left
        return Candidate(t.explanation.name, score, closed, prediction, levels.fit, levels.complete, left)

    return tuple(candidate(t) for size in reversed(found.tested) for t in size)


def baselines_of(found: Isolation) -> dict[str, str]:
    """Explanations that trivial methods would choose among the same fits in closed loop.

    The smallest residual, and raw BIC with every sample counted as independent.
    """
    singles = found.tested[0] if found.tested else ()
    if not singles:
        return {"replay": "retune", "bic": "retune"}

    def bic(t: Tested) -> float:
        samples = found.likelihood.views[0].samples
        return samples * float(t.chi2[0]) + (len(t.explanation.x) - t.explanation.nominal) * np.log(samples)

    smallest = min(singles, key=lambda t: t.chi2[0])
    return {"replay": smallest.explanation.name, "bic": min((found.retuned, *singles), key=bic).explanation.name}


def answer(problem: Problem, found: Isolation, decided: Decision, started: float, progress: StageProgress) -> Diagnosis:
    """The diagnosis, with everything measured that it states."""
    since, decision = since_of(problem, found, decided)
    found = found if decision is decided else replace(found, left=decision.left)
    case, best = problem.case, decision.best
    progress(Stage.CLOSURE, "")
    nominal = replace(problem, detected=()).silent()
    effects = effects_of(problem, found, decision)
    traces = traces_of(effects, decision.fitted)
    improved = without_traces(best.explanation.robot, traces)
    rows = {"nominal": nominal, "retuned": found.retuned.explanation.robot, "improved": improved}
    closure = measure(problem, judged(problem, found, best, traces, np.array(list(rows.values()))))
    closure = with_motions(closure, problem, found, best, traces)
    moves = retuned(found)
    progress(Stage.LOCALISE, "")
    class_ids = dict.fromkeys(i for t in decision.left for i in t.explanation.effects)
    made = Diagnosis(
        case=case.name,
        verdict=decision.verdict,
        where=localise(problem, found, decision.verdict, effects),
        effects=effects,
        equivalents=tuple(class_ids) if decision.verdict == AMBIGUOUS else (),
        closure=closure,
        rivals=rivals_of(problem, found, decision, tuple(moves.alike)),
        candidates=candidates_of(found),
        baselines=baselines_of(found),
        reasons=decision.reasons,
        notes=notes_of(problem, best),
        run_time=time.perf_counter() - started,
        robots={name: robot_of(problem, values, case.name) for name, values in rows.items()},
        evidence=evidence_of(found, best),
        # to a millisecond: fits side by side add their times in any order
        simulated={stage: round(spent, 3) for stage, spent in found.likelihood.simulated.items()},
        retune=moves,
        tests=level_table(best, found.tests.calibration),
        since=since,
        provenance=provenance_of(problem),
        problem=problem,
    )
    return replace(made, notes=(*notes_on_confirmation(made), *made.notes))


def notes_on_confirmation(made: Diagnosis) -> tuple[str, ...]:
    """Says of an answer that held-out logs contradict it, or do not confirm it."""
    if made.confirmed is not False or made.problem is None:
        return ()
    logs, step = ", ".join(trial.name for trial in made.problem.holdout), made.closure.effect
    if step.high < 0.0:
        return (f"held-out motion contradicts the verdict: in {logs} the named effects make the error larger",)
    return (f"held-out motion does not confirm the verdict: in {logs} the named effects may leave the error as it is",)


def notes_of(problem: Problem, best: Tested) -> tuple[str, ...]:
    """Remarks beside the verdict: on the logs, on the part that was used, on the calibration."""
    case, machine = problem.case, problem.robot.machine
    found = suspicions(case, problem.robot)
    return (*case.notes, *found, *notes_on_length(problem, best), *calibration_notes(machine))


def evidence_of(found: Isolation, best: Tested) -> dict[str, float]:
    """Reduced chi-squares on the fitted logs, in closed loop and as prediction error."""
    robots = {"nominal": found.nominal, "retuned": found.retuned, "best": best}
    closed = {name: float(t.chi2[0]) for name, t in robots.items()}
    return closed | {f"prediction_error_{name}": float(t.chi2[1]) for name, t in robots.items() if len(t.chi2) > 1}
