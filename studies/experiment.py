"""What a designed experiment gains: `docs/experiment.md`.

    exodrake blind make --seed 7 --cases 200 --out cases && exodrake blind run cases
    python -m studies.experiment cases --labels cases-labels.json --keep kept --out docs/experiment.md

Cases of the reference simulator that a diagnosis leaves ambiguous: the experiment that `exodrake experiment` designs
runs on the withheld robot, and the case is diagnosed again with that log; then the same with a random motion as long.
Labels serve to run the robot, and to count. What is measured is kept case by case, so that the command can be repeated.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from exodrake.cli.main import OneLineErrors
from studies.experiment_page import DESIGNED, RANDOM, page

if TYPE_CHECKING:
    from exodrake.blind.robot_spec import RobotSpec
    from exodrake.data.case import Case
    from exodrake.diagnosis.problem import Problem
    from exodrake.diagnosis.rival import Rival
    from exodrake.experiment.contest import Contest

LOG_SEED = 9  # of the noise of further logs


def measured(
    case: Case, spec: RobotSpec, truth: list[str], effects: frozenset[str], duration: float | None, seed: int
) -> dict[str, Any]:
    """What became of a case: its class, what the design promises, and the class after either motion.

    effects: those of the class that its stored answer leaves.
    """
    from exodrake.core.threads import one_blas_thread
    from exodrake.diagnosis.problem import make_problem
    from exodrake.experiment.contest import contest_of
    from exodrake.experiment.design import design
    from exodrake.experiment.information import CHANCE
    from exodrake.machines.robot_file import load_robot
    from exodrake.simulation.references import protocol

    robot = load_robot()
    with one_blas_thread():
        before, rivals = explained(make_problem(case, robot, effects), truth)
        found: dict[str, Any] = {"truth": truth, "before": before}
        if len(rivals) < 2:
            return found
        contest = contest_of(make_problem(case, robot), rivals)
        designed = design(contest, duration, seed)
        length = len(designed.reference.tension) * robot.machine.frame
        motions = {
            DESIGNED: designed.reference.tension,
            RANDOM: protocol(f"random-motion:seed={seed},duration={length:g}", robot).tension,
        }
        expected = {name: promised(contest, reference) for name, reference in motions.items()}
        found |= {
            "duration": length,
            "size": designed.size,
            "promised": expected,
            "after": dict.fromkeys(motions, before),
        }
        if max(left for _, left in expected.values()) < CHANCE**2:
            return found | {"same": True}
        for name, reference in motions.items():
            again = make_problem(with_log(case, spec, reference), robot, effects)
            found["after"][name] = explained(again, truth)[0]
    return found


def explained(problem: Problem, truth: list[str]) -> tuple[dict[str, Any], tuple[Rival, ...]]:
    """Verdict of a case with what the true law takes up of each other, and the explanations that are left."""
    from exodrake.diagnosis.comparison import taken_up
    from exodrake.diagnosis.pipeline import isolated
    from exodrake.diagnosis.rivals import rival
    from exodrake.diagnosis.verdict import decide

    problem, found = isolated(problem)
    decision = decide(problem, found)
    tested = [t for size in found.tested for t in size]
    true = next((t.explanation for t in tested if sorted(t.explanation.effects) == sorted(truth)), None)
    others = [t.explanation for t in tested if len(t.explanation.effects) == len(truth) and t.explanation is not true]
    taken = {e.name: taken_up(found.likelihood, e, true)[1] for e in others} if true else {}
    laws = {t.explanation.name: t.levels.law_error for t in tested}
    said = {"verdict": decision.verdict, "class": [t.explanation.name for t in decision.left]}
    return {**said, "taken": taken, "law_error": laws}, tuple(rival(problem, t.explanation) for t in decision.left)


def promised(contest: Contest, reference: np.ndarray) -> tuple[float, float]:
    """Probability that a motion distinguishes the rivals, and T of the two that it distinguishes worst."""
    from exodrake.experiment.information import information

    found = information(contest, reference)
    return (found.probability, found.left[found.closest]) if found else (0.0, 0.0)


def with_log(case: Case, spec: RobotSpec, reference: np.ndarray) -> Case:
    """The case with the log that its robot leaves on a reference (frames, tendons) [N]."""
    from exodrake.blind.make import rounded
    from exodrake.blind.robot_spec import Protocol
    from exodrake.blind.simulator import simulate
    from exodrake.data.case import EXPERIMENT, CaseLog
    from exodrake.data.log import Log

    columns = rounded(simulate(spec, Protocol(EXPERIMENT, reference), LOG_SEED))
    time = columns.pop("time")
    has = case.logs[0].log.has
    log = Log(time, {name: values for name, values in columns.items() if has(name)})
    return replace(case, logs=(*case.logs, CaseLog(log, EXPERIMENT, "fit", None, "experiment.csv")))


def ambiguous(folder: Path) -> list[Path]:
    """Cases of a set whose stored answer is ambiguous."""
    from exodrake.blind.run import ANSWER, cases_of
    from exodrake.core.json_file import read_json

    answered = [case for case in cases_of(folder) if (case / ANSWER).is_file()]
    return [case for case in answered if read_json(case / ANSWER).get("verdict") == "AMBIGUOUS"]


def left_in(answer: dict[str, Any]) -> frozenset[str]:
    """Effects of the explanations that a stored answer leaves."""
    return frozenset(i for c in answer["candidates"] if c["left"] for i in c["id"].split(" + "))


@click.command(cls=OneLineErrors)
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--labels", multiple=True, type=click.Path(exists=True, path_type=Path), help="Of each set, in order.")
@click.option("--cases", default="", metavar="NAME,...", help="SET/CASE of these alone.")
@click.option("--duration", type=float, default=None, help="Of an experiment [the designer's own].")
@click.option("--seed", default=0, show_default=True, help="Of the search and of the random motion.")
@click.option("--keep", required=True, type=click.Path(path_type=Path), help="Folder of what is measured, by case.")
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Write the page.")
def command(
    folders: tuple[Path, ...], labels: tuple[Path, ...], cases: str, duration: float | None, seed: int, keep: Path,
    out: Path | None,
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
            if not place.is_file():
                row = of_case(case, json.loads(file.read_text()), duration, seed)
                keep.mkdir(parents=True, exist_ok=True)
                write_text(place, json.dumps(row, indent=1) + "\n")
            rows[name] = json.loads(place.read_text())
            click.echo(f"{name}: {rows[name]}")
    if out:
        sets = " ".join(folder.name for folder in folders)
        write_text(out, page(rows, f"python -m studies.experiment {sets} --labels LABELS --keep kept --out {out}"))


def places(folder: Path, wanted: list[str]) -> Iterable[Path]:
    """Cases of a set that are measured."""
    return [folder / name.split("/")[1] for name in wanted if name.split("/")[0] == folder.name] or (
        [] if wanted else ambiguous(folder)
    )


def of_case(case: Path, labels: dict[str, Any], duration: float | None, seed: int) -> dict[str, Any]:
    """What became of one case folder."""
    from exodrake.blind.run import ANSWER
    from exodrake.blind.transfer import withheld
    from exodrake.core.json_file import read_json
    from exodrake.data.case_folder import read_case
    from exodrake.diagnosis.problem import required_of
    from exodrake.machines.robot_file import load_robot

    label = labels.get("cases", labels)[case.name]
    machine = load_robot().machine
    truth = [effect["id"] for effect in label["effects"]]
    read = read_case(case, required_of(machine), machine.frame)
    return measured(read, withheld(case.name, label), truth, left_in(read_json(case / ANSWER)), duration, seed)


if __name__ == "__main__":
    command()
