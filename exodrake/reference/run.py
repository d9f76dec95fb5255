"""Diagnosing every case of a blind set, resumably: answers lie in the cases' folders (see `diagnosis.many`)."""

from pathlib import Path

from exodrake.core.errors import InputError
from exodrake.core.progress import Count, no_progress
from exodrake.diagnosis.many import ANSWER, FAILED, diagnose_all

__all__ = ["ANSWER", "FAILED", "cases_of", "run"]


def cases_of(folder: str | Path) -> list[Path]:
    """Case folders of a set, sorted. InputError if there is none."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    cases = sorted(path.parent for path in folder.glob("*/case.yaml") if not path.parent.name.startswith("."))
    if not cases:
        raise InputError(f"{folder}: no case in it (a folder with case.yaml)")
    return cases


def run(
    folder: str | Path,
    jobs: int = 1,
    cluster: str | None = None,
    progress: Count = no_progress,
    redo: bool = False,
) -> dict[str, str]:
    """Diagnose the unfinished cases of a set; arguments and errors are those of `cases_of` and `diagnose_all`.

    Returns:
        Case -> reason, for those that failed.
    """
    return diagnose_all({case: case for case in cases_of(folder)}, jobs, cluster, progress, redo)
