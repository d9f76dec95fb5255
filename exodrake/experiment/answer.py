"""Rival explanations of a case, from its stored answer or from a diagnosis made now."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.progress import StageProgress, no_progress
from exodrake.core.robot import Robot
from exodrake.core.schema import having, listing, names, number, read_json, text
from exodrake.data.case import read_case
from exodrake.diagnosis.many import ANSWER
from exodrake.diagnosis.problem import Problem, make_problem, required_of
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE, Rival, provenance_of

RIVALS = listing(having({"effects": listing(text()), "parameters": names(number())}, ("effects", "parameters")))
MADE_FROM = having({"files": names(text()), "parameters": text()}, ("files", "parameters"))
SCHEMA = having({"verdict": text(), "rivals": RIVALS, "provenance": MADE_FROM}, ("verdict", "rivals", "provenance"))
NOTHING = {
    NO_GAP: "its logs show no gap",
    RETUNE: "retuning closes its gap, and no single effect does so as well",
    NAMED: "one explanation is left",
}
NONE_LEFT = (
    "no explanation is left to tell apart; repeat the motion slowly, then quickly, and see what the error follows"
)


@dataclass(frozen=True, eq=False)
class InPlay:
    """A case with its verdict and its rivals: explanations that the logs do not tell apart, if there are several."""

    problem: Problem
    verdict: str
    rivals: tuple[Rival, ...]

    @property
    def why_none(self) -> str:
        """Reason why there are no rivals to tell apart, in words; empty where there are some."""
        if len(self.rivals) > 1:
            return ""
        reason = "one explanation is left" if self.verdict == AMBIGUOUS else NOTHING.get(self.verdict, NONE_LEFT)
        return f"{self.problem.case.name}: {self.verdict}, {reason}: there is nothing for an experiment to distinguish"


def in_play(place: Path, robot: Robot, folder: Path | None = None, progress: StageProgress = no_progress) -> InPlay:
    """The explanations still in play of a case.

    Args:
        place: folder of logs or one log, whose `diagnosis.json` is used if it was made from these logs and this robot;
            or an answer, a JSON file.
        robot: nominal robot.
        folder: case of an answer that does not lie in the folder of its case.
        progress: called with the stages of a diagnosis.

    Raises:
        InputError: for a case or an answer that cannot be read, and an answer to other logs or of another robot.
    """
    machine, is_answer = robot.machine, place.suffix.lower() == ".json" and not place.is_dir()
    if folder is not None and not is_answer:
        raise InputError(f"--case {folder}: for an answer (a JSON file); {place} is a case itself")
    answer = SCHEMA(read_json(place), str(place)) if is_answer else None
    case = read_case((folder or place.parent) if is_answer else place, required_of(machine), machine.frame)
    problem = make_problem(case, robot)
    if answer:
        if differs := difference(problem, answer):
            raise InputError(f"{place}: it was made from {differs}; diagnose again")
        return read_answer(problem, answer)
    stored = place / ANSWER
    if stored.is_file():
        try:
            answer = SCHEMA(read_json(stored), str(stored))
        except InputError:
            answer = None
        if answer and not difference(problem, answer):
            return read_answer(problem, answer)
    from exodrake.diagnosis.pipeline import diagnose

    found = diagnose(case, robot, progress)
    return InPlay(problem, found.verdict, found.rivals)


def difference(problem: Problem, answer: dict[str, Any]) -> str:
    """Difference between the provenance of an answer and this problem, in words; empty if there is none."""
    ours, theirs = provenance_of(problem), answer["provenance"]
    if theirs["files"] != ours.files:
        return f"other logs than those of {problem.case.name}"
    return "another nominal robot" if theirs["parameters"] != ours.parameters else ""


def read_answer(problem: Problem, answer: dict[str, Any]) -> InPlay:
    """The explanations of a checked answer."""
    rivals = tuple(Rival(tuple(item["effects"]), item["parameters"]) for item in answer["rivals"])
    return InPlay(problem, answer["verdict"], rivals)
