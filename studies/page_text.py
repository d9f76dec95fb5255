"""Pages of studies: when and by which code they were made, shares with their intervals, and what is kept by case."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

from exodrake.core.confidence import binomial_interval
from exodrake.core.files import write_text
from exodrake.core.provenance import configuration


def made() -> str:
    """Date, commit (`+`: with changes), and digest of the code that finds answers, as diagnosis.json states it."""
    words = ["git", "describe", "--always", "--exclude", "*", "--dirty=+"]
    found = subprocess.run(words, cwd=Path(__file__).parent, capture_output=True, text=True).stdout.strip()
    return f"{date.today().isoformat()}, commit `{found or 'unknown'}`, code `{configuration()['code']}`"


def share(hits: int, total: int) -> str:
    """A share with its exact 95 % interval."""
    low, high = binomial_interval(hits, total)
    return f"{hits}/{total} ({100 * low:.0f} to {100 * high:.0f} %)" if total else "–"


def keep(place: Path, measure: Callable[[], Any]) -> Any:
    """What a JSON file holds; measured and written where there is none."""
    if not place.is_file():
        write_text(place, json.dumps(measure(), indent=1) + "\n")
    return json.loads(place.read_text())
