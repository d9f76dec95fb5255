"""What a designed experiment gains.

    exodrake blind make --seed 7 --cases 200 --out cases && exodrake blind run cases
    python -m studies.experiment cases --labels cases-labels.json --keep kept --motion designed --motion random
    python -m studies.experiment cases --labels cases-labels.json --keep kept --out experiment.md

Cases of the reference simulator that a diagnosis leaves ambiguous: the experiment that `exodrake experiment` designs
runs on the withheld robot, and the case is diagnosed again with that log; then the same with a random motion as long.
Labels serve to run the robot, and to count. What is measured is kept case by case: `--motion` measures what is missing.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import click
import numpy as np

from exodrake.cli.main import OneLineErrors
from exodrake.core.errors import markdown_table
from exodrake.core.files import write_text
from exodrake.core.parallel import one_blas_thread
from exodrake.core.schema import read_json
from exodrake.data.case import EXPERIMENT, Case, CaseLog, read_case
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import list_required, make_problem
from exodrake.diagnosis.result import Rival
from exodrake.engine.inputs import Reference
from exodrake.experiment.contest import Contest, information, prepare_contest
from exodrake.experiment.design import check_length, design
from exodrake.machines.robot_file import load_robot
from exodrake.reference.answers import ANSWER, find_cases
from exodrake.reference.make import record_log
from exodrake.reference.robot import RobotSpec
from exodrake.reference.score import count_share, found_ids, pair_shares
from exodrake.simulation.protocols import protocol
from studies.page_text import share
from studies.transfer.study import withheld

MOTIONS = DESIGNED, RANDOM = "designed", "random"
LOG_SEED = 9  # of the noise of further logs
SAME = 1.0  # T of two laws that write the same log: less than noise
TEXT = """Cases of the reference simulator whose stored answer is ambiguous, diagnosed with the effects of its causes
and their rivals. Those that still are ambiguous get one further log of a minute, of the motion that
`exodrake experiment` designs or of a random one as long, and are diagnosed again with it. Resolved: one explanation is
left, and it is the true one. T is what the rival that is distinguished worst would leave of the new log once it is
refitted, in variances of noise. The same log: T of a random motion is below 1, less than noise, and no experiment is
run."""


def measure(
    row: dict[str, Any], case: Case, spec: RobotSpec, truth: list[str], effects: frozenset[str],
    duration: float | None, motions: tuple[str, ...],
) -> Iterator[dict[str, Any]]:  # fmt: skip
    """Results of a case, as far as they are measured, piece by piece: its class, what each motion promises and leaves.

    `row` is what is measured already, truth the ids of the injected effects, `effects` the class that its stored answer
    leaves.
    """
    if "before" not in row:
        before, found = explain(case, effects)
        rivals = [{"effects": r.effects, "parameters": r.parameters} for r in found]
        row |= {"truth": truth, "before": before, "rivals": rivals}
        yield row
    if len(row["rivals"]) < 2 or set(motions) <= set(row.get("after", {})):
        return
    rivals = [Rival(tuple(r["effects"]), r["parameters"]) for r in row["rivals"]]
    contest = prepare_contest(make_problem(case, load_robot()), rivals)
    for motion in sorted(set(motions) - set(row.get("after", {})), key=lambda m: m == DESIGNED):
        known = [after for after in row.get("after", {}).values() if after.get("same")]
        reference, promised = (None, {"left": 0.0}) if known else choose_motion(motion, contest, duration)
        again = row["before"] | {"same": True}
        if reference is not None and promised["left"] >= SAME:
            log = record_log(spec, Reference(reference, EXPERIMENT), LOG_SEED)
            log = log.only(filter(case.logs[0].log.has, log.columns))
            logs = (*case.logs, CaseLog(log, EXPERIMENT, "fit", None, "experiment.csv"))
            again, _ = explain(replace(case, logs=logs), effects)
        row.setdefault("promised", {})[motion] = promised
        row.setdefault("after", {})[motion] = again
        yield row


def choose_motion(motion: str, contest: Contest, duration: float | None) -> tuple[np.ndarray, dict[str, Any]]:
    """A motion (frames, references) [SI], designed or random, and what it promises."""
    started, robot = process_time(), contest.problem.robot
    if motion == DESIGNED:
        made = design(contest, duration)
        reference, found = made.reference.values, made.information
    else:
        length = check_length(robot, duration) * robot.machine.frame
        reference = protocol(f"random-motion:seed=0,duration={length:g}", robot).values
        found = information(contest, reference)
    left = found.left[found.closest] if found else 0.0
    probability = found.probability if found else 0.0
    return reference, {"probability": probability, "left": left, "time": process_time() - started}


def explain(case: Case, effects: frozenset[str]) -> tuple[dict[str, Any], tuple[Rival, ...]]:
    """Verdict of a case by some effects, with causes and their rivals, and the explanations still in play."""
    made = diagnose(case, tried=effects)
    causes = [e for e in made.effects if e.role == "cause"]
    left = [cause.id for cause in causes] + [rival.id for cause in causes for rival in cause.rivals]
    return {"verdict": made.verdict, "causes": [c.id for c in causes], "class": left}, made.rivals


def make_page(rows: dict[str, dict[str, Any]], command: str) -> str:
    """The page, from what was measured by case."""
    used = {name: row for name, row in rows.items() if row.get("after")}
    totals, kinds, cases = [], [], []
    for motion in MOTIONS:
        run = [row for row in used.values() if motion in row["after"]]
        right = count_resolved(run, motion)
        wrong = sum(row["after"][motion]["verdict"] == "NAMED" for row in run) - right
        totals.append((motion, share(right, len(run)), wrong))
    for kind in sorted({", ".join(sorted(row["before"]["class"])) for row in used.values()}):
        some = [row for row in used.values() if ", ".join(sorted(row["before"]["class"])) == kind]
        run = [[row for row in some if motion in row["after"]] for motion in MOTIONS]
        counts = [f"{count_resolved(part, m)} of {len(part)}" for part, m in zip(run, MOTIONS, strict=True)]
        kinds.append((kind, len(some), *counts))
    for name, row in used.items():
        left = ", ".join(f"{row['promised'][m]['left']:.0f}" if m in row["promised"] else "-" for m in MOTIONS)
        after = []
        for motion in MOTIONS:
            found = row["after"].get(motion)
            after.append("not measured" if found is None else "the same log" if found.get("same") else describe(found))
        cases.append((name, ", ".join(row["truth"]) or "healthy", ", ".join(row["before"]["class"]), left, *after))
    by = ("effects that are to be told apart", "cases", "by the designed", "by the random motion")
    head = ("case", "true", "class before", "T designed, random", "after the designed", "after a random one")
    parts = ["# The next experiment, measured", TEXT, f"    {command}"]
    parts += [markdown_table(("motion", "resolved", "one left, but not the true one"), totals)]
    parts += [compare_motions(list(used.values())), markdown_table(by, kinds), markdown_table(head, cases)]
    if decided := {name: row for name, row in rows.items() if len(row["before"]["class"]) < 2}:
        listed = [f"- {n}, {', '.join(r['truth']) or 'healthy'}: {describe(r['before'])}" for n, r in decided.items()]
        parts += ["No longer ambiguous, without a further log:", "\n".join(listed)]
    return "\n\n".join(parts) + "\n"


def compare_motions(rows: list[dict[str, Any]]) -> str:
    """Cases that either motion alone resolves, of those that have both, with McNemar's exact test."""
    tried = {k: row for k, row in enumerate(rows) if set(MOTIONS) <= set(row["after"])}
    if not tried:
        return "No case has both motions yet."
    found = pair_shares(*(count_share({k: is_resolved(row, motion) for k, row in tried.items()}) for motion in MOTIONS))
    return (
        f"Of {len(tried)} cases with both motions {found.both} are resolved by either one, {found.first} by the "
        f"designed one alone, {found.second} by the random one alone (McNemar's exact test: p = {found.p:.2g})."
    )


def is_resolved(row: dict[str, Any], motion: str) -> bool:
    """Whether one explanation is left after a motion, and it is the true one."""
    after = row["after"][motion]
    return after["verdict"] == "NAMED" and sorted(after["causes"]) == sorted(row["truth"])


def count_resolved(rows: list[dict[str, Any]], motion: str) -> int:
    """Number of cases that a motion resolved."""
    return sum(is_resolved(row, motion) for row in rows)


def describe(after: dict[str, Any]) -> str:
    """A verdict with what is left."""
    return f"{after['verdict']} {', '.join(after['class'])}".strip()


@click.command(cls=OneLineErrors)
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--labels", multiple=True, type=click.Path(exists=True, path_type=Path), help="Of each set, in order.")
@click.option("--cases", default="", metavar="NAME,...", help="SET/CASE of these alone.")
@click.option("--duration", type=float, default=None, help="Of an experiment [the designer's own].")
@click.option("--motion", "motions", multiple=True, type=click.Choice(MOTIONS), help="Measure it where it is missing.")
@click.option("--keep", required=True, type=click.Path(path_type=Path), help="Folder of what is measured, by case.")
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Write the page.")
def command(
    folders: tuple[Path, ...], labels: tuple[Path, ...], cases: str, motions: tuple[str, ...], duration: float | None,
    keep: Path, out: Path | None,
) -> None:  # fmt: skip
    """Measure what the designed experiment resolves on ambiguous cases of the sets in FOLDERS."""
    if len(labels) != len(folders):
        raise click.UsageError("one --labels for each set")
    rows, wanted, machine = {}, list(filter(None, cases.split(","))), load_robot().machine
    for folder, file in zip(folders, labels, strict=True):
        known = json.loads(file.read_text())
        listed = [folder / n.split("/")[1] for n in wanted if n.split("/")[0] == folder.name]
        answers = {case: read_json(case / ANSWER) for case in listed or find_cases(folder) if (case / ANSWER).is_file()}
        for case, answer in answers.items():
            if not listed and (wanted or answer.get("verdict") != "AMBIGUOUS"):
                continue
            name, place = f"{folder.name}/{case.name}", keep / f"{folder.name}-{case.name}.json"
            row = rows[name] = json.loads(place.read_text()) if place.is_file() else {}
            if motions or not place.is_file():
                label = known.get("cases", known)[case.name]
                truth = [effect["id"] for effect in label["effects"]]
                effects = frozenset(effect["id"] for effect in answer["effects"]) | found_ids(answer)
                read, spec = read_case(case, list_required(machine), machine.frame), withheld(case.name, label)
                keep.mkdir(parents=True, exist_ok=True)
                with one_blas_thread():
                    for kept in measure(row, read, spec, truth, effects, duration, motions):
                        write_text(place, json.dumps(kept, indent=1) + "\n")
            after = "; ".join(f"{motion}: {describe(found)}" for motion, found in row.get("after", {}).items())
            click.echo(f"{name}: {', '.join(row['truth'])}: {describe(row['before'])}; {after}")
    if out:
        sets = " ".join(folder.name for folder in folders) + " --labels LABELS" * len(folders)
        command = f"python -m studies.experiment {sets} --keep kept --out experiment.md"
        write_text(out, make_page(rows, command))


if __name__ == "__main__":
    command()
