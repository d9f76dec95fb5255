"""Plugins: folders with a user's own machines, effects, parts, detectors and file formats (`docs/howto/robot.md`).

A plugin folder is laid out as this package is, and its modules are imported under this package's names. Plugins come
from `add_plugin`, the environment variable EXODRAKE_PLUGINS, which worker processes inherit, and installed packages.
"""

import os
import sys
from collections.abc import Iterator, MutableSequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from traceback import extract_tb
from types import ModuleType

from exodrake.core.errors import InputError

VARIABLE = "EXODRAKE_PLUGINS"
GROUP = "exodrake.plugins"
PACKAGE = Path(__file__).parent.parent
MACHINE, ROBOT = "machine.py", "robot.yaml"
EXTENSIBLE = ("machines", "effects", "physics", "data/formats", "diagnosis/detect")


def add_plugin(folder: str | Path) -> Path:
    """Registers a plugin folder for this process and its workers.

    Raises:
        InputError: if the folder is absent, holds nothing of a plugin, or comes too late for modules already in use.

    Examples:
        >>> Path("mine/effects").mkdir(parents=True)
        >>> add_plugin("mine").name
        'mine'
    """
    path = Path(folder).resolve()
    if not path.is_dir():
        raise InputError(f"{folder}: no such folder of a machine or plugin")
    if not is_machine(path) and not any((path / part).is_dir() for part in EXTENSIBLE):
        raise InputError(f"{folder}: no plugin: wanted {MACHINE}, {ROBOT}, or a folder {', '.join(EXTENSIBLE)}")
    if is_machine(path) and (PACKAGE / "machines" / path.name).is_dir():
        raise InputError(f"{folder}: there is a machine {path.name} already; rename the folder")
    if path in folders():
        return path
    os.environ[VARIABLE] = os.pathsep.join(filter(None, (os.environ.get(VARIABLE, ""), str(path))))
    for part in EXTENSIBLE:
        package = sys.modules.get("exodrake." + part.replace("/", "."))
        if package is not None:
            extend(package.__path__, part)
    return path


def is_machine(folder: Path) -> bool:
    """Whether a folder is one machine, by code or by a robot file alone."""
    return (folder / MACHINE).is_file() or (folder / ROBOT).is_file()


def folders() -> list[Path]:
    """Plugin folders: those of EXODRAKE_PLUGINS, then those of installed packages."""
    return [*map(Path, filter(None, os.environ.get(VARIABLE, "").split(os.pathsep))), *find_installed()]


@cache
def find_installed() -> list[Path]:
    """Folders of the packages that entry points name; nothing of them is imported."""
    from importlib.metadata import entry_points
    from importlib.util import find_spec

    found = []
    for top, *rest in (entry.value.split(".") for entry in entry_points(group=GROUP)):
        if spec := find_spec(top):
            found += [Path(place, *rest) for place in spec.submodule_search_locations or ()]
    return found


def single_machines() -> dict[str, Path]:
    """Plugin folders that are one machine each, by name."""
    return {path.name: path for path in folders() if is_machine(path)}


def extend(search_path: MutableSequence[str], part: str) -> None:
    """Adds the plugins' folders of one part to a package's `__path__`; called in that package's `__init__`."""
    for folder in folders():
        place = str(folder / part)
        if place not in search_path and os.path.isdir(place):
            search_path.append(place)
    for name, folder in single_machines().items() if part == "machines" else ():
        if (folder / MACHINE).is_file() and not any(Path(place, name, MACHINE).is_file() for place in search_path):
            package = sys.modules.setdefault(f"exodrake.machines.{name}", ModuleType(f"exodrake.machines.{name}"))
            package.__path__ = [str(folder)]


@contextmanager
def shown_errors() -> Iterator[None]:
    """Turns an error of a plugin's code into an InputError that names file, line and error; others pass."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        frames = [(frame.filename, frame.lineno) for frame in extract_tb(error.__traceback__)]
        if isinstance(error, SyntaxError) and error.filename:
            frames.append((error.filename, error.lineno))
        for file, line in reversed(frames):  # of the last frame that lies in a plugin folder
            for folder in (folder for folder in folders() if Path(file).is_relative_to(folder)):
                place = f"{folder.name}/{Path(file).relative_to(folder)}, line {line}"
                reason = getattr(error, "msg", None) or error
                raise InputError(f"{place}: {type(error).__name__}: {reason}") from error
        raise


def module_names(search_path: MutableSequence[str]) -> list[str]:
    """Names of all modules and packages on a package's `__path__`, plugins' included, sorted."""
    from pkgutil import iter_modules

    return sorted({found.name for found in iter_modules(search_path) if not found.name.startswith("_")})
