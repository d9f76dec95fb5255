"""Pipeline of a diagnosis: isolate, decide, measure the closure, localise."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from exodrake.core.errors import brief, printable, shorten
from exodrake.core.parallel import one_blas_thread
from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.data.case import Case, gather_logs, read_case
from exodrake.data.log import Log
from exodrake.diagnosis import result
from exodrake.diagnosis.calibration import calibration_notes
from exodrake.diagnosis.checks.compare import compare
from exodrake.diagnosis.checks.suspicions import suspicions
from exodrake.diagnosis.closure import change_robot, measure_closure
from exodrake.diagnosis.discovery.discover import discover
from exodrake.diagnosis.intervals import describe, fitted_effects
from exodrake.diagnosis.isolation import Isolation, affordable, excess_by_column, isolate
from exodrake.diagnosis.localise import localise, remaining
from exodrake.diagnosis.problem import list_required, make_problem, with_recorded_ranges
from exodrake.diagnosis.result import Diagnosis
from exodrake.diagnosis.search import Fitted
from exodrake.diagnosis.since import follow_sessions
from exodrake.diagnosis.verdict import Decision, decide, find_rivals, list_moved, screen_alike
from exodrake.machines.robot_file import robot_or_default
from exodrake.model.display import in_words, percent
from exodrake.model.part import JOINTS, TENDONS
from exodrake.model.robot import Robot

NONE = float("nan")


def diagnose(
    case: Case | Log | list | str | Path,
    robot: Robot | None = None,
    progress: StageProgress | None = None,
    tried: frozenset[str] | None = None,
    discovers: Callable[[str], bool] | None = None,
    answered: Callable[[Diagnosis], None] | None = None,
    negligible: float | None = None,
) -> Diagnosis:
    """Diagnosis of a case: location of the gap, effects that cause it, and its reduction by them.

    Args:
        case: a case, its folder, a log file, or a log; a list of logs, of which the last is held out. A DataFrame
            counts as a log (`Log.from_pandas`).
        robot: the nominal robot; the built-in one if None.
        progress: called with the stage and what it works on, such as the name of an effect.
        tried: ids of the effects to try (`problem.choose_tried`); by default all that are not `not_tried`.
        discovers: whether to look for a missing law after a verdict (`discovery`). A failure of this search becomes a
            note.
        answered: called with the answer before a missing law is sought, to keep it whatever comes.
        negligible: noise standard deviations RMS beyond noise; a gap that is smaller in every channel is none. 0.3 by
            default.

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
        found = isolate(make_problem(case, with_recorded_ranges(robot, case), tried, negligible), progress)
        made = answer(found, started, progress)
        if discovers is None or not discovers(made.verdict):
            return made
        if answered is not None:
            answered(made)
        try:
            made = replace(made, missing_law=discover(found, progress))
        except Exception as error:  # whatever the search or generated code raises, the verdict stands
            reason = printable(f"{type(error).__name__}: {error}".splitlines()[0])
            made = replace(made, notes=(*made.notes, f"the search for a missing law failed ({shorten(reason)})"))
        if (law := made.missing_law) and law.found and made.verdict == result.UNKNOWN and law.block != made.where.block:
            axes = (robot.machine.axes.of(axis) for axis in (TENDONS, JOINTS))
            wires, joints = (tuple(c for c in law.channels if c in axis) for axis in axes)
            made = replace(made, where=replace(made.where, block=law.block, wires=wires, joints=joints))
        return replace(made, run_time=time.perf_counter() - started)


def answer(found: Isolation, started: float, progress: StageProgress) -> Diagnosis:
    """The diagnosis of an isolation, with everything measured that it states; it began at a moment `started` [s]."""
    problem, search = found.whole, found.search
    since, decision = follow_sessions(found, decide(found))
    best, word = decision.best, decision.verdict
    progress(Stage.CLOSURE, "")
    retuned, precise = decision.fits
    effects = state_effects(found, decision, precise)
    rows = {
        "nominal": replace(problem, detected=()).silent(),
        "retuned": retuned.explanation.robot,
        "improved": precise.explanation.robot,
    }
    closure = measure_closure(problem, retuned, precise, np.array(list(rows.values())))
    effects = () if word in (result.NO_GAP, result.RETUNE, result.UNKNOWN) else effects
    others = screen_alike(found) if word == result.RETUNE else {}
    progress(Stage.LOCALISE, "")
    rest = result.Interval(NONE, NONE, NONE) if word in (result.NO_GAP, result.RETUNE) else decision.remainder
    place = remaining(found, best) if word in (result.PARTLY, result.UNKNOWN) else result.Where("")
    candidates = []
    for fitted in (f for key, f in search.sets.items() if key):
        closed, prediction = (*fitted.chi2.tolist(), NONE)[:2]
        share, evidence = 1.0 - search.measure_left(fitted), search.evidence(fitted) - search.evidence(found.retuned)
        candidates.append(result.Candidate(fitted.explanation.name, share, closed, prediction, evidence))
    # reduced chi-squares on the fitted logs, in closed loop and as prediction error
    robots = {
        "nominal": found.likelihood.chi2(found.nominal.residual),
        "retuned": found.retuned.chi2,
        "best": best.chi2,
    }
    prediction = {f"prediction_error_{name}": float(chi2[1]) for name, chi2 in robots.items() if len(chi2) > 1}
    stated = {name: change_robot(problem, values, problem.case.name) for name, values in rows.items()}
    made = Diagnosis(
        case=problem.case.name,
        verdict=word,
        where=localise(found, word, effects),
        effects=effects,
        equivalents=next(((p.effect, *p.rivals) for p in decision.causes if word == result.AMBIGUOUS and p.rivals), ()),
        # noise_std: RMS beyond noise in closed loop
        remainder=result.Remainder(
            *(rest.value, rest.low, rest.high, float(np.sqrt(max(precise.chi2[0] - 1.0, 0.0)))),
            place.block,
            place.regime,
        ),
        closure=closure,
        rivals=find_rivals(found, decision, [p for _, p in others.values()]),
        candidates=tuple(sorted(candidates, key=lambda c: -c.evidence)),
        reasons=decision.reasons,
        notes=write_notes(found, best, stated["improved"], word),
        run_time=time.perf_counter() - started,
        robots=stated,
        evidence={name: float(chi2[0]) for name, chi2 in robots.items()} | prediction,
        # to a millisecond: fits side by side add their times in any order
        simulated={stage: round(spent, 3) for stage, spent in found.likelihood.simulated.items()},
        retune=result.Retune(list_moved(problem, retuned), {i: share for i, (share, _) in others.items()}),
        since=since,
        provenance=result.record_provenance(problem),
        problem=problem,
    )
    if made.confirmed is not False:
        return made
    does, may = ("contradicts", "make the error larger"), ("does not confirm", "may leave the error as it is")
    verb, change = does if closure.effect.high < 0.0 else may
    logs = ", ".join(trial.name for trial in problem.holdout)
    note = f"held-out motion {verb} the verdict: in {logs} the named effects {change}"
    return replace(made, notes=(note, *made.notes))


def state_effects(found: Isolation, decision: Decision, precise: Fitted) -> tuple[result.NamedEffect, ...]:
    """Effects of the best set and certain detections with channels, intervals, shares and rivals, as they are stated.

    precise: the fit that says their values.
    """
    problem, fitted, stated = found.whole, fitted_effects(precise), []
    counted = {d.effect.id: d.effect for d in problem.detected if not d.certain}
    for part in decision.parts:
        effect = problem.robot.machine.effect(part.effect)
        named = counted.get(part.effect) or describe(
            fitted.of(part.effect), effect, problem.robot.machine.axes.of(effect.axis)
        )
        rivals = tuple(result.EffectRival(*rival) for rival in part.rivals.items())
        stated.append(replace(named, role=part.role, share=part.share, rivals=rivals))
    certain = [d.effect for d in problem.detected if d.certain]
    taken = 1.0 - found.beside_detections if len(certain) == 1 else NONE  # nothing is known of one among several
    stated += [replace(effect, share=result.Interval(taken, taken, taken)) for effect in certain]
    return tuple(sorted(stated, key=lambda e: (e.role != result.CAUSE, -np.nan_to_num(e.share.value))))


def write_notes(found: Isolation, best: Fitted, improved: Robot, verdict: str = "") -> tuple[str, ...]:
    """Remarks beside the verdict: on the logs, their noise and gap, the part that was used, and the calibration."""
    problem, machine = found.whole, found.whole.robot.machine
    with_improved = partial(compare, problem.case, improved)
    notes = [*problem.case.notes, *suspicions(compare(problem.case, problem.stated), with_improved)]
    smoother = ", that of accelerations included, of which a lower cut-off leaves less" if machine.motion else ""
    for name in problem.noisier:
        level = in_words(problem.robot[name], machine.parameters[machine.index[name]].unit)
        notes.append(f"the noise of the logs counts: {name} of {level}{smoother}")
    gap = np.sqrt(max(found.excess(found.retuned.explanation.robot) + problem.negligible**2, 0.0))
    if verdict in (result.PARTLY, result.UNKNOWN) and gap < 1.0:
        least = np.ceil(10.0 * gap) / 10.0
        small = f"{gap:.2f} noise standard deviations beyond noise in its worst channel"
        notes.append(f"the retuned robot leaves {small}, less than the noise; --negligible {least:g} calls that no gap")
    if affordable(problem) < 1.0:
        used, whole = (sum(len(trial.reference) for trial in p.fit) for p in (found.problem, problem))
        note, robot = f"the logs are long: the first {percent(used / whole)} of each was fitted", best.explanation.robot
        shown = excess_by_column(found.problem, robot, found.likelihood).max()
        hidden = not best.effects and shown < 0.0 <= found.excess(robot)
        notes.append(note + ("; the rest shows a gap that this part does not: diagnose that alone" if hidden else ""))
    return (*notes, *calibration_notes(machine))
