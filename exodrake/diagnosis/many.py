"""Diagnosis of many cases, resumable: a case with a whole diagnosis.json is done, one that fails leaves failed.json.

Every answer carries its configuration: a set answered by two would test neither. Answers of newer versions may have
further keys and verdicts.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from exodrake.core import schema
from exodrake.core.errors import InputError, printable
from exodrake.core.files import write_folder, write_text
from exodrake.core.parallel import Outcome, each
from exodrake.core.progress import Count, no_progress
from exodrake.core.provenance import configuration, describe_configuration, robot_digest
from exodrake.core.schema import anything, flag, having, listing, names, number, optional, quote, refusal, text
from exodrake.data.case import Case, moment, read_case
from exodrake.machines.robot_file import load_robot

ANSWER, FAILED = "diagnosis.json", "failed.json"
FAILURE = "FAILED"  # verdict of a case without an answer
RETUNED, IMPROVED, REPORT = "retuned.yaml", "improved.yaml", "report.html"  # beside an answer
type Report = Callable[[Any, Any], str]  # of a Diagnosis and its Problem
WORD = re.compile(r"[A-Z][A-Z_]{0,30}")


def line(value: Any, where: str) -> str:
    """Text, with whatever no terminal or file would take shown escaped."""
    return printable(text()(value, where))


def check_word(value: Any, where: str) -> str:
    """A word in capitals."""
    if not WORD.fullmatch(text()(value, where)):
        raise refusal(where, f"wanted a word in capitals, found {quote(value)}")
    return value


def check_moment(value: Any, where: str) -> datetime:
    """A date by ISO 8601, in UTC."""
    try:
        return moment(value, where).astimezone(UTC)
    except OverflowError:
        raise refusal(where, f"wanted a date as 2026-03-05, found {quote(value)}") from None


REAL, WORDS, NAMES = optional(number()), optional(line), optional(listing(line))  # null: not a number, not known
INTERVAL = optional(having({"value": REAL, "low": REAL, "high": REAL, "unit": WORDS}))
RIVAL, VALUE = having({"id": line, "share": INTERVAL}, ("id",)), optional(having({"value": WORDS}))
AMOUNTS = {"parameters": optional(names(INTERVAL)), "channels": optional(names(names(INTERVAL)))}
EFFECT = {"id": line, "kind": WORDS, "role": WORDS, "share": INTERVAL, "rivals": optional(listing(RIVAL))} | AMOUNTS
SCHEMA = having(
    {
        "case": WORDS,
        "serial": WORDS,
        "date": optional(check_moment),
        "verdict": check_word,
        "where": optional(having({"block": WORDS, "wires": NAMES, "joints": NAMES})),
        "effects": optional(listing(having(EFFECT, ("id",)))),
        "equivalents": NAMES,
        "remainder": optional(having({"value": REAL, "noise_std": REAL, "block": WORDS})),
        "confirmed": optional(flag),
        "closure": optional(
            having({"overall": INTERVAL, "retune": INTERVAL, "effect": INTERVAL, "rms": optional(names(REAL))})
        ),
        "candidates": optional(listing(having({"id": line}, ("id",)))),
        "reasons": NAMES,
        "seconds": REAL,
        "simulated_seconds": REAL,
        "since": optional(having({"began": VALUE})),
        "provenance": optional(having({"robot": WORDS, "version": WORDS, "code": optional(anything)})),
        "configuration": optional(names(line)),
    },
    required=("verdict",),
)
SIZED = names(having({"unit": line}, ("unit",)))
WHOLE = having(  # what an answer of `diagnose` holds; other methods may say less
    {
        "where": having({"block": line}, ("block",)),
        "effects": listing(having({"parameters": SIZED, "channels": names(SIZED)}, ("parameters", "channels"))),
        "equivalents": anything,
        "closure": having({"overall": anything}, ("overall",)),
    },
    required=("where", "effects", "equivalents", "closure"),
)


def check_answer(answer: Any, where: str) -> dict[str, Any]:
    """An answer as plain data, its `date` as a moment. InputError naming the key of what is missing or mistyped."""
    return WHOLE(SCHEMA(answer, where), where)


def read_stored(folder: Path) -> dict[str, Any] | None:
    """Read the answer in a folder; None if there is none that is whole."""
    try:
        answer = schema.read_json(folder / ANSWER)
        check_answer(answer, ANSWER)
    except InputError:
        return None
    return answer


def get_configuration(
    robot: str, tried: frozenset[str] | None = None, negligible: float | None = None
) -> dict[str, str]:
    """Return the configuration, with a digest of a nominal robot that is not built in and what else was chosen."""
    choice = {} if tried is None else {"effects": ",".join(sorted(tried))}
    choice |= {} if negligible is None else {"negligible": f"{negligible:g}"}
    return configuration() | choice | ({"robot": robot_digest(load_robot(robot))} if robot else {})


def diagnose_one(
    case: Case, robot: str, wanted: dict[str, str], tried: frozenset[str] | None = None,
    negligible: float | None = None, report: Report | None = None, command: str = "",
) -> dict[str, Any]:  # fmt: skip
    """Diagnose a case into plain data. RuntimeError where a configuration other than `wanted` is installed.

    Beside the answer, `files` holds the texts of the robots' files, and of the report, if one is wanted, by name.
    """
    from exodrake.diagnosis.pipeline import diagnose

    installed = get_configuration(robot, tried, negligible)
    if installed != wanted:
        raise RuntimeError(
            f"this worker has {describe_configuration(installed)}; the run uses {describe_configuration(wanted)}"
        )
    found = diagnose(case, load_robot(robot) if robot else None, tried=tried, negligible=negligible)
    if found.provenance:
        found = replace(found, provenance=replace(found.provenance, command=command))
    robots = {RETUNED: found.robots["retuned"], IMPROVED: found.robot}
    texts = {name: found.robot_file(robot) for name, robot in robots.items()}
    if report and found.problem:
        try:
            texts[REPORT] = report(found, found.problem)
        except Exception as error:  # which shall lose no answer
            found = replace(found, notes=(*found.notes, f"no report: {type(error).__name__}: {error}"))
    return found.to_json() | {"configuration": wanted, "files": texts}


def diagnose_all(
    places: Mapping[Path, Path], jobs: int = 1, cluster: str | None = None, progress: Count = no_progress,
    redo: bool = False, robot: str = "", tried: frozenset[str] | None = None, negligible: float | None = None,
    report: Report | None = None, command: str = "", allow_outside: bool = False,
) -> dict[str, str]:  # fmt: skip
    """Diagnose the unfinished of many cases; an interruption loses no answer.

    places: folder for the answer of each case. jobs, cluster: as in `parallel.each`. progress: called with the numbers
    of answered, failed and all cases. redo: answer anew the cases of another configuration. robot: a name or a file
    that each worker reads itself; the built-in one if empty. tried, negligible: as in `diagnose`. report: text of the
    report of an answer, which is written beside it.

    Returns {name of the answer's folder: reason} of the cases that failed; they stay unfinished. InputError for answers
    of another configuration without `redo`, as `parallel.each`, and where nothing can be written.
    """
    from exodrake.diagnosis.problem import list_required

    wanted = get_configuration(robot, tried, negligible)
    answers = {case: read_stored(place) for case, place in places.items()}
    foreign = [case for case, answer in answers.items() if answer and answer.get("configuration") != wanted]
    if foreign and not redo:
        theirs = describe_configuration((answers[foreign[0]] or {}).get("configuration"))
        raise InputError(
            f"{places[foreign[0]]}: answered with {theirs}, and so are {len(foreign)} of {len(places)} cases with"
            f" another configuration than this one ({describe_configuration(wanted)}); --redo answers them anew"
        )
    waiting = [case for case in places if answers[case] is None or case in foreign]
    sent: list[Path] = []
    answered, failed = len(places) - len(waiting), dict[str, str]()
    progress(answered, 0, len(places))

    def write(case: Path, outcome: Outcome) -> None:
        """Write the answer of a case, or why there is none; the file of an earlier run with the other result goes."""
        nonlocal answered
        place = places[case]
        place.mkdir(parents=True, exist_ok=True)
        if outcome.reason is None:
            texts = outcome.value.pop("files")
            texts |= {ANSWER: json.dumps(outcome.value, indent=1, allow_nan=False) + "\n"}
            write_folder(place, {name: text.encode() for name, text in texts.items()})
            (place / FAILED).unlink(missing_ok=True)
            answered += 1
        else:
            failure = {"reason": outcome.reason, "traceback": outcome.trace.splitlines()}
            write_text(place / FAILED, json.dumps(failure, indent=1) + "\n")
            for name in (ANSWER, RETUNED, IMPROVED, REPORT):
                (place / name).unlink(missing_ok=True)
            failed[place.name] = outcome.reason
        progress(answered, len(failed), len(places))

    def read_tasks() -> Iterator[tuple[Any, ...]]:
        machine = (load_robot(robot) if robot else load_robot()).machine
        for path in waiting:
            try:
                case = read_case(path, list_required(machine), machine.frame, allow_outside)
            except Exception as error:  # as a diagnosis that fails
                write(path, Outcome(-1, reason=f"{type(error).__name__}: {error}"))
                continue
            sent.append(path)
            yield case, robot, wanted, tried, negligible, report, command

    with closing(each(diagnose_one, read_tasks(), jobs, cluster)) as outcomes:
        try:
            for outcome in outcomes:
                write(sent[outcome.number], outcome)
        except KeyboardInterrupt:  # it may come between writing an answer and counting it
            progress(sum(read_stored(place) is not None for place in places.values()), len(failed), len(places))
            raise
    return failed
