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

if TYPE_CHECKING:
    from exodrake.blind.robot_spec import RobotSpec
    from exodrake.data.case import Case
    from exodrake.diagnosis.problem import Problem
    from exodrake.diagnosis.rival import Rival

DESIGNED, RANDOM = "designed", "random"
LOG_SEED = 9  # of the noise of further logs


def measured(case: Case, spec: RobotSpec, truth: list[str], seconds: float | None, seed: int) -> dict[str, Any]:
    """What became of a case: its class, what the design promises, and the class after either motion."""
    from exodrake.core.parallel import one_blas_thread
    from exodrake.core.plain import plain
    from exodrake.diagnosis.problem import make_problem
    from exodrake.experiment.contest import contest_of
    from exodrake.experiment.design import design
    from exodrake.machines.robot_file import load_robot
    from exodrake.simulation.references import protocol

    robot = load_robot()
    with one_blas_thread():
        verdict, rivals = explained(make_problem(case, robot))
        found: dict[str, Any] = {"truth": truth, "verdict": verdict, "class": [rival.name for rival in rivals]}
        found["rivals"] = plain(rivals)
        if len(rivals) < 2:
            return found
        contest = contest_of(make_problem(case, robot), rivals)
        designed = design(contest, seconds, seed)
        length = len(designed.reference.tension) * robot.machine.frame
        motions = {
            DESIGNED: designed.reference.tension,
            RANDOM: protocol(f"random-motion:seed={seed},duration={length:g}", robot).tension,
        }
        found |= {"seconds": length, "size": designed.size, "after": {}, "promised": {}, "left": {}}
        for name, reference in motions.items():
            found["promised"][name], found["left"][name] = promised(contest, reference)
            again, left = explained(make_problem(with_log(case, spec, reference), robot))
            found["after"][name] = {"verdict": again, "class": [rival.name for rival in left]}
    return found


def explained(problem: Problem) -> tuple[str, tuple[Rival, ...]]:
    """Verdict of a case, and the explanations that its logs do not reject."""
    from exodrake.diagnosis.pipeline import isolated
    from exodrake.diagnosis.rivals import rival
    from exodrake.diagnosis.verdict import decide

    problem, found = isolated(problem)
    decision = decide(problem, found)
    return decision.verdict, tuple(rival(problem, t.explanation) for t in decision.left)


def promised(contest: Any, reference: np.ndarray) -> tuple[float, float]:
    """Probability that a motion tells the rivals apart, and the least T."""
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


def resolved(found: dict[str, Any], motion: str) -> bool:
    """Whether one explanation is left after a motion, and it is the true one."""
    after = found["after"][motion]
    return after["verdict"] == "NAMED" and sorted(after["class"][0].split(" + ")) == sorted(found["truth"])


def page(rows: dict[str, dict[str, Any]], command: str) -> str:
    """The page, from what was measured by case."""
    from scipy.stats import binomtest

    used = {name: row for name, row in rows.items() if "after" in row}
    lines = ["# The next experiment, measured", "", TEXT.format(command=command), ""]
    lines += ["| motion | resolved | 95 % interval | one left, but not the true one | promised on average |"]
    lines += ["|---|---|---|---|---|"]
    for motion in (DESIGNED, RANDOM):
        right = sum(resolved(row, motion) for row in used.values())
        named = sum(row["after"][motion]["verdict"] == "NAMED" for row in used.values())
        interval = binomtest(right, len(used)).proportion_ci(method="wilson") if used else (0.0, 1.0)
        shares = [row["promised"][motion] for row in used.values() if row["promised"]]
        mean = f"{np.mean(shares):.0%} ({len(shares)} cases)" if shares else "-"
        share = f"{right} of {len(used)} | {interval[0]:.0%} to {interval[1]:.0%} | {named - right} | {mean}"
        lines.append(f"| {motion} | {share} |")
    lines += ["", "| case | true | class before | T designed, random | after the designed | after a random one |"]
    lines += ["|---|---|---|---|---|---|"]
    for name, row in used.items():
        left = f"{row['left'][DESIGNED]:.0f}, {row['left'][RANDOM]:.0f}"
        after = " | ".join(said(row["after"][motion]) for motion in (DESIGNED, RANDOM))
        lines.append(f"| {name} | {', '.join(row['truth']) or 'none'} | {', '.join(row['class'])} | {left} | {after} |")
    if skipped := sorted(set(rows) - set(used)):
        lines += ["", f"No longer ambiguous when they were diagnosed anew: {', '.join(skipped)}."]
    return "\n".join(lines) + "\n"


def said(after: dict[str, Any]) -> str:
    """A verdict with what is left."""
    return f"{after['verdict']} {', '.join(after['class'])}".strip()


TEXT = """Cases of the reference simulator that a diagnosis leaves ambiguous get one further log: of the motion that
`exodrake experiment` designs, or of a random one as long. Then each is diagnosed again, that log used in full length.
Resolved: one explanation is left, and it is the true one. T is what the closest rival would leave of the new log once
it is refitted, in variances of noise and of the error of a law; promised is the probability that follows from it.
Where two laws differ by less than the better one differs from the robot, a diagnosis keeps both whatever the motion: a
slack tendon that never loses its tension is an offset of an encoder, and friction that falls with speed is Coulomb
friction within the error that a law is granted.

    {command}"""


@click.command(cls=OneLineErrors)
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--labels", multiple=True, type=click.Path(exists=True, path_type=Path), help="Of each set, in order.")
@click.option("--cases", default="", metavar="NAME,...", help="SET/CASE of these alone.")
@click.option("--seconds", type=float, default=None, help="Of an experiment [the designer's own].")
@click.option("--seed", default=0, show_default=True, help="Of the search and of the random motion.")
@click.option("--keep", required=True, type=click.Path(path_type=Path), help="Folder of what is measured, by case.")
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Write the page.")
def command(
    folders: tuple[Path, ...], labels: tuple[Path, ...], cases: str, seconds: float | None, seed: int, keep: Path,
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
                row = of_case(case, json.loads(file.read_text()), seconds, seed)
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


def of_case(case: Path, labels: dict[str, Any], seconds: float | None, seed: int) -> dict[str, Any]:
    """What became of one case folder."""
    from exodrake.blind.transfer import withheld
    from exodrake.data.case_folder import read_case
    from exodrake.diagnosis.problem import required_of
    from exodrake.machines.robot_file import load_robot

    label = labels.get("cases", labels)[case.name]
    machine = load_robot().machine
    truth = [effect["id"] for effect in label["effects"]]
    read = read_case(case, required_of(machine), machine.frame)
    return measured(read, withheld(case.name, label), truth, seconds, seed)


if __name__ == "__main__":
    command()
