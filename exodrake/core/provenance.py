"""The configuration a diagnosis is made with, so that answers of two configurations are never taken for one set."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from exodrake import __version__

PACKAGE = Path(__file__).parent.parent
THRESHOLDS = PACKAGE / "diagnosis" / "thresholds.yaml"
ANSWERING = ("core", "data", "systems", "effects", "machines", "compiled", "simulation", "diagnosis")
ASIDE = (
    "diagnosis/healthy.py",
    "data/plot.py",
    "core/display.py",
    "core/templates.py",
)


@cache
def configuration() -> dict[str, str]:
    """Version of the package, and first digits of the SHA-256 of the thresholds and of the code that finds answers."""
    pages = [page for name in ANSWERING for page in sorted(pages_of(PACKAGE / name))]
    return {"version": __version__, "thresholds": digest([THRESHOLDS]), "code": digest(pages)}


def pages_of(place: Path) -> list[Path]:
    """Source and data that bear on an answer: a file, or what is below a folder."""
    found = [place] if place.is_file() else [*place.rglob("*.py"), *place.rglob("*.yaml")]
    return [page for page in found if not page.relative_to(PACKAGE).as_posix().startswith(ASIDE) and page != THRESHOLDS]


def digest(pages: list[Path]) -> str:
    """First 12 hexadecimal digits of the SHA-256 of names and contents."""
    whole = hashlib.sha256()
    for page in pages:
        whole.update(page.relative_to(PACKAGE).as_posix().encode() + b"\0" + page.read_bytes() + b"\0")
    return whole.hexdigest()[:12]


def told(known: dict[str, str] | None) -> str:
    """A configuration in words."""
    return ", ".join(f"{name} {value}" for name, value in known.items()) if known else "an unrecorded configuration"
