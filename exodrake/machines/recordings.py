"""Recordings of four real machines as cases of their robots: a page a set, each with `case(path)`.

`SETS` names them as the robots do. Their sources and licences are in the pages; nothing of them is in this repository.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from exodrake.data.case import Case

SETS = ("emps", "tendon_sheath", "so101", "dvrk_wrist")


def reader(name: str) -> Callable[[Path], Case]:
    """The `case` function of a set."""
    return import_module(f"exodrake.machines.{name}.recordings").case
