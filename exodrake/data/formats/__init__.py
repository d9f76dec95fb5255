"""File formats of logs, a module each, found by their folder here and in plugins.

A format has `ENDINGS`, `read(data: bytes, source: str) -> Log` and `write(log: Log) -> bytes`; `exodrake.data.log`
has what they share. The formats differ in what they hold a heading `name [unit]` and a missing sample by.
"""

from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType

from exodrake.core import plugins
from exodrake.core.errors import InputError

plugins.extend(__path__, "data/formats")


@cache
def formats() -> dict[str, ModuleType]:
    """Format module by ending; where two claim an ending, the one that is first by name has it."""
    found: dict[str, ModuleType] = {}
    for name in plugins.module_names(__path__):
        with plugins.shown_errors():
            module = import_module(f"{__name__}.{name}")
        for ending in module.ENDINGS:
            found.setdefault(ending, module)
    return found


def ending(path: str | Path) -> str | None:
    """The known ending of a file name, longest first, or None."""
    name = Path(path).name.lower()
    return next((known for known in sorted(formats(), key=len, reverse=True) if name.endswith(known)), None)


def stem(path: str | Path) -> str:
    """A file's name without folder and ending: `sweeps_1` of `logs/sweeps_1.csv.gz`."""
    name = Path(path).name
    return name[: -len(ending(name) or "")] if ending(name) else Path(name).stem


def format_of(path: str | Path) -> ModuleType:
    """The format of a file; InputError with all endings for an unknown one."""
    known = ending(path)
    if known is None:
        raise InputError(f"{path}: ending is none of {', '.join(formats())}")
    return formats()[known]
