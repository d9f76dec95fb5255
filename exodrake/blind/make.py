"""Making a blind set: case folders that say nothing about their contents, and labels sealed apart from them."""

import hashlib
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.blind.catalogue import ENTRIES, block_of
from exodrake.blind.mix import CaseMix, draw_case, plan
from exodrake.blind.reality import simulate, warm_up
from exodrake.blind.seal import write_sealed
from exodrake.errors import InputError

FLOORS = {"tension": 0.01, "stroke": 12.3e-6, "angle": 0.005}  # N, m, rad
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
SEAL, BEGUN = "seal.txt", ".begun"
VISIBLE = 2.0  # floors
ATTEMPTS = 6


def kind_of(column):
    """Column name without its wire or joint."""
    return column.rsplit("_", 1)[0] if column != "time" else column


def gap_in_floors(with_effect, without):
    """Gap per signal: RMS difference of two logs, in floors."""
    gaps = {}
    for name, values in with_effect.items():
        if kind_of(name) in FLOORS:
            gaps[name] = float(np.sqrt(np.mean((values - without[name]) ** 2)) / FLOORS[kind_of(name)])
    return gaps


def held_out_gap(spec, without, protocol, seed):
    """Gap on a motion between two robots, noise-free; the same random courses in both."""
    logs = [simulate(replace(robot, noisy=False), protocol, seed) for robot in (spec, without)]
    return gap_in_floors(*logs)


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
    """What the sealed label says of a case."""
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
    return kind | {"numbers": {name: np.asarray(value).tolist() for name, value in case.spec.numbers.items()}}


def rounded(columns):
    """Columns with the digits a real log carries; floats print short."""
    return {name: np.round(values, DECIMALS[kind_of(name)]) + 0.0 for name, values in columns.items()}


def write_logs(case, name, folder, seed):
    """Case folder with case.yaml and its logs, whole or not at all."""
    from exodrake.case import Case, CaseLog, write_case
    from exodrake.log import Log

    logs = []
    for index, (log, (role, repeats)) in enumerate(ROLES.items()):
        columns = rounded(simulate(case.spec, case.protocols[log], [*seed, 5, index]))
        time = columns.pop("time")
        logs.append(CaseLog(Log(time, columns), log, role, repeats, f"{log}.csv.gz"))
    write_case(Case(name, {}, tuple(logs)), folder)


def make_case(plan, folder):
    """Make one case (kept if its folder is already there, since it follows from its seed) and return its label."""
    case, each, whole = visible_case(plan)
    target = Path(folder) / plan.name
    if not (target / "case.yaml").is_file():
        write_logs(case, plan.name, target, plan.seed)
    return label_of(plan, case, each, whole)


def begin(folder, labels, stamp):
    """Open the folder for making. InputError if a set is finished there, or another one was begun, or the labels
    would lie inside.
    """
    from exodrake.files import write_text

    if folder.resolve() in labels.resolve().parents:
        raise InputError(f"{labels}: the labels would lie inside the cases' folder {folder}")
    if labels.exists():
        raise InputError(f"{labels}: already there; a sealed set is not made over")
    if (folder / SEAL).exists():
        raise InputError(f"{folder}: already sealed; a sealed set is not made over")
    folder.mkdir(parents=True, exist_ok=True)
    mark = folder / BEGUN
    if mark.is_file():
        if mark.read_text().strip() != stamp:
            raise InputError(f"{folder}: begun with another seed, number of cases or mix")
    elif any(folder.iterdir()):
        raise InputError(f"{folder}: not empty")
    write_text(mark, stamp + "\n")


def make(folder, seed, cases, labels=None, jobs=1, mix=None, progress=None):
    """Make a set: `folder`/case_xx, `folder`/seal.txt, and the labels file outside it (default `folder`-labels.json).

    An interrupted set is taken up where it stopped. progress: called with the number of cases done. Returns the labels'
    path. InputError for bad numbers and as `begin`.
    """
    from joblib import Parallel, delayed

    folder, mix = Path(folder), mix or CaseMix()
    labels = Path(labels) if labels else folder.with_name(folder.name + "-labels.json")
    if cases < 1:
        raise InputError(f"--cases {cases}: at least one case is wanted")
    begin(folder, labels, hashlib.sha256(f"{seed} {cases} {mix}".encode()).hexdigest())
    warm_up()
    plans = plan(seed, cases, mix)
    found = {}
    work = (delayed(_named)(item, os.fspath(folder)) for item in plans)
    results: Any = Parallel(n_jobs=jobs, return_as="generator_unordered")(work)
    for name, label in results:
        found[name] = label
        if progress:
            progress(len(found))
    write_sealed({item.name: found[item.name] for item in plans}, labels, folder / SEAL)
    (folder / BEGUN).unlink()
    return labels


def _named(plan, folder):
    return plan.name, make_case(plan, folder)
