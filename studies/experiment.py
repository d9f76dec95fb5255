"""What a designed experiment gains: `docs/experiment.md`.

    exodrake blind make --seed 7 --cases 200 --out cases && exodrake blind run cases
    python -m studies.experiment cases --labels cases-labels.json --keep kept --motion designed --motion random
    python -m studies.experiment cases --labels cases-labels.json --keep kept --out docs/experiment.md

Cases of the reference simulator that a diagnosis leaves ambiguous: the experiment that `exodrake experiment` designs
runs on the withheld robot, and the case is diagnosed again with that log; then the same with a random motion as long.
Labels serve to run the robot, and to count. What is measured is kept case by case: `--motion` measures what is missing.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from exodrake.cli.main import OneLineErrors
from exodrake.reference.measures import found_ids
from studies.experiment_page import DESIGNED, MOTIONS, page, said

if TYPE_CHECKING:
    from exodrake.data.case import Case
    from exodrake.diagnosis.result import Rival
    from exodrake.experiment.contest import Contest
    from exodrake.reference.robot import RobotSpec

LOG_SEED = 9  # of the noise of further logs
SAME = 1.0  # T of two laws that write the same log: less than noise


def measured(
    row: dict[str, Any], case: Case, spec: RobotSpec, truth: list[str], effects: frozenset[str],
    duration: float | None, motions: tuple[str, ...],
) -> Iterator[dict[str, Any]]:  # fmt: skip
    """Results of a case, as far as they are measured, piece by piece.

    Args:
        row: what is measured already: its class with the rivals, and for each motion what it promises and leaves.
        case: the case.
        spec: its robot.
        truth: ids of the injected effects.
        effects: those of the class that its stored answer leaves.
        duration: length of the experiment [s].
        motions: those wanted.
    """
    from exodrake.diagnosis.problem import make_problem
    from exodrake.diagnosis.result import Rival
    from exodrake.experiment.contest import contest_of
    from exodrake.experiment.motion import default_duration
    from exodrake.machines.robot_file import load_robot

    robot = load_robot()
    if "before" not in row:
        before, found = explained(case, effects)
        rivals = [{"effects": r.effects, "parameters": r.parameters} for r in found]
        row |= {"truth": truth, "before": before, "rivals": rivals}
        yield row
    if len(row["rivals"]) < 2 or set(motions) <= set(row.get("after", {})):
        return
    contest = contest_of(
        make_problem(case, robot), [Rival(tuple(r["effects"]), r["parameters"]) for r in row["rivals"]]
    )
    length = duration or default_duration(robot.machine.frame)
    for motion in sorted(set(motions) - set(row.get("after", {})), key=lambda m: m == DESIGNED):
        known = [after for after in row.get("after", {}).values() if after.get("same")]
        reference, promised = (None, {"left": 0.0}) if known else motion_of(motion, contest, length)
        again = row["before"] | {"same": True}
        if reference is not None and promised["left"] >= SAME:
            again, _ = explained(with_log(case, spec, reference), effects)
        row.setdefault("promised", {})[motion] = promised
        row.setdefault("after", {})[motion] = again
        yield row


def motion_of(motion: str, contest: Contest, duration: float) -> tuple[np.ndarray, dict[str, Any]]:
    """A motion (frames, references) [SI], designed or random, and what it promises."""
    from time import process_time

    from exodrake.experiment.contest import information
    from exodrake.experiment.design import design
    from exodrake.simulation.references import protocol

    started = process_time()
    if motion == DESIGNED:
        made = design(contest, duration)
        reference, found = made.reference.values, made.information
    else:
        text = f"random-motion:seed=0,duration={duration:g}"
        reference = protocol(text, contest.problem.robot).values
        found = information(contest, reference)
    left = found.left[found.closest] if found else 0.0
    probability = found.probability if found else 0.0
    return reference, {"probability": probability, "left": left, "time": process_time() - started}


def explained(case: Case, effects: frozenset[str]) -> tuple[dict[str, Any], tuple[Rival, ...]]:
    """Verdict of a case by some effects, with causes and their rivals, and the explanations still in play."""
    from exodrake.diagnosis.pipeline import diagnose

    made = diagnose(case, tried=effects)
    causes = [e for e in made.effects if e.role == "cause"]
    left = [cause.id for cause in causes] + [rival.id for cause in causes for rival in cause.rivals]
    return {"verdict": made.verdict, "causes": [c.id for c in causes], "class": left}, made.rivals


def with_log(case: Case, spec: RobotSpec, reference: np.ndarray) -> Case:
    """The case with the log that its robot leaves on a reference (frames, tendons) [N]."""
    from exodrake.data.case import EXPERIMENT, CaseLog
    from exodrake.data.log import Log
    from exodrake.reference.make import rounded
    from exodrake.reference.robot import Protocol
    from exodrake.reference.simulator import simulate

    columns = rounded(simulate(spec, Protocol(EXPERIMENT, reference), LOG_SEED))
    time = columns.pop("time")
    has = case.logs[0].log.has
    log = Log(time, {name: values for name, values in columns.items() if has(name)})
    return replace(case, logs=(*case.logs, CaseLog(log, EXPERIMENT, "fit", None, "experiment.csv")))


def ambiguous(folder: Path) -> list[Path]:
    """Cases of a set whose stored answer is ambiguous."""
    from exodrake.core.schema import read_json
    from exodrake.reference.answers import ANSWER, cases_of

    answered = [case for case in cases_of(folder) if (case / ANSWER).is_file()]
    return [case for case in answered if read_json(case / ANSWER).get("verdict") == "AMBIGUOUS"]


def left_in(answer: dict[str, Any]) -> frozenset[str]:
    """Effects of a stored answer and their rivals."""
    return frozenset(effect["id"] for effect in answer["effects"]) | found_ids(answer)


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
    from exodrake.core.files import write_text

    if len(labels) != len(folders):
        raise click.UsageError("one --labels for each set")
    rows, wanted = {}, list(filter(None, cases.split(",")))
    for folder, file in zip(folders, labels, strict=True):
        for case in places(folder, wanted):
            name = f"{folder.name}/{case.name}"
            place = keep / f"{folder.name}-{case.name}.json"
            rows[name] = json.loads(place.read_text()) if place.is_file() else {}
            if motions or not place.is_file():
                for row in of_case(rows[name], case, json.loads(file.read_text()), duration, motions):
                    keep.mkdir(parents=True, exist_ok=True)
                    write_text(place, json.dumps(row, indent=1) + "\n")
            click.echo(f"{name}: {summary(rows[name])}")
    if out:
        sets = " ".join(folder.name for folder in folders)
        write_text(out, page(rows, f"python -m studies.experiment {sets} --labels LABELS --keep kept --out {out}"))


def places(folder: Path, wanted: list[str]) -> Iterable[Path]:
    """Cases of a set that are measured."""
    return [folder / name.split("/")[1] for name in wanted if name.split("/")[0] == folder.name] or (
        [] if wanted else ambiguous(folder)
    )


def of_case(
    row: dict[str, Any], case: Path, labels: dict[str, Any], duration: float | None, motions: tuple[str, ...]
) -> Iterator[dict[str, Any]]:
    """Results of a case folder (`measured`)."""
    from exodrake.core.parallel import one_blas_thread
    from exodrake.core.schema import read_json
    from exodrake.data.case import read_case
    from exodrake.diagnosis.problem import required_of
    from exodrake.machines.robot_file import load_robot
    from exodrake.reference.answers import ANSWER
    from studies.transfer.study import withheld

    label, machine = labels.get("cases", labels)[case.name], load_robot().machine
    truth = [effect["id"] for effect in label["effects"]]
    read, effects = read_case(case, required_of(machine), machine.frame), left_in(read_json(case / ANSWER))
    with one_blas_thread():
        yield from measured(row, read, withheld(case.name, label), truth, effects, duration, motions)


def summary(row: dict[str, Any]) -> str:
    """Results of a case in a line."""
    after = "; ".join(f"{motion}: {said(found)}" for motion, found in row.get("after", {}).items())
    return f"{', '.join(row['truth'])}: {said(row['before'])}; {after}"


if __name__ == "__main__":
    command()
