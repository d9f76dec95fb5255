"""Recordings of real machines as cases of their robots: `machines/NAME/recordings.py`, each with `case(path)`.

Sources and licences are stated in those modules; the recordings themselves are not part of this repository.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from exodrake.core.errors import InputError
from exodrake.data.case import Case
from exodrake.machines.library import module_of, recorded_machines


def reader(name: str) -> Callable[[Path], Case]:
    """The `case` function of a machine's recordings; InputError with the machines that have one."""
    if name not in recorded_machines():
        raise InputError(f"no recordings of {name!r}; there are {', '.join(recorded_machines())}")
    return module_of(name, "recordings").case
