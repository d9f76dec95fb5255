"""Notes on a log, a sentence a line in `NAME.notes.txt` beside it: what was done to its signals before."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from exodrake.core.files import is_file, read_bytes
from exodrake.data.formats import stem

ENDING = ".notes.txt"
MOST = 100  # lines that are read


def notes_name(file: str | Path) -> str:
    """Name of the file of notes of a log."""
    return stem(file) + ENDING


def notes_text(notes: Sequence[str]) -> bytes:
    """Content of the file."""
    return ("\n".join(notes) + "\n").encode()


def read_notes(log: Path) -> list[str]:
    """Notes on a log, its name first; none if there is no such file."""
    file = log.with_name(notes_name(log))
    if not is_file(file):
        return []
    lines = read_bytes(file).decode(errors="replace").splitlines()[:MOST]
    return [f"{log.name}: {line.strip()}" for line in lines if line.strip()]
