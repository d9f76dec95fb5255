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
ASIDE = ("diagnosis/healthy.py", "diagnosis/calibra", "data/plot.py", "model/display.py", "core/templates.py")


def configuration() -> dict[str, str]:
    """Version of the package, and first digits of the SHA-256 of the code and numbers that find answers."""
    folders = [*(PACKAGE / name for name in ANSWERING), *plugins.folders()]
    return {"version": __version__, "code": digest(tuple(file for place in folders for file in source_files(place)))}


def source_files(place: Path) -> tuple[Path, ...]:
    """Python and YAML files that bear on an answer, sorted: the file itself, or all below a folder."""
    found = [place] if place.is_file() else sorted([*place.rglob("*.py"), *place.rglob("*.yaml")])
    return tuple(file for file in found if not shorten_path(file).startswith(ASIDE) and file.name != "calibration.yaml")


def shorten_path(file: Path) -> str:
    """A file's path in the package, or its last two parts outside."""
    return (file.relative_to(PACKAGE) if file.is_relative_to(PACKAGE) else Path(*file.parts[-2:])).as_posix()


@cache
def digest(files: tuple[Path, ...]) -> str:
    """First 12 hexadecimal digits of the SHA-256 of names and contents."""
    whole = b"".join(shorten_path(file).encode() + b"\0" + file.read_bytes() + b"\0" for file in files)
    return hashlib.sha256(whole).hexdigest()[:DIGITS]


def robot_digest(robot: Robot) -> str:
    """First 12 hexadecimal digits of the SHA-256 of a robot's machine, variants, tolerances, limits and parameters."""
    machine = robot.machine
    stated = repr((machine.name, machine.variant_names, machine.tolerances, robot.limits))
    return hashlib.sha256(stated.encode() + b"\0" + robot.values.tobytes()).hexdigest()[:DIGITS]


def describe_configuration(known: dict[str, str] | None) -> str:
    """A configuration in words."""
    return ", ".join(f"{name} {value}" for name, value in known.items()) if known else "an unrecorded configuration"
