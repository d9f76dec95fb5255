"""The configuration of a diagnosis (version, code): answers of two make no set."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from exodrake import __version__
from exodrake.core import plugins

if TYPE_CHECKING:
    from exodrake.model.robot import Robot

PACKAGE = Path(__file__).parent.parent
ANSWERING = ("core", "model", "engine", "data", "physics", "effects", "machines", "simulation", "diagnosis")
DIGITS = 12  # hexadecimal ones of a SHA-256
# without bearing on an answer
ASIDE = ("diagnosis/calibra", "data/plot.py", "model/display.py", "core/templates.py")


def configuration() -> dict[str, str]:
    """Version of the package, and first digits of the SHA-256 of the code and numbers that find answers."""
    folders = [*(PACKAGE / name for name in ANSWERING), *plugins.folders()]
    return {"version": __version__, "code": digest(*folders)}


@cache
def digest(*folders: Path) -> str:
    """First digits of the SHA-256 of names and contents of the Python and YAML files that have a bearing on answers."""
    whole = hashlib.sha256()
    for file in (file for folder in folders for file in sorted([*folder.rglob("*.py"), *folder.rglob("*.yaml")])):
        name = (file.relative_to(PACKAGE) if file.is_relative_to(PACKAGE) else Path(*file.parts[-2:])).as_posix()
        if not name.startswith(ASIDE) and file.name != "calibration.yaml":
            whole.update(name.encode() + b"\0" + file.read_bytes() + b"\0")
    return whole.hexdigest()[:DIGITS]


def robot_digest(robot: Robot) -> str:
    """First 12 hexadecimal digits of the SHA-256 of a robot's machine, variants, tolerances, limits and parameters."""
    machine = robot.machine
    stated = repr((machine.name, machine.variant_names, machine.tolerances, robot.limits))
    return hashlib.sha256(stated.encode() + b"\0" + robot.values.tobytes()).hexdigest()[:DIGITS]


def describe_configuration(known: dict[str, str] | None) -> str:
    """A configuration in words."""
    return ", ".join(f"{name} {value}" for name, value in known.items()) if known else "an unrecorded configuration"
