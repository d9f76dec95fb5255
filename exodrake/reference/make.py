"""Makes a blind set: case folders that say nothing about their contents, and labels committed to apart from them.

Effects are drawn until the gap that they leave on the held-out motion is large, or small, enough. Gap of a signal: root
mean square of the difference between two noise-free logs, in noise standard deviations.
"""

import hashlib
import json
import shutil
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import write_text
from exodrake.core.parallel import each
from exodrake.core.progress import Count, no_progress
from exodrake.core.provenance import digest
from exodrake.data.case import FILE, Case, CaseLog, write_case
from exodrake.data.log import Log
from exodrake.reference.answers import COMMITMENT, write_committed
from exodrake.reference.cases import MIXES, CaseMix, CasePlan, DrawnCase, draw_case, plan
from exodrake.reference.faults import ENTRIES, find_blocks, weaken
from exodrake.reference.robot import JOINTS, WIRES, RobotSpec
from exodrake.reference.simulator import simulate, warm_up

Columns = dict[str, np.ndarray]  # column -> values (n,) [SI]
Gaps = dict[str, float]  # signal -> gap [noise standard deviations]
NOISE_STD = {"tension": 0.01, "stroke": 12.3e-6, "angle": 0.005}  # N, m, rad
ATTEMPTS = 6  # draws of magnitudes and channels
BISECTIONS = 12
WEAKEST = 1e-3  # strength of an effect, relative to its draw, that counts as absent [assumed]


def strip_channel(column: str) -> str:
    """Column name without its wire or joint."""
    return column.rsplit("_", 1)[0] if column != "time" else column


def gap_in_noise(with_effect: Columns, without: Columns) -> Gaps:
    """Gap per signal between two logs."""
    gaps = {}
    for name, values in with_effect.items():
        if strip_channel(name) in NOISE_STD:
            gaps[name] = float(np.sqrt(np.mean((values - without[name]) ** 2)) / NOISE_STD[strip_channel(name)])
    return gaps


def parts_gaps(case: DrawnCase, seed: list[int], hidden: tuple[str, ...] = ()) -> tuple[list[float], Gaps]:
    """Gaps of a case on the held-out motion, with the same random courses in all robots, but of hidden kinds.

    Returns:
        What each effect adds to the others, a list of the largest signal's gap; and the gap of all by signal.
    """

    def gaps(without: RobotSpec) -> Gaps:
        robots = (replace(robot, noisy=False) for robot in (case.spec, without))
        found = gap_in_noise(*(simulate(robot, case.protocols[HELD_OUT], seed) for robot in robots))
        return {name: gap for name, gap in found.items() if strip_channel(name) not in hidden}

    effects, whole = case.spec.effects, gaps(replace(case.spec, effects=()))
    if len(effects) < 2:
        return [max(whole.values())] * len(effects), whole
    others = [tuple(other for other in effects if other is not effect) for effect in effects]
    return [max(gaps(replace(case.spec, effects=rest)).values()) for rest in others], whole


Label = dict[str, Any]
# digits that a real log carries, as in the practice data
DECIMALS = {"time": 2, "tension_ref": 3, "tension": 3, "stroke": 6, "speed_cmd": 5, "angle": 4}
HELD_OUT, REPEATS = "grasps", {"sweeps_2": "sweeps_1.csv.gz"}  # the other logs are fitted
MARK = ".incomplete"  # of a set that is not complete


def make_label(plan: CasePlan, case: DrawnCase, each: list[float], whole: Gaps) -> Label:
    """Label of a case: kind, mix, true effects with the channels they act on, gaps and nominal parameters."""
    effects = []
    for effect, gap in zip(case.spec.effects, each):
        entry, blocks = ENTRIES[effect.id], find_blocks(effect.id)
        channels = (*effect.wires, *effect.joints, *entry.channels)
        seats = {key: [c for c in channels if c in names] for key, names in (("wires", WIRES), ("joints", JOINTS))}
        label = {"id": effect.id, "block": blocks[0], "blocks": list(blocks), **seats}
        effects.append(label | {"parameters": effect.parameters, "exact": entry.exact, "gap": gap})
    parameters = {name: np.asarray(value).tolist() for name, value in case.spec.parameters.items()}
    return {
        "kind": plan.kind, "mix": plan.mix.name, "effects": effects, "gap": max(whole.values(), default=0.0),
        "gaps": whole, "unseen_motion": plan.unseen, "numbers": parameters,
    }  # fmt: skip


def round_columns(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Round columns (n,) [SI] to the digits a real log carries; floats print short."""
    return {name: np.round(values, DECIMALS[strip_channel(name)]) + 0.0 for name, values in columns.items()}


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
    for index, (log, protocol) in enumerate(case.protocols.items()):
        columns = round_columns(simulate(case.spec, protocol, [*plan.seed, 5, index]))
        columns = {name: values for name, values in columns.items() if strip_channel(name) not in plan.mix.hidden}
        time = columns.pop("time")
        role = "holdout" if log == HELD_OUT else "fit"
        logs.append(CaseLog(Log(time, columns), log, role, REPEATS.get(log), f"{log}.csv.gz"))
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

    A case's folder appears whole, then its label in `labels`.part; the labels file and the commitment when all are
    there. An interrupted set is continued. Everything in it follows from the seed; `cases` is the number of each mix,
    `labels` the path that is returned, `folder`-labels.json if None; `jobs` and `cluster` are as in `parallel.each`.

    Raises:
        InputError: For a bad number of cases, a set that is finished there, another one that was started, labels inside
            the folder, and naming cases that could not be made.
    """
    folder = Path(folder)
    labels = Path(labels) if labels else folder.with_name(folder.name + "-labels.json")
    if cases < 1:
        raise InputError(f"--cases {cases}: at least one case is wanted")
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
    parts = labels.with_name(labels.name + ".part")  # labels by case until all are there
    parts.mkdir(parents=True, exist_ok=True)
    plans, found, failed = plan(seed, cases, *mixes), {}, {}
    for item in plans:
        if (folder / item.name / FILE).is_file():
            with suppress(OSError, ValueError):
                found[item.name] = json.loads((parts / f"{item.name}.json").read_text())
    warm_up()
    waiting = [item for item in plans if item.name not in found]
    progress(len(found), 0, len(plans))
    with closing(each(case_and_label, ((item,) for item in waiting), jobs, cluster)) as outcomes:
        for outcome in outcomes:
            name = waiting[outcome.number].name
            if outcome.reason is None:
                case, label = outcome.value
                if not (folder / name / FILE).is_file():
                    write_case(case, folder / name)
                text = json.dumps(label, indent=1) + "\n"
                write_text(parts / f"{name}.json", text)
                found[name] = json.loads(text)
            else:
                failed[name] = outcome.reason
            progress(len(found), len(failed), len(plans))
    if failed:
        why = "; ".join(f"{name} ({reason})" for name, reason in sorted(failed.items()))
        raise InputError(f"{folder}: not made: {why}")
    write_committed({item.name: found[item.name] for item in plans}, labels, folder / COMMITMENT)
    shutil.rmtree(parts)
    mark.unlink()
    return labels
