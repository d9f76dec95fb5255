"""Calibration of the tests on simulated robots, and their error rates.

Every third robot is healthy. The others have one effect of the library each. This may be an effect that a diagnosis
does not try: it is then another law of a tried effect, as a real robot has. Statistics are recorded of the explanation
that is true or nearest to the truth (the best effect of the same family and block):

    law_error, same_meaning    error of the law that explains what is left, as share of the effect's contribution
    taken                      largest share of a significant excess over noise that another explanation takes up
    moved                      mean square of the changes of its nominal parameters

Their conformal upper quantiles (Angelopoulos & Bates 2023) are the numbers of the tests. The error rates hold for the
numbers in use during the run. A second run with another seed gives the error rates of new numbers.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from exodrake.core.confidence import ALPHA
from exodrake.core.effect import Effect
from exodrake.core.errors import InputError
from exodrake.core.parallel import each
from exodrake.core.progress import Count, no_progress
from exodrake.core.proportions import binomial_interval
from exodrake.data.case import Case
from exodrake.diagnosis.calibration import NUMBERS, UNCALIBRATED, Calibration
from exodrake.diagnosis.healthy import SEEDS, followed, healthy_case, healthy_robot, with_effect
from exodrake.diagnosis.isolation import Isolation, Tested
from exodrake.diagnosis.p_values import exceeding
from exodrake.diagnosis.pipeline import isolated
from exodrake.diagnosis.problem import Problem, make_problem
from exodrake.diagnosis.projection import Projection
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE, UNKNOWN
from exodrake.diagnosis.verdict import Decision, decide
from exodrake.machines.robot_file import load_robot

HEALTHY, TRIED, OTHER_LAW, OUTSIDE = "healthy", "tried", "other law", "outside"  # kinds of simulated robots
EACH_HEALTHY = 3  # one robot in so many is healthy
LEAST = 20  # robots from which a number is taken; fewer cannot say a quantile of 95 %
LEAST_ERROR = 0.02  # relative: a robot differs from its model at least as two simulators do; assumed
LOWER_BOUNDS = {"law_error": LEAST_ERROR, "same_meaning": LEAST_ERROR}
QUANTILES = {"law_error": 0.95, "same_meaning": 0.95, "taken": 1.0 - ALPHA, "moved": 1.0 - ALPHA}


@dataclass(frozen=True)
class Record:
    """Verdict and calibration statistics of one simulated robot.

    Attributes:
        kind: `healthy`; its effect is `tried`, another law (`other law`) of one that is, or `outside` of those.
        effect: id of its effect; empty for a healthy robot.
        verdict: word of the verdict.
        named: whether the true effect is named alone; for another law, one of the same family and block.
        first: whether it is the best of all explanations.
        kept: whether the logs do not reject it.
        values: number of the calibration -> what the true explanation shows of it.
    """

    kind: str
    effect: str
    verdict: str
    named: bool = False
    first: bool = False
    kept: bool = False
    values: dict[str, float] = field(default_factory=dict)


def calibrate(
    robot: str,
    cases: int,
    seed: int = 0,
    case: Case | None = None,
    jobs: int = 1,
    cluster: str | None = None,
    progress: Count = no_progress,
) -> tuple[list[Record], dict[int, str]]:
    """Records of simulated robots, the same whatever `jobs` is.

    Args:
        robot: name of a machine, or robot file.
        cases: number of robots.
        seed: of everything that is drawn.
        case: whose motion they follow; the machine's own experiments if None.
        jobs: as in `parallel.each`.
        cluster: as in `parallel.each`.
        progress: called with the numbers of done, failed and all robots.

    Returns:
        Records in the order of the robots, and the reason by number for those that failed.

    Raises:
        InputError: as `parallel.each`, and for a machine without experiments where no case is given.
    """
    machine = load_robot(robot).machine
    if case is None and not machine.experiments:
        raise InputError(f"{machine.name} declares no experiments of its own; --case CASE gives the motion")
    found: dict[int, Record] = {}
    failed: dict[int, str] = {}
    for outcome in each(simulated_robot, ((robot, case, seed, k) for k in range(cases)), jobs, cluster):
        if outcome.reason is None:
            found[outcome.number] = outcome.value
        else:
            failed[outcome.number] = outcome.reason
        progress(len(found), len(failed), cases)
    return [found[k] for k in sorted(found)], failed


def simulated_robot(robot: str, case: Case | None, seed: int, number: int) -> Record:
    """The record of one robot, drawn by the seed and its number."""
    nominal, rng = load_robot(robot), np.random.default_rng([seed, number])
    nominal = nominal.with_parameters(case.robot, source=case.name) if case else nominal
    motion = case or healthy_case(nominal, int(rng.integers(SEEDS)))
    drawn, effect = healthy_robot(nominal, rng), None
    if number % EACH_HEALTHY:
        effect = nominal.machine.effects[rng.integers(len(nominal.machine.effects))]
        drawn = with_effect(drawn, effect, rng)
    problem, found = isolated(make_problem(followed(motion, drawn, rng), nominal))
    return record(problem, found, decide(problem, found), effect)


def record(problem: Problem, found: Isolation, decision: Decision, effect: Effect | None) -> Record:
    """Record of the isolation and decision for a robot with that effect."""
    if effect is None:
        return Record(HEALTHY, "", decision.verdict, values=shown(problem, found, found.retuned))
    true = truths(problem, effect)
    kind = TRIED if true == {effect.id} else OTHER_LAW if true else OUTSIDE
    best = next((t for t in (found.tested[0] if found.tested else ()) if set(t.explanation.effects) <= true), None)
    certain = {d.effect.id for d in problem.detected if d.certain}

    def fits(t: Tested) -> bool:
        there = certain | set(t.explanation.effects)
        return len(there) == 1 and there <= true

    return Record(
        kind,
        effect.id,
        decision.verdict,
        named=decision.verdict == NAMED and fits(decision.best),
        first=fits(decision.best),
        kept=decision.verdict in (NAMED, AMBIGUOUS) and any(fits(t) for t in (*decision.left, decision.best)),
        values=shown(problem, found, best) if best else {},
    )


def truths(problem: Problem, effect: Effect) -> set[str]:
    """Ids of the effects whose name is right: itself, or tried ones of the same family and block."""
    if effect.id in problem.tried:
        return {effect.id}
    kin = [e for e in problem.robot.machine.effects if (e.family, e.block) == (effect.family, effect.block)]
    return {e.id for e in kin if e.family and e.id in problem.tried}


def shown(problem: Problem, found: Isolation, true: Tested) -> dict[str, float]:
    """Calibration statistics of the true explanation.

    Its law has no error where noise alone may leave as much; `taken` counts where a rival takes up more than of noise.
    """
    machine, e, tests = problem.robot.machine, true.explanation, copy.copy(found.tests)
    tests.calibration = replace(limits := found.tests.calibration, taken=0.0)  # whatever takes up more than noise beats
    levels = tests(e, [t.explanation for size in found.tested for t in size if t.explanation is not e])
    likelihood = tests.likelihood.scaled_to(e.residual)
    project = Projection(likelihood, e, tests.lin)
    by_noise = exceeding(project.left(tests.noise.of(e)), float(project.left(e.residual[None])[0])) > ALPHA
    same = all(machine.effect(i).same_meaning and i not in problem.counted for i in e.effects)
    name = "same_meaning" if same else "law_error"
    values = {name: 0.0 if by_noise else levels.law_error * getattr(limits, name), "moved": levels.moved}
    return values | ({"taken": levels.share} if levels.beaten_by else {})


def numbers_of(records: Sequence[Record], source: str) -> tuple[Calibration, dict[str, int]]:
    """The calibration from records, and the count of robots that each number rests on.

    A number stays that of `UNCALIBRATED` where fewer than `LEAST` robots say it. The error of the law is not said by
    robots whose law is the model's: it takes a machine whose library has other laws.
    """
    samples = {name: [r.values[name] for r in records if name in r.values] for name in NUMBERS}
    if not any(r.kind == OTHER_LAW and "law_error" in r.values for r in records):
        samples["law_error"] = []
    found = {n: upper(samples[n], QUANTILES[n], getattr(UNCALIBRATED, n)) for n in NUMBERS}
    found = {n: max(value, LOWER_BOUNDS.get(n, 0.0)) or getattr(UNCALIBRATED, n) for n, value in found.items()}
    return Calibration(**found, source=source), {name: len(values) for name, values in samples.items()}


def upper(values: Sequence[float], level: float, default: float) -> float:
    """Least t with p(t) <= 1 - level, where p(t) = (1 + number of values above t) / (1 + number of values).

    With too few values for that level it is the largest, `default` at least; with fewer than `LEAST`, the default.
    """
    if len(values) < LEAST:
        return default
    rank = math.ceil(level * (len(values) + 1) - 1e-9)
    ordered = sorted(values)
    return ordered[rank - 1] if rank <= len(values) else max(default, ordered[-1])


def rates_of(records: Sequence[Record]) -> dict[str, dict[str, float]]:
    """Error rates of the tests: k of n robots, with the exact (Clopper-Pearson) 95 % interval `low` .. `high`."""
    seen = [r for r in records if r.verdict not in (NO_GAP, RETUNE)]
    tried, other, outside = ([r for r in seen if r.kind == kind] for kind in (TRIED, OTHER_LAW, OUTSIDE))
    healthy, ill = ([r for r in records if (r.kind == HEALTHY) == wanted] for wanted in (True, False))
    return {
        "false alarm on healthy": rate([r in seen for r in healthy]),
        "effect not seen": rate([r not in seen for r in ill]),
        "truth named alone": rate([r.named for r in tried]),
        "truth first": rate([r.first for r in tried]),
        "truth kept": rate([r.kept for r in tried]),
        "wrongly UNKNOWN": rate([r.verdict == UNKNOWN for r in tried]),
        "other law: its family named alone": rate([r.named for r in other]),
        "other law: its family first": rate([r.first for r in other]),
        "other law: its family kept": rate([r.kept for r in other]),
        "other law: UNKNOWN": rate([r.verdict == UNKNOWN for r in other]),
        "outside: UNKNOWN": rate([r.verdict == UNKNOWN for r in outside]),
    }


def rate(outcomes: Sequence[bool]) -> dict[str, float]:
    """Count k of n with its interval; the whole range for n = 0."""
    k, n = sum(outcomes), len(outcomes)
    low, high = binomial_interval(k, n)
    return {"k": k, "n": n, "low": round(low, 4), "high": round(high, 4)}
