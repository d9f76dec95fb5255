"""Diagnosing many cases, resumably.

Each answer is written as soon as it is there; a case with a whole diagnosis.json is done, any other is not. A case that
fails leaves failed.json with the reason, does not end the run, and is tried again by the next. Every answer carries the
configuration it was made with: a set answered by two of them would be no test of either.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.files import write_text
from exodrake.core.parallel import each
from exodrake.core.provenance import configuration, described
from exodrake.data.case import Case
from exodrake.data.case_folder import read_case
from exodrake.machines.robot_file import load_robot

ANSWER, FAILED = "diagnosis.json", "failed.json"
Progress = Callable[[int, int, int], None]


def stored(folder: Path) -> dict[str, Any] | None:
    """The answer that lies in a folder; None if there is none that can be read."""
    try:
        answer = json.loads((folder / ANSWER).read_text())
        return answer if "verdict" in answer else None
    except (OSError, ValueError, TypeError):
        return None


def configured(robot: str, tried: frozenset[str] | None = None) -> dict[str, str]:
    """The configuration, with a digest of the nominal robot's numbers if it is another than the built-in one, and the
    effects tried if they are chosen.
    """
    choice = {} if tried is None else {"effects": ",".join(sorted(tried))}
    if not robot:
        return configuration() | choice
    return configuration() | choice | {"robot": hashlib.sha256(load_robot(robot).values.tobytes()).hexdigest()[:12]}


def diagnose_one(case: Case, robot: str, wanted: dict[str, str], tried: frozenset[str] | None = None) -> dict[str, Any]:
    """A case's answer as plain data. RuntimeError where another configuration is installed than was asked for."""
    from exodrake.diagnosis.pipeline import diagnose

    here = configured(robot, tried)
    if here != wanted:
        raise RuntimeError(f"this worker has {described(here)}; asked for is {described(wanted)}")
    found = diagnose(case, load_robot(robot) if robot else None, tried=tried)
    return found.to_json() | {"configuration": wanted}


def unanswered(places: Mapping[Path, Path], wanted: dict[str, str], redo: bool) -> list[Path]:
    """Cases still to be diagnosed. InputError if some were answered with another configuration, unless they are to be
    redone.
    """
    answers = {case: stored(place) for case, place in places.items()}
    foreign = [case for case, answer in answers.items() if answer and answer.get("configuration") != wanted]
    if foreign and not redo:
        theirs = described((answers[foreign[0]] or {}).get("configuration"))
        raise InputError(
            f"{places[foreign[0]]}: answered with {theirs}, and so are {len(foreign)} of {len(places)} cases with"
            f" another configuration than this one ({described(wanted)}); --redo answers them anew"
        )
    return [case for case in places if answers[case] is None or case in foreign]


class Book:
    """Writes down what becomes of the cases, each as soon as it is known, and counts."""

    def __init__(self, places: Mapping[Path, Path], waiting: list[Path], progress: Progress) -> None:
        self.places, self.answered, self.progress = places, len(places) - len(waiting), progress
        self.failed: dict[str, str] = {}
        self.tell()

    def tell(self) -> None:
        """Says how far it is."""
        self.progress(self.answered, len(self.failed), len(self.places))

    def keep(self, case: Path, answer: dict[str, Any]) -> None:
        """An answer; what an earlier run failed at is settled."""
        place = self.places[case]
        place.mkdir(parents=True, exist_ok=True)
        write_text(place / ANSWER, json.dumps(answer, indent=1, allow_nan=False) + "\n")
        (place / FAILED).unlink(missing_ok=True)
        self.answered += 1
        self.tell()

    def fail(self, case: Path, reason: str, trace: str = "") -> None:
        """Why there is no answer; half an answer, or one of another configuration, goes."""
        place = self.places[case]
        place.mkdir(parents=True, exist_ok=True)
        write_text(place / FAILED, json.dumps({"reason": reason, "traceback": trace.splitlines()}, indent=1) + "\n")
        (place / ANSWER).unlink(missing_ok=True)
        self.failed[place.name] = reason
        self.tell()


def diagnose_all(
    places: Mapping[Path, Path],
    jobs: int = 1,
    cluster: str | None = None,
    progress: Progress = lambda done, failed, total: None,
    redo: bool = False,
    robot: str = "",
    tried: frozenset[str] | None = None,
) -> dict[str, str]:
    """Diagnose the unfinished of many cases; an interruption loses nothing that was done.

    Args:
        places: case -> folder for its answer. jobs, cluster: as in `parallel.each`. robot: nominal robot, a name or a
        file
            (which each worker reads itself); the built-in one if empty.
        progress: called with how many are answered, have failed, and are there.
        redo: answer anew what was answered with another configuration.
        tried: ids of the effects to try; None: the default ones.
    Returns:
        {name of the answer's folder: reason} for those that failed; they stay unfinished.
    Raises:
        InputError: as `unanswered` and `parallel.each`, and where nothing can be written.
    """
    from exodrake.diagnosis.problem import required_of

    machine = (load_robot(robot) if robot else load_robot()).machine
    required, wanted = required_of(machine), configured(robot, tried)
    waiting = unanswered(places, wanted, redo)
    book, sent = Book(places, waiting, progress), []

    def readable() -> Iterator[tuple[Case, str, dict[str, str], frozenset[str] | None]]:
        for case in waiting:
            try:
                read = read_case(case, required, machine.frame)
            except Exception as error:  # as for a diagnosis that fails
                book.fail(case, f"{type(error).__name__}: {error}")
                continue
            sent.append(case)
            yield read, robot, wanted, tried

    with closing(each(diagnose_one, readable(), jobs, cluster)) as outcomes:
        for outcome in outcomes:
            case = sent[outcome.number]
            if outcome.reason is None:
                book.keep(case, outcome.value)
            else:
                book.fail(case, outcome.reason, outcome.trace)
    return book.failed
