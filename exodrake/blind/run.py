"""Diagnosing every case of a blind set, resumably.

Each answer is written as soon as it is there; a case with a whole diagnosis.json is done, any other is not. A case that
fails leaves failed.json with the reason, does not end the run, and is tried again by the next. Every answer carries the
configuration it was made with: a set answered by two of them would be no test of either.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from exodrake.case import Case, read_case
from exodrake.errors import InputError
from exodrake.files import write_text
from exodrake.parallel import each

ANSWER, FAILED = "diagnosis.json", "failed.json"
Progress = Callable[[int, int, int], None]


def cases_of(folder: str | Path) -> list[Path]:
    """Case folders of a set, sorted. InputError if there is none."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    cases = sorted(path.parent for path in folder.glob("*/case.yaml") if not path.parent.name.startswith("."))
    if not cases:
        raise InputError(f"{folder}: no case in it (a folder with case.yaml)")
    return cases


def stored(case: Path) -> dict[str, Any] | None:
    """The answer that lies in a case's folder; None if there is none that can be read."""
    try:
        answer = json.loads((case / ANSWER).read_text())
        return answer if "verdict" in answer else None
    except (OSError, ValueError, TypeError):
        return None


def finished(case: Path) -> bool:
    """True if the case has a diagnosis that can be read."""
    return stored(case) is not None


def diagnose_one(case: Case, configuration: dict[str, str]) -> dict[str, Any]:
    """A case's answer as plain data. RuntimeError where another configuration is installed than was asked for."""
    from exodrake.diagnosis import diagnose
    from exodrake.frozen import configuration as installed
    from exodrake.frozen import told

    if installed() != configuration:
        raise RuntimeError(f"this worker has {told(installed())}; asked for is {told(configuration)}")
    return diagnose(case).to_json() | {"configuration": configuration}


def waiting_cases(cases: list[Path], configuration: dict[str, str], redo: bool) -> list[Path]:
    """Cases still to be diagnosed. InputError if some were answered with another configuration, unless they are to be
    redone.
    """
    from exodrake.frozen import told

    answers = {case: stored(case) for case in cases}
    foreign = [case for case, answer in answers.items() if answer and answer.get("configuration") != configuration]
    if foreign and not redo:
        theirs = told((answers[foreign[0]] or {}).get("configuration"))
        raise InputError(
            f"{foreign[0]}: answered with {theirs}, and so are {len(foreign)} of {len(cases)} cases with another"
            f" configuration than this one ({told(configuration)}); --redo answers them anew"
        )
    return [case for case in cases if answers[case] is None or case in foreign]


class Book:
    """Writes down what becomes of the cases of a set, each as soon as it is known, and counts."""

    def __init__(self, cases: list[Path], waiting: list[Path], progress: Progress) -> None:
        self.total, self.answered, self.progress = len(cases), len(cases) - len(waiting), progress
        self.failed: dict[str, str] = {}
        self.tell()

    def tell(self) -> None:
        """Says how far it is."""
        self.progress(self.answered, len(self.failed), self.total)

    def keep(self, case: Path, answer: dict[str, Any]) -> None:
        """An answer; what an earlier run failed at is settled."""
        write_text(case / ANSWER, json.dumps(answer, indent=1, allow_nan=False) + "\n")
        (case / FAILED).unlink(missing_ok=True)
        self.answered += 1
        self.tell()

    def fail(self, case: Path, reason: str, trace: str = "") -> None:
        """Why there is no answer; half an answer, or one of another configuration, goes."""
        write_text(case / FAILED, json.dumps({"reason": reason, "traceback": trace.splitlines()}, indent=1) + "\n")
        (case / ANSWER).unlink(missing_ok=True)
        self.failed[case.name] = reason
        self.tell()


def run(
    folder: str | Path,
    jobs: int = 1,
    cluster: str | None = None,
    progress: Progress = lambda done, failed, total: None,
    redo: bool = False,
) -> dict[str, str]:
    """Diagnose the unfinished cases of a set; an interruption loses nothing that was done.

    Args:
        jobs, cluster: as in `parallel.each`. progress: called with how many are answered, have failed, and are there.
        redo: answer anew what was answered with another configuration.
    Returns:
        {case: reason} for those that failed; they stay unfinished.
    Raises:
        InputError: as `cases_of`, `waiting_cases` and `parallel.each`.
    """
    from exodrake.frozen import configuration

    cases = cases_of(folder)
    waiting = waiting_cases(cases, configuration(), redo)
    book, sent = Book(cases, waiting, progress), []

    def readable() -> Iterator[tuple[Case, dict[str, str]]]:
        for case in waiting:
            try:
                read = read_case(case)
            except Exception as error:  # as for a diagnosis that fails
                book.fail(case, f"{type(error).__name__}: {error}")
                continue
            sent.append(case)
            yield read, configuration()

    with closing(each(diagnose_one, readable(), jobs, cluster)) as outcomes:
        for outcome in outcomes:
            case = sent[outcome.number]
            if outcome.reason is None:
                book.keep(case, outcome.value)
            else:
                book.fail(case, outcome.reason, outcome.trace)
    return book.failed
