"""Makes a blind set: case folders that say nothing about their contents, and labels committed to apart from them.

Effects are drawn until the gap that they leave on the held-out motion is large, or small, enough. Gap of a signal: root
mean square of the difference between two noise-free logs, in noise standard deviations.
"""

import hashlib
import json
import shutil
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import write_text
from exodrake.core.parallel import each
from exodrake.core.progress import Count, no_progress
from exodrake.core.provenance import digest
from exodrake.core.schema import read_json
from exodrake.data.case import FILE, Case, CaseLog, write_case
from exodrake.data.log import Log
from exodrake.engine.inputs import Reference
from exodrake.reference.answers import COMMITMENT, write_committed
from exodrake.reference.cases import MIXES, CaseMix, CasePlan, DrawnCase, draw_case, plan
from exodrake.reference.faults import ENTRIES, find_blocks, weaken
from exodrake.reference.robot import JOINTS, WIRES, InjectedFault, RobotSpec
from exodrake.reference.simulator import simulate, warm_up

Columns = dict[str, np.ndarray]  # column -> values (n,) [SI]
Gaps = dict[str, float]  # signal -> gap [noise standard deviations]
Label = dict[str, Any]
NOISE_STD = {"tension": 0.01, "stroke": 12.3e-6, "angle": 0.005}  # N, m, rad
# digits that a real log carries, as in the practice data
DECIMALS = {"time": 2, "tension_ref": 3, "tension": 3, "stroke": 6, "speed_cmd": 5, "angle": 4}
ATTEMPTS = 6  # draws of magnitudes and channels
BISECTIONS = 12
WEAKEST = 1e-3  # strength of an effect, relative to its draw, that counts as absent [assumed]
HELD_OUT, REPEATS = "grasps", {"sweeps_2": "sweeps_1.csv.gz"}  # the other logs are fitted
MARK = ".incomplete"  # of a set that is not complete


def strip_channel(column: str) -> str:
    """Column name without its wire or joint."""
    return column.rpartition("_")[0] or column


def record_log(spec: RobotSpec, motion: Reference, seed: int | list[int], file: str = "") -> Log:
    """Log of a robot, rounded to the digits that a real one carries, so that floats print short."""
    columns = simulate(spec, motion, seed)
    rounded = {name: np.round(values, DECIMALS[strip_channel(name)]) + 0.0 for name, values in columns.items()}
    return Log(rounded.pop("time"), rounded, {}, file)


def gap_in_noise(with_effect: Columns, without: Columns, hidden: tuple[str, ...] = ()) -> Gaps:
    """Gap per signal between two logs, but of hidden kinds."""
    gaps = {}
    for name, values in with_effect.items():
        kind = strip_channel(name)
        if kind in NOISE_STD and kind not in hidden:
            gaps[name] = float(np.sqrt(np.mean((values - without[name]) ** 2)) / NOISE_STD[kind])
    return gaps


def parts_gaps(case: DrawnCase, seed: list[int], hidden: tuple[str, ...] = ()) -> tuple[list[float], Gaps]:
    """Gaps of a case on the held-out motion, with the same random courses in all robots, but of hidden kinds.

    Returns:
        What each effect adds to the others, a list of the largest signal's gap; and the gap of all by signal.
    """

    def gaps(*effects: InjectedFault) -> Gaps:
        robots = (replace(case.spec, effects=some, noisy=False) for some in (case.spec.effects, effects))
        return gap_in_noise(*(simulate(robot, case.protocols[HELD_OUT], seed) for robot in robots), hidden=hidden)

    effects, whole = case.spec.effects, gaps()
    if len(effects) < 2:
        return [max(whole.values())] * len(effects), whole
    return [max(gaps(*(e for e in effects if e is not left)).values()) for left in effects], whole


def make_label(plan: CasePlan, case: DrawnCase, each: list[float], whole: Gaps) -> Label:
    """Label of a case: kind, mix, true effects with the channels they act on, gaps and nominal parameters."""
    effects = []
    for effect, gap in zip(case.spec.effects, each):
        entry, blocks = ENTRIES[effect.id], find_blocks(effect.id)
        channels = (*effect.channels, *entry.channels)
        seats = {key: [c for c in channels if c in names] for key, names in (("wires", WIRES), ("joints", JOINTS))}
        label = {"id": effect.id, "block": blocks[0], "blocks": list(blocks), **seats}
        effects.append(label | {"parameters": effect.parameters, "exact": entry.exact, "gap": gap})
    parameters = {name: np.asarray(value).tolist() for name, value in case.spec.parameters.items()}
    return {
        "kind": plan.kind, "mix": plan.mix.name, "effects": effects, "gap": max(whole.values(), default=0.0),
        "gaps": whole, "unseen_motion": plan.unseen, "numbers": parameters,
    }  # fmt: skip


def case_and_label(plan: CasePlan) -> tuple[Case, Label]:
    """Make a planned case with its logs, and its label; all of it follows from the plan's seed."""
    # drawn until the gap of the effects on the held-out motion is as wanted, or the attempts run out
    best, low_gap, high_gap = (draw_case(plan), [], {}), *plan.mix.gap

    def miss(gaps: list[float]) -> float:
        return max(low_gap - min(gaps), min(gaps) - high_gap, 0.0)

    for attempt in range(ATTEMPTS if plan.ids else 0):
        drawn, seed = draw_case(plan, attempt), [*plan.seed, 4]
        found, (low, high) = (drawn, *parts_gaps(drawn, seed, plan.mix.hidden)), (WEAKEST, 1.0)
        for _ in range(BISECTIONS if min(found[1]) > high_gap else 0):  # in the strength of the effects
            strength = float(np.sqrt(low * high))
            effects = tuple(weaken(effect, strength) for effect in drawn.spec.effects)
            weaker = replace(drawn, spec=replace(drawn.spec, effects=effects))
            found = (weaker, *parts_gaps(weaker, seed, plan.mix.hidden))
            if miss(found[1]) == 0.0:
                break
            low, high = (low, strength) if min(found[1]) > high_gap else (strength, high)
        if not best[1] or miss(found[1]) < miss(best[1]):
            best = found
        if miss(best[1]) == 0.0:
            break
    case, gaps, whole = best
    logs = []
    for index, (name, motion) in enumerate(case.protocols.items()):
        log = record_log(case.spec, motion, [*plan.seed, 5, index])
        log = log.only(c for c in log.columns if strip_channel(c) not in plan.mix.hidden)
        role = "holdout" if name == HELD_OUT else "fit"
        logs.append(CaseLog(log, name, role, REPEATS.get(name), f"{name}.csv.gz"))
    return Case(plan.name, {}, tuple(logs)), make_label(plan, case, gaps, whole)


def make_case(plan: CasePlan, folder: str | Path) -> Label:
    """Write one case into `folder`, whole or not at all, unless it is there already; return its label."""
    case, label = case_and_label(plan)
    if not (Path(folder) / plan.name / FILE).is_file():
        write_case(case, Path(folder) / plan.name)
    return label


def make(
    folder: str | Path, seed: int, cases: int, labels: str | Path | None = None, jobs: int = 1,
    mixes: Sequence[CaseMix] = (MIXES["standard"],), cluster: str | None = None, progress: Count = no_progress,
) -> Path:  # fmt: skip
    """Make a set: case folders, the commitment, and the labels file outside the folder.

    A case's label appears in `labels`.part, then its folder, whole; the labels file and the commitment when all are
    there. An interrupted set is continued. Everything in it follows from the seed; `cases` is the number of each mix,
    `labels` the path that is returned, `folder`-labels.json if None; `jobs` and `cluster` are as in `parallel.each`.

    Raises:
        InputError: For a set that is finished there, another one that was started, labels inside the folder, and
            naming cases that could not be made.
    """
    folder = Path(folder)
    labels = Path(labels) if labels else folder.with_name(folder.name + "-labels.json")
    if folder.resolve() in labels.resolve().parents:
        raise InputError(f"{labels}: the labels would lie inside the cases' folder {folder}")
    if labels.exists():
        raise InputError(f"{labels}: already there; a committed set is not made over")
    if (folder / COMMITMENT).exists():
        raise InputError(f"{folder}: already committed; a committed set is not made over")
    folder.mkdir(parents=True, exist_ok=True)
    code, mark = digest(Path(__file__).parent), folder / MARK
    stamp = hashlib.sha256(f"{seed} {cases} {mixes} {code}".encode()).hexdigest()  # of what the set follows from
    if mark.is_file():
        if mark.read_text().strip() != stamp:
            raise InputError(f"{folder}: started with another seed, number of cases, mix or code")
    elif any(folder.iterdir()):
        raise InputError(f"{folder}: not empty")
    write_text(mark, stamp + "\n")
    for half in folder.glob(".*.part"):  # of a run that was killed
        shutil.rmtree(half)
    plans, failed = plan(seed, cases, *mixes), dict[str, str]()
    kept = labels.with_name(labels.name + ".part")  # labels by case until all are there
    kept.mkdir(parents=True, exist_ok=True)
    label_files = {item.name: kept / f"{item.name}.json" for item in plans}
    waiting = [item for item in plans if not (folder / item.name / FILE).is_file()]
    warm_up()
    made = len(plans) - len(waiting)
    progress(made, 0, len(plans))
    with closing(each(case_and_label, ((item,) for item in waiting), jobs, cluster)) as outcomes:
        for outcome in outcomes:
            name = waiting[outcome.number].name
            if outcome.reason is None:
                case, label = outcome.value
                write_text(label_files[name], json.dumps(label))
                write_case(case, folder / name)
                made += 1
            else:
                failed[name] = outcome.reason
            progress(made, len(failed), len(plans))
    if failed:
        why = "; ".join(f"{name} ({reason})" for name, reason in sorted(failed.items()))
        raise InputError(f"{folder}: not made: {why}")
    write_committed({name: read_json(file) for name, file in label_files.items()}, labels, folder / COMMITMENT)
    shutil.rmtree(kept)
    mark.unlink()
    return labels
