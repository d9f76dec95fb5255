"""Answers to a blind set beside their labels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.json_file import read_json
from exodrake.core.schema import having, listing, names, number, optional, text
from exodrake.reference.case_mix import VISIBLE
from exodrake.reference.commitment import COMMITMENT, read_committed
from exodrake.reference.matching import Diagnosis, Truth
from exodrake.reference.run import ANSWER, FAILED, cases_of

KNOWN, NAMES = optional(number()), optional(listing(text()))  # a number that is not finite is null in an answer
BOUNDS = names(optional(having({"value": KNOWN, "low": KNOWN, "high": KNOWN})))
RIVALS = optional(listing(having({"id": text()}, required=("id",))))
EFFECT = having(
    {
        "id": text(), "kind": optional(text()), "role": optional(text()), "rivals": RIVALS,
        "parameters": optional(BOUNDS), "channels": optional(names(BOUNDS)),
    },
    required=("id",),
)  # fmt: skip
STEP = optional(having({"value": KNOWN, "low": KNOWN, "high": KNOWN}))
ANSWERED = having(
    {
        "verdict": text(),
        "where": optional(having({"block": optional(text()), "wires": NAMES, "joints": NAMES})),
        "effects": optional(listing(EFFECT)),
        "equivalents": NAMES,
        "closure": optional(having({"overall": STEP, "retune": STEP, "effect": STEP})),
        "candidates": optional(listing(having({"id": text()}, required=("id",)))),
        "baselines": optional(names(optional(text()))),
        "configuration": optional(names(text())),
        "simulated_seconds": KNOWN,
        "seconds": KNOWN,
    },
    required=("verdict",),
)
FAILURE = "FAILED"  # in place of a verdict; wrong wherever it counts


@dataclass(frozen=True)
class Answered:
    """One case: its label and its diagnosis."""

    name: str
    label: dict[str, Any]
    diagnosis: Diagnosis

    @property
    def kind(self) -> str:
        """Kind of case: healthy, unknown, single, pair ..."""
        return self.label["kind"]

    @property
    def mix(self) -> str:
        """Name of the case mix it was drawn from."""
        return self.label.get("mix", "standard")

    @property
    def truths(self) -> list[Truth]:
        """True effects."""
        return self.label["effects"]

    @property
    def verdict(self) -> str:
        """Verdict of the diagnosis."""
        return self.diagnosis["verdict"]

    @property
    def visible(self) -> bool:
        """Whether every true effect leaves a visible gap."""
        return bool(self.truths) and min(truth["gap"] for truth in self.truths) >= VISIBLE


def read_labels(folder: Path, labels: Path) -> dict[str, dict[str, Any]]:
    """Labels of a set by case; InputError for labels that changed, and for a case without a label."""
    truths = read_committed(labels, folder / COMMITMENT)
    for case in cases_of(folder):
        if case.name not in truths:
            raise InputError(f"{case}: not among the labels in {labels}")
    return truths


def read_answers(folder: Path, truths: dict[str, dict[str, Any]]) -> tuple[Answered, ...]:
    """Read the answers to a set.

    Args:
        folder: Folder with a folder per case that holds a diagnosis, or the reason why there is none.
        truths: Labels by case.

    Returns:
        The answered and the failed cases (verdict FAILED), in order of the labels.

    Raises:
        InputError: For a malformed diagnosis, answers of several configurations, and no answer at all.
    """
    answered = []
    for name, label in truths.items():
        path = folder / name / ANSWER
        if path.is_file():
            answered.append(Answered(name, label, read_diagnosis(path)))
        elif path.with_name(FAILED).is_file():
            answered.append(Answered(name, label, {"verdict": FAILURE}))
    if not answered:
        raise InputError(f"{folder}: no case has a diagnosis yet; run `exodrake blind run` first")
    check_configurations(answered, folder)
    return tuple(answered)


def read_diagnosis(path: Path) -> Diagnosis:
    """Read one diagnosis. InputError naming file and key if it is none."""
    return ANSWERED(read_json(path), str(path))


def check_configurations(answered: list[Answered], folder: Path) -> None:
    """InputError if the diagnoses were made with several versions of the package or its code."""
    from exodrake.core.provenance import described

    found = {described(case.diagnosis.get("configuration")) for case in answered if case.verdict != FAILURE}
    if len(found) > 1:
        raise InputError(
            f"{folder}: answered with several configurations ({'; '.join(sorted(found))}); `blind run --redo`"
        )
