"""The seal: a salted SHA-256 of the labels, made with the cases, so that nobody can change an answer after the
questions are out.

The salt lies in the labels file, not beside the seal: without it the labels cannot be guessed and checked against the
seal.
"""

import hashlib
import json
import secrets
from pathlib import Path

from exodrake.core.errors import InputError


def digest(cases, salt):
    """Seal of the labels: SHA-256 over salt and canonical JSON."""
    canonical = json.dumps(cases, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256((salt + canonical).encode()).hexdigest()


def write_sealed(cases, labels, seal):
    """Write labels with a fresh salt, and the seal."""
    from exodrake.core.files import write_text

    salt = secrets.token_hex(32)
    write_text(labels, json.dumps({"salt": salt, "cases": cases}, indent=1) + "\n")
    write_text(seal, digest(cases, salt) + "\n")


def read_sealed(labels, seal):
    """Labels by case. InputError if a file is missing or malformed, or if the labels are not those that were sealed."""
    labels, seal = Path(labels), Path(seal)
    for path in (labels, seal):
        if not path.is_file():
            raise InputError(f"{path}: no such file")
    try:
        page = json.loads(labels.read_text())
        cases, salt = page["cases"], page["salt"]
    except (json.JSONDecodeError, KeyError, TypeError, UnicodeDecodeError):
        raise InputError(f"{labels}: not a labels file (JSON with keys 'salt' and 'cases')") from None
    if digest(cases, salt) != seal.read_text().strip():
        raise InputError(f"{labels}: the labels are not those sealed in {seal}")
    return cases
