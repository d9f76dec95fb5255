"""Making a blind set: case folders that say nothing about their contents, and labels committed to apart from them."""

import hashlib
import json
import shutil
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from exodrake.blind.case_mix import CaseMix, draw_case, plan
from exodrake.blind.catalogue import ENTRIES, block_of
from exodrake.blind.commitment import COMMITMENT, write_committed
from exodrake.blind.simulator import simulate, warm_up
from exodrake.core.errors import InputError
from exodrake.core.files import write_text
from exodrake.core.parallel import each
from exodrake.core.progress import Count, no_progress
from exodrake.data.case import FILE, Case, CaseLog
from exodrake.data.case_folder import write_case
from exodrake.data.log import Log

NOISE_STD = {"tension": 0.01, "stroke": 12.3e-6, "angle": 0.005}  # N, m, rad
DECIMALS = {
    "time": 2,
    "tension_ref": 3,
    "tension": 3,
    "stroke": 6,
    "speed_cmd": 5,
    "angle": 4,
}  # as in the practice data
ROLES = {
    "sweeps_1": ("fit", None), "sweeps_2": ("fit", "sweeps_1.csv.gz"), "chirp": ("fit", None), "holds": ("fit", None),
    "grasps": ("holdout", None),
}  # fmt: skip
MARK = ".begun"  # of a set that is not complete
VISIBLE = 2.0  # noise standard deviations
ATTEMPTS = 6


def kind_of(column):
    """Column name without its wire or joint."""
    return column.rsplit("_", 1)[0] if column != "time" else column


def gap_in_noise(with_effect, without):
    """Gap per signal: RMS difference of two logs, in noise standard deviations."""
    gaps = {}
    for name, values in with_effect.items():
        if kind_of(name) in NOISE_STD:
            gaps[name] = float(np.sqrt(np.mean((values - without[name]) ** 2)) / NOISE_STD[kind_of(name)])
    return gaps


def held_out_gap(spec, without, protocol, seed):
    """Gap on a motion between two robots, noise-free; the same random courses in both."""
    logs = [simulate(replace(robot, noisy=False), protocol, seed) for robot in (spec, without)]
    return gap_in_noise(*logs)


def parts_gaps(case, seed):
    """What each effect of a case adds to the others (largest signal's gap, a list), and the gap of all, by signal."""
    motion, effects = case.protocols["grasps"], case.spec.effects
    whole = held_out_gap(case.spec, case.healthy, motion, seed)
    if len(effects) < 2:
        return [max(whole.values())] * len(effects), whole
    without = [
        replace(case.spec, effects=tuple(other for other in effects if other is not effect)) for effect in effects
    ]
    return [max(held_out_gap(case.spec, spec, motion, seed).values()) for spec in without], whole


def visible_case(plan):
    """Draw until every effect leaves a visible gap on the held-out motion, or the attempts run out: case, gaps per
    effect, gaps per signal.
    """
    best = draw_case(plan), [], {}
    for attempt in range(ATTEMPTS if plan.ids else 0):
        case = draw_case(plan, attempt)
        each, whole = parts_gaps(case, [*plan.seed, 4])
        if not best[1] or min(each) > min(best[1]):
            best = case, each, whole
        if min(each) >= VISIBLE:
            break
    return best


def label_of(plan, case, each, whole):
    """Label of a case."""
    effects = []
    for effect, gap in zip(case.spec.effects, each):
        entry = ENTRIES[effect.id]
        line = {
            "id": effect.id,
            "block": block_of(effect.id),
            "wires": list(effect.wires),
            "joints": list(effect.joints),
        }
        effects.append(line | {"parameters": effect.parameters, "exact": entry.exact, "gap": gap})
    largest = max(whole.values(), default=0.0)
    kind = {"kind": plan.kind, "effects": effects, "gap": largest, "gaps": whole, "unseen_motion": plan.unseen}
    return kind | {"numbers": {name: np.asarray(value).tolist() for name, value in case.spec.parameters.items()}}


def rounded(columns):
    """Columns with the digits a real log carries; floats print short."""
    return {name: np.round(values, DECIMALS[kind_of(name)]) + 0.0 for name, values in columns.items()}


def logs_of(case, name, seed):
    """The case with its logs as the reference simulator would have written them."""
    logs = []
    for index, (log, (role, repeats)) in enumerate(ROLES.items()):
        columns = rounded(simulate(case.spec, case.protocols[log], [*seed, 5, index]))
        time = columns.pop("time")
        logs.append(CaseLog(Log(time, columns), log, role, repeats, f"{log}.csv.gz"))
    return Case(name, {}, tuple(logs))


def case_and_label(plan):
    """A planned case with its logs, and its label; all of it follows from the plan's seed."""
    case, gaps, whole = visible_case(plan)
    return logs_of(case, plan.name, plan.seed), label_of(plan, case, gaps, whole)


def make_case(plan, folder):
    """Write one case into `folder` (kept if it is there already) and return its label."""
    case, label = case_and_label(plan)
    keep_case(case, Path(folder) / plan.name)
    return label


def keep_case(case, folder):
    """Write a case, whole or not at all, unless it is there."""
    if not (folder / FILE).is_file():
        write_case(case, folder)


def begin(folder, labels, stamp):
    """Open the folder for making. InputError if a set is finished there, or another one was started, or the labels
    would lie inside.
    """
    if folder.resolve() in labels.resolve().parents:
        raise InputError(f"{labels}: the labels would lie inside the cases' folder {folder}")
    if labels.exists():
        raise InputError(f"{labels}: already there; a committed set is not made over")
    if (folder / COMMITMENT).exists():
        raise InputError(f"{folder}: already committed; a committed set is not made over")
    folder.mkdir(parents=True, exist_ok=True)
    mark = folder / MARK
    if mark.is_file():
        if mark.read_text().strip() != stamp:
            raise InputError(f"{folder}: started with another seed, number of cases, mix or code")
    elif any(folder.iterdir()):
        raise InputError(f"{folder}: not empty")
    write_text(mark, stamp + "\n")
    for half in folder.glob(".*.part"):  # of a run that was killed
        shutil.rmtree(half)


def stamp_of(seed, cases, mix):
    """Digest of what a set follows from: seed, number of cases, mix, and the code of the reference simulator."""
    from exodrake.core.provenance import digest, source_files

    return hashlib.sha256(f"{seed} {cases} {mix} {digest(source_files(Path(__file__).parent))}".encode()).hexdigest()


def made(plan, folder, labels):
    """Label of a case that is there already, whole; else None. `labels`: folder of labels by case."""
    try:
        return json.loads((labels / f"{plan.name}.json").read_text()) if (folder / plan.name / FILE).is_file() else None
    except (OSError, ValueError):
        return None


def make(
    folder,
    seed,
    cases,
    labels=None,
    jobs=1,
    mix=None,
    cluster=None,
    progress: Count = no_progress,
):
    """Make a set: `folder`/case_xx, the commitment, and the labels file outside the folder; returns the labels' path.

    A case's folder appears whole, then its label in `labels`.part; the labels file and the commitment when all are
    there. An interrupted set is continued.

    Args:
        folder: of the set.
        seed: of everything in it.
        cases: how many.
        labels: labels file; `folder`-labels.json if None.
        jobs, cluster: as in `parallel.each`.
        mix: a `CaseMix`.
        progress: called with how many are made, have failed, and are wanted.
    Raises:
        InputError: for a bad number of cases, as `begin`, and for cases that could not be made, once all others are.
    """
    folder, mix = Path(folder), mix or CaseMix()
    labels = Path(labels) if labels else folder.with_name(folder.name + "-labels.json")
    if cases < 1:
        raise InputError(f"--cases {cases}: at least one case is wanted")
    begin(folder, labels, stamp_of(seed, cases, mix))
    parts = labels.with_name(labels.name + ".part")
    parts.mkdir(parents=True, exist_ok=True)
    plans = plan(seed, cases, mix)
    found = make_all(plans, folder, parts, jobs, cluster, progress)
    write_committed({item.name: found[item.name] for item in plans}, labels, folder / COMMITMENT)
    shutil.rmtree(parts)
    (folder / MARK).unlink()
    return labels


def make_all(plans, folder, parts, jobs, cluster, progress):
    """Labels by case, made or read back; InputError naming the cases that could not be made."""
    found = {item.name: label for item in plans if (label := made(item, folder, parts)) is not None}
    warm_up()
    waiting, failed = [item for item in plans if item.name not in found], {}
    progress(len(found), 0, len(plans))
    with closing(each(case_and_label, ((item,) for item in waiting), jobs, cluster)) as outcomes:
        for outcome in outcomes:
            name = waiting[outcome.number].name
            if outcome.reason is None:
                case, label = outcome.value
                found[name] = keep(name, case, label, folder, parts)
            else:
                failed[name] = outcome.reason
            progress(len(found), len(failed), len(plans))
    if failed:
        raise InputError(f"{folder}: not made: " + "; ".join(f"{name} ({why})" for name, why in sorted(failed.items())))
    return found


def keep(name, case, label, folder, parts):
    """Write a case, then its label; the label as it is read back."""
    keep_case(case, folder / name)
    text = json.dumps(label, indent=1) + "\n"
    write_text(parts / f"{name}.json", text)
    return json.loads(text)
