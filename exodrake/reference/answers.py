"""Answers to a blind set beside their labels, to which a salted SHA-256 is published with the cases.

The salt lies in the labels file: without it, guessed labels cannot be checked against the published digest. Answers lie
in the cases' folders (see `diagnosis.many`).
"""

import hashlib
import json
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes, write_text
from exodrake.core.provenance import describe_configuration
from exodrake.core.schema import anything, flag, having, listing, names, number, read_json, text
from exodrake.diagnosis.many import ANSWER, FAILED, FAILURE, SCHEMA
from exodrake.reference.cases import VISIBLE

Truth = dict[str, Any]  # one true effect, as the labels give it
Diagnosis = dict[str, Any]  # an answer, as its JSON gives it
COMMITMENT = "seal.txt"  # in the folder of a set

SEATS = listing(text())
TRUE_EFFECT = having(
    {"id": text(), "block": text(), "blocks": SEATS, "wires": SEATS, "joints": SEATS, "parameters": names(number()),
     "exact": flag, "gap": number()},
    required=("id", "block", "wires", "joints", "parameters", "exact", "gap"),
)  # fmt: skip
LABEL = having({"kind": text(), "mix": text(), "effects": listing(TRUE_EFFECT)}, required=("kind", "effects"))
LABELS = having({"salt": text(), "cases": anything}, required=("salt", "cases"))


def commitment_to(cases: dict[str, Any], salt: str) -> str:
    """SHA-256 over salt and canonical JSON."""
    canonical = json.dumps(cases, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256((salt + canonical).encode(errors="surrogatepass")).hexdigest()


def write_committed(cases: dict[str, Any], labels: Path, commitment: Path) -> None:
    """Write labels with a fresh salt, and the commitment."""
    salt = secrets.token_hex(32)
    write_text(labels, json.dumps({"salt": salt, "cases": cases}, indent=1) + "\n")
    write_text(commitment, commitment_to(cases, salt) + "\n")


def read_committed(labels: str | Path, commitment: str | Path) -> dict[str, Any]:
    """Labels by case. InputError if a file is missing or malformed, or if the labels have changed."""
    stored = LABELS(read_json(labels), str(labels))
    cases, salt = stored["cases"], stored["salt"]
    if commitment_to(cases, salt).encode() != read_bytes(commitment).strip():
        raise InputError(f"{labels}: the labels are not those committed in {commitment}")
    return names(LABEL)(cases, str(labels))


def find_cases(folder: str | Path) -> list[Path]:
    """Case folders of a set, sorted. InputError if there is none."""
    cases = sorted(path.parent for path in Path(folder).glob("*/case.yaml") if not path.parent.name.startswith("."))
    if not cases:
        raise InputError(f"{folder}: no case in it (a folder with case.yaml)")
    return cases


@dataclass(frozen=True)
class Answered:
    """One case: what its label says, and its diagnosis."""

    name: str
    kind: str  # healthy, unknown, single, pair ...
    truths: list[Truth]
    diagnosis: Diagnosis
    mix: str = "standard"  # name of the case mix that it was drawn from

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
    for case in find_cases(folder):
        if case.name not in truths:
            raise InputError(f"{case}: not among the labels in {labels}")
    return truths


def read_answers(folder: Path, truths: dict[str, dict[str, Any]]) -> tuple[Answered, ...]:
    """Read the answers to a set: the answered and the failed cases (verdict FAILED), in order of the labels.

    InputError for a malformed diagnosis, answers of several configurations, and no answer at all.
    """
    answered = []
    for name, label in truths.items():
        path = folder / name / ANSWER
        if path.is_file() or path.with_name(FAILED).is_file():
            diagnosis = SCHEMA(read_json(path), str(path)) if path.is_file() else {"verdict": FAILURE}
            answered.append(Answered(name, label["kind"], label["effects"], diagnosis, label.get("mix", "standard")))
    if not answered:
        raise InputError(f"{folder}: no case has a diagnosis yet; run `exodrake blind run` first")
    found = {
        describe_configuration(case.diagnosis.get("configuration")) for case in answered if case.verdict != FAILURE
    }
    if len(found) > 1:
        raise InputError(
            f"{folder}: answered with several configurations ({'; '.join(sorted(found))}); `blind run --redo`"
        )
    return tuple(answered)
