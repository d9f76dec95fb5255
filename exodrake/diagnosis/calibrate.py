"""Error rates of the diagnosis as it is, on simulated robots of a machine.

Every third robot is healthy: its parameters are drawn within their tolerances. The others have one effect of the
library each, also one that is not tried: another law of a tried effect, as a real robot has. The limits of the alarm of
a monitor are measured on healthy robots, too.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.parallel import each
from exodrake.core.progress import Count, no_progress
from exodrake.data.case import Case, CaseLog
from exodrake.data.log import fill_columns
from exodrake.diagnosis import calibration as rates
from exodrake.diagnosis.result import CAUSE, NO_GAP, RETUNE, UNKNOWN, Diagnosis
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import load_robot
from exodrake.model.effect import Effect, EffectParameter
from exodrake.model.robot import Robot, drawn_robot
from exodrake.simulation import protocols
from exodrake.simulation.protocols import reference_rows
from exodrake.simulation.simulate import run, write_log

SEEDS = 2**31  # of noise and motion
EACH_HEALTHY = 3  # one robot in so many is healthy
# draws of a robot at most, and times the motion's largest value from which it counts as unstable: no such is recorded
DRAWS, DIVERGED = 20, 1e6


@dataclass(frozen=True)
class Record:
    """Verdict on one simulated robot."""

    effect: str  # id of its effect; empty for a healthy robot
    verdict: str
    named: bool = False  # its effect is the only cause, without a rival
    in_class: bool = False  # it, or another law of its family and block, is a cause or a rival of one
    causes: int = 0  # number of causes
    covered: tuple[bool, ...] = ()  # for each true parameter of a named effect, whether its interval holds it
    seconds: float = field(default=0.0, compare=False)  # that the diagnosis took


def calibrate(
    robot: str, cases: int, seed: int = 0, case: Case | None = None, jobs: int = 1, cluster: str | None = None,
    progress: Count = no_progress, seconds: float = float("inf"),
) -> tuple[list[Record], dict[int, str]]:  # fmt: skip
    """Records of simulated robots, the same whatever `jobs` is if the time suffices, and reasons of failures by number.

    robot: name of a machine, or robot file. cases: number of robots. seed: of everything that is drawn. case: whose
    motion they follow; the machine's own experiments if None. jobs, cluster: as in `parallel.each`. progress: called
    with the numbers of done, failed and all robots. seconds: that all robots may take; one that may end later, as long
    as the slowest took so far, is not begun. InputError as `parallel.each`, and for a machine without experiments where
    no case is given.
    """
    machine, end = load_robot(robot).machine, time.monotonic() + seconds
    if case is None and not machine.experiments:
        raise InputError(f"{machine.name} declares no experiments of its own; --case CASE gives the motion")

    def tasks() -> Iterator[tuple[str, Case | None, int, int]]:
        for k in range(cases):
            slowest = max((r.seconds for r in found.values()), default=0.0)
            if k and time.monotonic() + slowest >= end:
                return
            yield robot, case, seed, k

    found, failed = dict[int, Record](), dict[int, str]()
    for outcome in each(simulated_robot, tasks(), jobs, cluster):
        if outcome.reason is None:
            found[outcome.number] = outcome.value
        else:
            failed[outcome.number] = outcome.reason
        progress(len(found), len(failed), cases)
    return [found[k] for k in sorted(found)], failed


def simulated_robot(robot: str, case: Case | None, seed: int, number: int) -> Record:
    """The record of one robot, drawn by the seed and its number."""
    from exodrake.diagnosis.pipeline import diagnose

    nominal, rng = load_robot(robot), np.random.default_rng([seed, number])
    nominal = nominal.with_parameters(case.robot, source=case.name) if case else nominal
    motion = case or healthy_case(nominal, int(rng.integers(SEEDS)))
    for _ in range(DRAWS):
        drawn, effect = drawn_robot(nominal, rng), ""
        if number % EACH_HEALTHY:
            one = nominal.machine.effects[rng.integers(len(nominal.machine.effects))]
            drawn, effect = with_effect(drawn, one, rng), one.id
        logs = follow_case(motion, drawn, rng)
        if largest(logs) < DIVERGED * largest(motion):
            break
    return record(diagnose(logs, nominal), drawn, effect)


def healthy_case(nominal: Robot, seed: int) -> Case:
    """Logs of a healthy robot: short sweeps, a chirp and holds to fit, random motion held out."""
    robot = drawn_robot(nominal, np.random.default_rng(seed))
    plan = {
        "sweeps": protocols.short_sweeps(nominal),
        "chirp": protocols.chirp(nominal),
        "holds": protocols.holds(nominal, seed=seed),
        "random": protocols.random_motion(nominal, seed=seed),
    }
    logs = [
        CaseLog(log, name, "holdout" if name == "random" else "fit", None, f"{name}.csv")
        for k, (name, reference) in enumerate(plan.items())
        for log in [write_log(run(robot, reference, seed=1000 * seed + k))]
    ]
    return Case(f"healthy {seed}", {}, tuple(logs))


def with_effect(robot: Robot, effect: Effect, rng: np.random.Generator) -> Robot:
    """The robot with an effect on a random set of channels, its parameters drawn in their plausible ranges."""
    axis = robot.machine.axes.of(effect.axis)
    channels = sorted(rng.permutation(len(axis))[: rng.integers(1, len(axis) + 1)])
    names = [axis[i] for i in channels] if effect.axis else []
    drawn = {
        p.name: {c: draw_value(p, rng) for c in names} if p.axis else draw_value(p, rng) for p in effect.parameters
    }
    return robot.splice(effect.id, drawn, names)


def draw_value(info: EffectParameter, rng: np.random.Generator) -> float:
    """A value in the plausible range of a parameter [its unit], log-uniform where a fit sees its log or inverse."""
    if not info.fitted:
        return info.initial
    if info.transform != "linear" and info.low > 0.0:
        return math.exp(rng.uniform(math.log(info.low), math.log(info.high)))
    return rng.uniform(info.low, info.high)


def follow_case(case: Case, robot: Robot, rng: np.random.Generator) -> Case:
    """The case with the logs that a robot writes on its references: the same roles, repeats, columns and gaps."""
    logs = []
    for item in case.logs:
        reference = Reference(fill_columns(reference_rows(robot.machine, item.log)), item.file)
        log = write_log(run(robot, reference, seed=int(rng.integers(SEEDS))))
        seen = [name for name in log.columns if item.log.has(name)]
        gaps = {name: np.where(np.isfinite(item.log[name]), log[name], np.nan) for name in seen}
        logs.append(replace(item, log=log.only(seen).with_signals(gaps)))
    return replace(case, robot={}, logs=tuple(logs), notes=())


def largest(case: Case) -> float:
    """Largest value of all signals of a case [SI]; infinite where a simulated robot's are not finite."""
    return float(np.nanmax(np.abs(np.concatenate([item.log[name] for item in case.logs for name in item.log.columns]))))


def record(answer: Diagnosis, true: Robot, effect: str) -> Record:
    """Record of an answer on a robot with an effect; `effect` is empty for a healthy one."""
    causes, covered = [e for e in answer.effects if e.role == CAUSE], list[bool]()
    if not effect:
        return Record("", answer.verdict, causes=len(causes), seconds=answer.run_time)
    named = len(causes) == 1 and causes[0].id == effect and not causes[0].rivals
    stood = {i for e in causes for i in (e.id, *(rival.id for rival in e.rivals))}
    for name, values in true.effects()[effect].items() if named else ():
        pooled = causes[0].parameters.get(name)
        intervals = causes[0].channels.get(name) or {c: pooled for c, v in values.items() if pooled and v != 0.0}
        for channel, interval in intervals.items():
            if channel in values and np.isfinite([values[channel], interval.low, interval.high]).all():
                covered.append(bool(interval.low <= values[channel] <= interval.high))
    known, others = true.machine.effect(effect), true.machine.effects
    laws = {e.id for e in others if e.family and (e.family, e.block) == (known.family, known.block)}
    in_class = bool(stood & {effect, *laws})
    return Record(effect, answer.verdict, named, in_class, len(causes), tuple(covered), answer.run_time)


def count_rates(records: Sequence[Record]) -> dict[str, tuple[int, int]]:
    """Error rates: rate of `calibration.RATES` -> count k of n."""
    healthy, ill = ([r for r in records if bool(r.effect) == wanted] for wanted in (False, True))
    covered = [one for r in ill for one in r.covered]
    return {
        rates.ALARM: (sum(r.causes > 0 for r in healthy), len(healthy)),
        rates.NAMED: (sum(r.named for r in ill), len(ill)),
        rates.CLASS: (sum(r.in_class for r in ill), len(ill)),
        rates.UNKNOWN: (sum(r.verdict == UNKNOWN for r in ill), len(ill)),
        rates.UNSEEN: (sum(r.verdict in (NO_GAP, RETUNE) for r in ill), len(ill)),
        rates.COVERED: (sum(covered), len(covered)),
    }
