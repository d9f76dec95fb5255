"""Pipeline of a diagnosis: isolate, decide, measure the closure, localise."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from exodrake.core.display import in_words
from exodrake.core.errors import brief, printable, shorten
from exodrake.core.parallel import one_blas_thread
from exodrake.core.part import JOINTS, TENDONS
from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.core.robot import Robot
from exodrake.data.case import Case, gather_logs, read_case
from exodrake.data.log import Log
from exodrake.diagnosis.calibration import calibration_notes
from exodrake.diagnosis.checks.compare import compare
from exodrake.diagnosis.checks.suspicions import suspicions
from exodrake.diagnosis.closure import change_robot, measure_closure, with_values
from exodrake.diagnosis.discovery.discover import MissingLaw, discover
from exodrake.diagnosis.intervals import describe, fitted_effects, traces
from exodrake.diagnosis.isolation import Isolation, affordable, fit_on, isolate, negligible
from exodrake.diagnosis.localise import localise, remaining
from exodrake.diagnosis.problem import Problem, list_required, make_problem
from exodrake.diagnosis.recorded import with_recorded_ranges
from exodrake.diagnosis.result import (
    AMBIGUOUS,
    NO_GAP,
    PARTLY,
    RETUNE,
    UNKNOWN,
    Candidate,
    Diagnosis,
    EffectRival,
    Interval,
    NamedEffect,
    Remainder,
    Retune,
    Where,
    record_provenance,
)
from exodrake.diagnosis.search import Fitted
from exodrake.diagnosis.since import follow_sessions
from exodrake.diagnosis.verdict import Decision, Part, decide, find_rivals, jackknife_share, list_moved, screen_alike
from exodrake.machines.robot_file import robot_or_default

NONE = float("nan")


def diagnose(
    case: Case | Log | list | str | Path,
    robot: Robot | None = None,
    progress: StageProgress | None = None,
    tried: frozenset[str] | None = None,
    discovers: Callable[[str], bool] | None = None,
    answered: Callable[[Diagnosis], None] | None = None,
) -> Diagnosis:
    """Diagnosis of a case: location of the gap, effects that cause it, and its reduction by them.

    Args:
        case: a case, its folder, a log file, or a log; a list of logs, of which the last is held out. A DataFrame
            counts as a log (`Log.from_pandas`).
        robot: the nominal robot; the built-in one if None.
        progress: called with the stage and what it works on, such as the name of an effect.
        tried: ids of the effects to try (`problem.chosen`); by default all that are not `not_tried`.
        discovers: whether to look for a missing law after a verdict (`discovery`). A failure of this search becomes a
            note.
        answered: called with the answer before a missing law is sought, to keep it whatever comes.

    Raises:
        InputError: for a case or a log that cannot be read, naming file, column and row.

    Examples:
        >>> import exodrake as exo
        >>> rusty = exo.load_robot().splice("tendon.capstan_friction", {"mu_phi": 0.3}, channels=["AF"])
        >>> motions = exo.protocol("short-sweeps:period=1.5"), exo.grasp("caging")
        >>> found = exo.diagnose([exo.simulate(rusty, motion) for motion in motions])
        >>> found.verdict, found.effects[0].id
        ('NAMED', 'tendon.capstan_friction')
    """
    started = time.perf_counter()
    robot = robot_or_default(robot)
    progress, required = progress or no_progress, list_required(robot.machine)
    if isinstance(case, str | Path):
        case = read_case(case, required, robot.machine.frame)
    elif not isinstance(case, Case):
        items = case if isinstance(case, list) else [case]
        if not all(isinstance(one, Log) or hasattr(one, "iloc") for one in items):
            kinds = "Case or Log or list or str or Path"
            raise TypeError(f"case: wanted {kinds}, got {type(case).__name__} ({brief(case)})")
        fitted, held_out = (case[:-1], case[-1:]) if isinstance(case, list) and len(case) > 1 else (case, ())
        case = gather_logs(fitted, held_out, robot.machine.frame, required)
    progress(Stage.CHECK, "")
    with one_blas_thread():
        found = isolate(make_problem(case, with_recorded_ranges(robot, case), tried), progress)
        made = answer(found.whole, found, decide(found), started, progress)
        if discovers is None or not discovers(made.verdict):
            return made
        if answered is not None:
            answered(made)
        try:
            made = with_law(found.whole, made, discover(found.whole, found, progress))
        except Exception as error:  # whatever the search or generated code raises, the verdict stands
            reason = printable(f"{type(error).__name__}: {error}".splitlines()[0])
            made = replace(made, notes=(*made.notes, f"the search for a missing law failed ({shorten(reason)})"))
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


def state_effects(problem: Problem, found: Isolation, decision: Decision, best: Fitted) -> tuple[NamedEffect, ...]:
    """The effects of the best set with channels, intervals, shares and rivals; certain detections last.

    best: the fit that says their values.
    """
    machine, fitted = problem.robot.machine, fitted_effects(best)
    counted = {d.effect.id: d.effect for d in problem.detected if not d.certain}
    stated = []
    for part in decision.parts:
        effect = machine.effect(part.effect)
        named = counted.get(part.effect) or describe(fitted.of(part.effect), effect, machine.axes.of(effect.axis))
        rivals = tuple(state_rival(found, decision.best, part, i) for i in part.rivals)
        stated.append(replace(named, role=part.role, share=part.share, rivals=rivals))
    certain = [d.effect for d in problem.detected if d.certain]
    taken = 1.0 - found.beside_detections if len(certain) == 1 else NONE  # nothing is known of one among several
    return (*stated, *(replace(e, share=Interval(taken, taken, taken)) for e in certain))


def state_rival(found: Isolation, best: Fitted, part: Part, other: str) -> EffectRival:
    """An effect in the place of one of the best set, with the share of the gap that it would take up."""
    rest, sets = best.effects - {part.effect}, found.search.sets
    if rest in sets and rest | {other} in sets:
        left, mine = (found.search.left_by_log(sets[key]) for key in (rest, rest | {other}))
        return EffectRival(other, jackknife_share(left - mine))
    return EffectRival(other, Interval(part.rivals[other], NONE, NONE))


def list_candidates(found: Isolation) -> tuple[Candidate, ...]:
    """All sets of effects that were fitted, the most likely first."""
    search, none = found.search, found.search.evidence(found.retuned)

    def candidate(fitted: Fitted) -> Candidate:
        closed, prediction = (*fitted.chi2.tolist(), NONE)[:2]
        share, evidence = 1.0 - search.measure_left(fitted), search.evidence(fitted) - none
        return Candidate(fitted.explanation.name, share, closed, prediction, evidence)

    return tuple(sorted((candidate(f) for key, f in search.sets.items() if key), key=lambda c: -c.evidence))


def choose_baselines(found: Isolation) -> dict[str, str]:
    """Explanations that trivial methods would choose among the same fits in closed loop.

    The smallest residual, and raw BIC with every sample counted as independent.
    """
    few = [f for key, f in found.search.sets.items() if len(key) < 2]
    singles, samples = [f for f in few if f.effects] or few, found.likelihood.views[0].samples

    def bic(f: Fitted) -> float:
        return samples * float(f.chi2[0]) + (len(f.explanation.x) - f.explanation.nominal) * np.log(samples)

    chosen = {"replay": min(singles, key=lambda f: f.chi2[0]), "bic": min(few, key=bic)}
    return {method: f.explanation.name for method, f in chosen.items()}


def answer(problem: Problem, found: Isolation, first: Decision, started: float, progress: StageProgress) -> Diagnosis:
    """The diagnosis, with everything measured that it states.

    Args:
        problem: the case, with what detectors found.
        found: its isolation.
        first: its verdict, without a look at changes over time.
        started: moment at which the diagnosis began [s].
        progress: called with the stage.
    """
    since, decision = follow_sessions(problem, found, first)
    case, best, word = problem.case, decision.best, decision.verdict
    progress(Stage.CLOSURE, "")
    retuned, precise = fit_on(found, best)
    effects = state_effects(problem, found, decision, precise)
    gone = traces(effects[: len(decision.parts)], fitted_effects(precise))
    improved = with_values(precise.explanation.robot, gone)
    nominal = replace(problem, detected=()).silent()
    rows = {"nominal": nominal, "retuned": retuned.explanation.robot, "improved": improved}
    closure = measure_closure(problem, retuned, precise, np.array(list(rows.values())), gone)
    effects = () if word in (NO_GAP, RETUNE, UNKNOWN) else effects
    others = screen_alike(found) if word == RETUNE else {}
    progress(Stage.LOCALISE, "")
    rest = Interval(NONE, NONE, NONE) if word in (NO_GAP, RETUNE) else decision.remainder
    place = remaining(found, best) if word in (PARTLY, UNKNOWN) else Where("")
    made = Diagnosis(
        case=case.name,
        verdict=word,
        where=localise(found, word, effects),
        effects=effects,
        equivalents=next(((p.effect, *p.rivals) for p in decision.causes if word == AMBIGUOUS and p.rivals), ()),
        # noise_std: RMS beyond noise in closed loop
        remainder=Remainder(
            *(rest.value, rest.low, rest.high, float(np.sqrt(max(best.chi2[0] - 1.0, 0.0)))), place.block, place.regime
        ),
        closure=closure,
        rivals=find_rivals(problem, found, decision, [p for _, p in others.values()]),
        candidates=list_candidates(found),
        baselines=choose_baselines(found),
        reasons=decision.reasons,
        notes=write_notes(problem, found, best),
        run_time=time.perf_counter() - started,
        robots={name: change_robot(problem, values, case.name) for name, values in rows.items()},
        evidence=measure_evidence(found, best),
        # to a millisecond: fits side by side add their times in any order
        simulated={stage: round(spent, 3) for stage, spent in found.likelihood.simulated.items()},
        retune=Retune(list_moved(found), {i: share for i, (share, _) in others.items()}),
        since=since,
        provenance=record_provenance(problem),
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


def write_notes(problem: Problem, found: Isolation, best: Fitted) -> tuple[str, ...]:
    """Remarks beside the verdict: on the logs and their noise, on the part that was used, on the calibration."""
    used, machine = problem.robot, problem.robot.machine
    units = {name: machine.parameters[machine.index[name]].unit for name in problem.noisier}
    noise = [f"the noise of the logs counts: {n} of {in_words(used[n], unit)}" for n, unit in units.items()]
    checked = (*problem.case.notes, *suspicions(compare(problem.case, problem.stated)))
    return (*checked, *noise, *notes_on_length(found, best), *calibration_notes(machine))


def notes_on_length(found: Isolation, best: Fitted) -> tuple[str, ...]:
    """Notes on logs that are too long to be used as far as others are, a sentence each."""
    if affordable(found.whole) == 1.0:
        return ()
    used, whole = (sum(len(trial.reference) for trial in p.fit) for p in (found.problem, found.whole))
    note, robot = f"the logs are long: the first {used / whole:.0%} of each was fitted", best.explanation.robot
    hidden = not best.effects and negligible(found.problem, robot, found.likelihood) and not found.negligible(robot)
    return (note + ("; the rest shows a gap that this part does not: diagnose that alone" if hidden else ""),)


def measure_evidence(found: Isolation, best: Fitted) -> dict[str, float]:
    """Reduced chi-squares on the fitted logs, in closed loop and as prediction error."""
    nominal = found.likelihood.chi2(found.nominal.residual)
    robots = {"nominal": nominal, "retuned": found.retuned.chi2, "best": best.chi2}
    closed = {name: float(chi2[0]) for name, chi2 in robots.items()}
    return closed | {f"prediction_error_{name}": float(chi2[1]) for name, chi2 in robots.items() if len(chi2) > 1}
