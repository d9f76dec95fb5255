"""File formats of logs, a module each, found by their folder here and in plugins.

A format has `ENDINGS`, `read(data: bytes, source: str) -> Log` and `write(log: Log) -> bytes`; `exodrake.data.log`
has what they share. The formats differ in what they hold a heading `name [unit]` and a missing sample by.
"""

from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from exodrake.core import plugins
from exodrake.core.child import in_child
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


def read_apart[T](reader: Callable[[bytes, str], T], data: bytes, source: str, what: str) -> T:
    """What a reader makes of a file, in the child process. InputError for a file that is no whole `what`."""
    return in_child(read_whole, reader, data, source, what, source=source, size=len(data))


def read_whole(reader: Callable[[bytes, str], Any], data: bytes, source: str, what: str) -> Any:
    """`read_apart` in this process."""
    try:
        return reader(data, source)
    except InputError:
        raise
    except Exception as error:  # a parser raises whatever damaged bytes lead it to
        raise InputError(f"{source}: not a whole {what} file ({type(error).__name__})") from None
