"""Commitment to the labels: a salted SHA-256 that is published with the cases, so that no label can change afterwards.

The salt lies in the labels file: without it, guessed labels cannot be checked against the published digest.
"""

import hashlib
import json
import secrets
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.core.json_file import read_json
from exodrake.core.schema import anything, flag, having, listing, names, number, text

COMMITMENT = "seal.txt"  # in the folder of a set

SEATS = listing(text())
EFFECT = having(
    {"id": text(), "block": text(), "blocks": SEATS, "wires": SEATS, "joints": SEATS, "parameters": names(number()),
     "exact": flag, "gap": number()},
    required=("id", "block", "wires", "joints", "parameters", "exact", "gap"),
)  # fmt: skip
LABEL = having({"kind": text(), "mix": text(), "effects": listing(EFFECT)}, required=("kind", "effects"))
LABELS = having({"salt": text(), "cases": anything}, required=("salt", "cases"))


def digest(cases: dict[str, Any], salt: str) -> str:
    """Commitment: SHA-256 over salt and canonical JSON."""
    canonical = json.dumps(cases, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256((salt + canonical).encode(errors="surrogatepass")).hexdigest()


def write_committed(cases: dict[str, Any], labels: Path, commitment: Path) -> None:
    """Write labels with a fresh salt, and the commitment."""
    from exodrake.core.files import write_text

    salt = secrets.token_hex(32)
    write_text(labels, json.dumps({"salt": salt, "cases": cases}, indent=1) + "\n")
    write_text(commitment, digest(cases, salt) + "\n")


def read_committed(labels: str | Path, commitment: str | Path) -> dict[str, Any]:
    """Labels by case. InputError if a file is missing or malformed, or if the labels have changed."""
    labels, commitment = Path(labels), Path(commitment)
    for path in (labels, commitment):
        if not path.is_file():
            raise InputError(f"{path}: no such file")
    stored = LABELS(read_json(labels), str(labels))
    cases, salt = stored["cases"], stored["salt"]
    if digest(cases, salt).encode() != read_bytes(commitment).strip():
        raise InputError(f"{labels}: the labels are not those committed in {commitment}")
    return names(LABEL)(cases, str(labels))
